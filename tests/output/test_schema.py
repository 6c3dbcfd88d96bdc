"""Each quantity of the schema is in trajectories, tables, recordings and docs, with its unit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.rrd import read
from support.runs import run_of

import iswarm_mj
from iswarm_mj.output.rerun_entities import SHOWN, UNITS
from iswarm_mj.output.schema import ARRAYS, axes_of, columns_of, dtype_of
from iswarm_mj.output.trajectory import RECORDING, TRAJECTORY
from iswarm_mj.workflows.clean import run_swarm

PAGE = (Path(__file__).parents[2] / "docs" / "files.md").read_text()
TABLE_OF_AXES = {
    ("T", "N"): "robots",
    ("T", "K"): "balls",
    ("T", "M"): "boxes",
    ("T", "N", "S"): "links",
    ("T",): "steps",
}
WITHOUT_COLUMNS = ("step", "has_priority", "link_valid")
"""Quantities that tables show otherwise."""
COLUMNS = [(name, place) for name in ARRAYS for place in range(len(columns_of(name)))]
"""Quantity and place of each column."""


@pytest.fixture(scope="module")
def run(small, tmp_path_factory):
    """Arrays, loaded run and recording of a run with a box."""
    out = tmp_path_factory.mktemp("run")
    box = (0.0, 4.0, 0.5, 0.7, 10.0, 1e-5, 0.01)
    config = replace(small, arena=replace(small.arena, boxes=(box,)))
    run_swarm(run_of(config, steps=12), out)
    return np.load(out / TRAJECTORY), iswarm_mj.load(out), read(out / RECORDING)


def values_of(arrays, name, place):
    """Values of a column in the order of the rows of its table."""
    values = arrays[name]
    axes = axes_of(name)
    if values.ndim > len(axes):
        values = values[..., place]
    return values[arrays["link_valid"]] if axes == ("T", "N", "S") else values.ravel()


@pytest.mark.parametrize("name", ARRAYS)
def test_trajectories_have_each_quantity_in_its_type(run, name):
    arrays, _, _ = run
    assert arrays[name].dtype == dtype_of(name)
    assert arrays[name].ndim == len(ARRAYS[name].type.dim_str.split())
    assert columns_of(name) or name in WITHOUT_COLUMNS


@pytest.mark.parametrize(("name", "place"), COLUMNS)
def test_tables_and_docs_describe_each_column(run, name, place):
    _, loaded, _ = run
    column = columns_of(name)[place]
    table = TABLE_OF_AXES[axes_of(name)]
    assert column.description
    metadata = getattr(loaded, table).schema.field(column.name).metadata
    assert metadata[b"unit"] == column.unit.encode()
    assert metadata[b"description"] == column.description.encode()
    assert len(metadata) == 2
    section = PAGE.split(f"<!-- made: {table} -->")[1].split("<!-- made -->")[0]
    assert f"| `{column.name}` | {column.unit} | {column.description} |" in section


@pytest.mark.parametrize(("name", "place"), COLUMNS)
def test_tables_have_the_values_of_trajectories(run, name, place):
    arrays, loaded, _ = run
    column = columns_of(name)[place]
    if column.words:
        pytest.skip("the table has words")
    table = getattr(loaded, TABLE_OF_AXES[axes_of(name)])
    expected = values_of(arrays, name, place)
    values = table[column.name].to_pylist()
    is_known = np.array([value is not None for value in values])
    assert is_known.any() or column.name == "holder"
    known_values = np.array([value for value in values if value is not None], expected.dtype)
    np.testing.assert_array_equal(known_values, expected[is_known])


@pytest.mark.parametrize("shown", SHOWN, ids=lambda shown: shown.column.name)
def test_recordings_and_docs_have_what_is_shown(run, shown):
    arrays, _, recorded = run
    column = shown.column
    unit, factor = UNITS.get(column.unit, (column.unit, 1))
    assert f"| `{column.shown}` | `{shown.component}` | {unit} |" in PAGE
    rows = recorded[f"/{column.shown}"][shown.component]
    values = np.array([value for row in rows for value in row])
    if column.name != "holder":  # which is -1 where no robot holds the ball
        expected = values_of(arrays, shown.quantity, shown.place) * factor
        np.testing.assert_allclose(values, expected, rtol=1e-6)
