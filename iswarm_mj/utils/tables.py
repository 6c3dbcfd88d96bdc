"""Tables of results: parquet and CSV files that contain their own settings."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from iswarm_mj._version import __version__
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, check_file, check_name

MAX_VALUES = 10**8
"""Largest table that is read, in values: a compressed one may be small on disk."""
_KEY = b"iswarm_mj"
"""Key of the settings in the metadata of a parquet file."""


def write_table(
    path: Path,
    rows: Sequence[Mapping[str, Any]],
    settings: Mapping[str, Any],
    *,
    csv: bool = False,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write a table in one step: parquet, and optionally CSV beside it.

    Args:
        path: path of the parquet file.
        rows: mappings with the same names; None is a missing value.
        settings: settings that the rows depend on; stored in the file as JSON, with the version of
            the package.
        csv: also write a CSV file of the same name.
        units: units of columns, for the metadata of the parquet file.
    """
    check_name(path, ".parquet", setting="path")
    table = pa.Table.from_pylist(list(map(dict, rows)))
    metadata = json.dumps({"version": __version__, **settings}, sort_keys=True)
    unit_of = units or {}
    columns = [field.with_metadata({"unit": unit_of.get(field.name, "")}) for field in table.schema]
    table = table.cast(pa.schema(columns, {_KEY: metadata.encode()}))
    with atomic_write(path) as part:
        pyarrow.parquet.write_table(table, str(part), compression="zstd")
    if csv:
        write_csv(path.with_suffix(".csv"), rows)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as a CSV file in one step, without settings."""
    check_name(path, ".csv", setting="path")
    with atomic_write(path) as part:
        pyarrow.csv.write_csv(pa.Table.from_pylist(list(map(dict, rows))), str(part))


def read_table(path: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return the rows and settings of a parquet file written by `write_table`.

    Raises:
        UserError: the file does not exist, or `write_table` did not write it.
    """
    try:
        check_file(path)
        about = pyarrow.parquet.read_metadata(path)
        if about.num_rows * about.num_columns > MAX_VALUES:
            raise ValueError("it has more values than experiments make")
        table = pyarrow.parquet.read_table(path)
        settings = json.loads(table.schema.metadata[_KEY])
    except (OSError, pa.ArrowException, TypeError, KeyError, ValueError, RecursionError):
        raise UserError(
            f"{path} is not a readable table of iswarm; give the directory of a finished run or "
            "run it again."
        ) from None
    return table.to_pylist(), settings


def aligned(lines: Sequence[Sequence[str]]) -> list[str]:
    """Return lines of cells as text, in columns of equal width."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    texts = []
    for line in lines:
        cells = [cell.rjust(width) for cell, width in zip(line, widths, strict=True)]
        texts.append("  ".join(cells))
    return texts
