"""Trajectories without a quantity, as an earlier version wrote them: only what needs it refuses them."""

import shutil

import numpy as np
import pytest
from helpers_cli import code_of
from helpers_runs import run_of

import iswarm_mj
from iswarm_mj.output.schema import ARRAYS, NotRecorded, columns_of
from iswarm_mj.output.tables import TABLES
from iswarm_mj.output.trajectory import RESULT, SCENE, TRAJECTORY, Scene
from iswarm_mj.workflows.clean import clean

LEFT_OUT = {"link_valid": "links", "ball_position": "balls"}
"""Quantities without which there are no rows."""


@pytest.fixture(scope="module")
def recorded(small, tmp_path_factory):
    """Directory of a run."""
    out = tmp_path_factory.mktemp("recorded")
    clean(run_of(small, steps=8, n_worlds=2, record_worlds=(0, 1)), out)
    return out


@pytest.fixture
def without(recorded, tmp_path):
    """Return a copy of the run's first world without some arrays."""

    def make(*names):
        (tmp_path / RESULT).write_bytes((recorded / RESULT).read_bytes())
        with np.load(recorded / TRAJECTORY) as file:
            np.savez(tmp_path / TRAJECTORY, **{name: values for name, values in file.items() if name not in names})
        return tmp_path

    return make


def read(run, tables):
    return {name: getattr(run, name) for name in tables}


@pytest.mark.parametrize("name", [name for name in ARRAYS if name not in ("step", "pose", "box_pose")])
def test_other_columns_are_there(without, name):
    tables = [table for table in TABLES if table != LEFT_OUT.get(name)]
    whole, run = (read(iswarm_mj.load(without(*names)), tables) for names in ((), (name,)))
    own, lost = {column.name for column in columns_of(name)}, set()
    for table, expected in whole.items():  # of some quantities columns of others are made
        found, missing = run[table], {*expected.column_names} - {*run[table].column_names}
        assert found.equals(expected.drop_columns([*missing]))
        lost |= missing
        assert missing <= own or name in ("message", "ball_state", "is_running", "has_priority", "link_sender")
    assert own <= lost or name in LEFT_OUT
    if name in LEFT_OUT:
        with pytest.raises(NotRecorded, match=f"no `{name}`, which an earlier version did not record; repeat the run"):
            getattr(iswarm_mj.load(without(name)), LEFT_OUT[name])


def test_worlds_without_it_have_nulls(without, recorded):
    place = without("mean_speed")
    shutil.copytree(recorded / "world-1", place / "world-1")
    speed = iswarm_mj.load(place).steps["mean_speed"].to_pylist()
    assert speed[: len(speed) // 2] == [None] * (len(speed) // 2) and None not in speed[len(speed) // 2 :]


def test_constants_that_were_added_have_their_defaults(without):
    names = [SCENE + name for name in Scene._field_defaults if not name.startswith("memory")]
    scene = iswarm_mj.load(without(*names)).scene
    assert (scene.metric_names, scene.area_names, scene.obstacles.shape) == ((), (), (0, 5))


def test_earlier_runs_have_no_boxes(without):
    assert iswarm_mj.load(without("box_pose")).boxes.num_rows == 0


def test_commands_refuse_what_they_need(without, capfd):
    place = without("mean_speed", "is_loaded")
    assert code_of("replay", place, "--out", place / "a.html") == 2
    expected = "iswarm: the trajectory has no `is_loaded`, which an earlier version did not record; repeat the run\n"
    assert capfd.readouterr().err == expected
    place = without("mean_speed", "collisions")
    assert code_of("replay", place, "--out", place / "a.html") == 0
