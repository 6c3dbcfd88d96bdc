"""Each quantity of the schema is in trajectories, tables, recordings and the documentation, with its unit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.rrd import read
from support.runs import run_of

import iswarm_mj
from iswarm_mj.output.rerun_entities import SHOWN, UNITS
from iswarm_mj.output.schema import ARRAYS, axes_of, dtype_of
from iswarm_mj.output.trajectory import RECORDING, TRAJECTORY
from iswarm_mj.workflows.clean import run_swarm

DOCS = Path(__file__).parents[2] / "docs" / "files.md"
TABLE = {("T", "N"): "robots", ("T", "K"): "balls", ("T", "M"): "boxes", ("T", "N", "S"): "links", ("T",): "steps"}


@pytest.fixture(scope="module")
def done(small, tmp_path_factory):
    """Arrays, tables and recording of a run."""
    out = tmp_path_factory.mktemp("run")
    box = 0.0, 4.0, 0.5, 0.7, 10.0, 1e-5, 0.01
    run = run_of(replace(small, arena=replace(small.arena, boxes=(box,))), steps=12)
    run_swarm(run, out)
    return np.load(out / TRAJECTORY), iswarm_mj.load(out), read(out / RECORDING)


@pytest.mark.parametrize("name", ARRAYS)
def test_a_quantity_is_everywhere(done, name):
    arrays, saved, recorded = done
    values, field, axes = arrays[name], ARRAYS[name], axes_of(name)
    assert values.dtype == dtype_of(name) and values.ndim == len(field.type.dim_str.split())
    table, page = getattr(saved, TABLE[axes]), DOCS.read_text()
    section = page.split(f"<!-- made: {TABLE[axes]} -->")[1].split("<!-- made -->")[0]
    for place, column in enumerate(field.metadata["columns"]):
        assert column.description and table.schema.field(column.name).metadata == {
            b"unit": column.unit.encode(),
            b"description": column.description.encode(),
        }
        assert f"| `{column.name}` | {column.unit} | {column.description} |" in section
        own = values if values.ndim == len(axes) else values[..., place]
        own = own[arrays["link_valid"]] if axes == ("T", "N", "S") else own.ravel()
        found = np.array(table[column.name].to_pylist(), object)
        if not column.words:
            known = found != None  # noqa: E711, element by element
            assert known.any() or column.name == "holder"
            np.testing.assert_array_equal(found[known].astype(own.dtype), own[known])
        for component, *_ in (each for each in SHOWN if each[-1] == column):
            unit, factor = UNITS.get(column.unit, (column.unit, 1))
            there = np.array([x for row in recorded[f"/{column.shown}"][component] for x in row])
            if column.name != "holder":
                np.testing.assert_allclose(there, own * factor, rtol=1e-6)
            assert f"| `{column.shown}` | `{component}` | {unit} |" in page
    assert field.metadata["columns"] or name in ("step", "has_priority", "link_valid")
