"""Rows of tables of runs: chosen and grouped by the values in their columns."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

FINISHED = "finished_at"
"""Measure of worlds that may end before it is known."""

Row = Mapping[str, Any]
"""Values by the names of columns."""
Rows = Sequence[Row]


def select(rows: Rows, **labels: object) -> list[Row]:
    """Return the rows that have these values in their columns."""
    return [row for row in rows if all(row[name] == value for name, value in labels.items())]


def by(rows: Rows, *columns: str) -> dict:
    """Return lists of rows by the values of a column, or of several columns as a tuple.

    The groups are in the order of their first rows.
    """
    groups: dict = {}
    for row in rows:
        values = tuple(row[name] for name in columns)
        key = values[0] if len(columns) == 1 else values
        groups.setdefault(key, []).append(row)
    return groups


def values_of(rows: Rows, measure: str) -> Float[np.ndarray, "B"]:
    """Return a measure of worlds, NaN where it is unknown.

    Worlds that did not finish count as their last step.
    """
    values = []
    for row in rows:
        is_late = measure == FINISHED and row[measure] is None
        values.append(row["max_steps"] if is_late else row[measure])
    return np.array(values, float)
