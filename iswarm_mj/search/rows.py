"""Rows of tables of runs: chosen and grouped by the values in their columns."""

from collections.abc import Mapping, Sequence
from typing import Any

Row = Mapping[str, Any]
"""Values by the names of columns."""
Rows = Sequence[Row]


def select(rows: Rows, **labels: object) -> list[Row]:
    """Return the rows that have these values in their columns."""
    return [row for row in rows if all(row[name] == value for name, value in labels.items())]


def by(rows: Rows, *columns: str) -> dict:
    """Return the rows by the values of a column, or of several as a tuple, in the order of their
    first rows."""
    groups: dict = {}
    for row in rows:
        key = tuple(row[name] for name in columns)
        groups.setdefault(key if len(columns) > 1 else key[0], []).append(row)
    return groups
