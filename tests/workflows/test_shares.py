"""Worlds of a run in shares on several machines: each world is what it is alone."""

from functools import partial

import numpy as np
import pytest
from helpers_cli import SMALL, WALK, code_of, result

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.simulation.faults import decode
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.state import Fault
from iswarm_mj.simulation.worlds import World, worlds_of_seed
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import FaultKind, UserError
from iswarm_mj.workflows.clean import clean
from iswarm_mj.workflows.shares import _compute, parts

SETTINGS = RunSettings(30, 30, 5, n_worlds=3, record_worlds=(2,))


def maker(config, numbers, recorded=()):
    worlds = worlds_of_seed(PRESETS["type1"], SETTINGS)
    own = RunSettings(30, 30, 5, n_worlds=len(numbers), record_worlds=recorded)
    return partial(Run, config, PRESETS["type1"], own, MujocoSettings(1), worlds=[worlds[number] for number in numbers])


def test_results_are_those_of_one_machine(small, tmp_path, capsys):
    whole = clean(maker(small, [0, 1, 2], (2,))(), SETTINGS, tmp_path / "whole")
    mine, theirs = parts(3, 2, (2,))
    assert (mine, theirs) == ([0, 2], [1])
    shared = clean(
        maker(small, mine, (1,))(), SETTINGS, tmp_path / "shared", others=lambda: [_compute(maker(small, theirs))]
    )
    for name in ("n_worlds", "seed", "delivered", "picked", "collisions", "fitness", "metrics", "steps", "faults"):
        assert shared[name] == whole[name], name
    one, other = (np.load(tmp_path / name / "trajectory.npz")["pose"] for name in ("whole", "shared"))
    assert np.array_equal(one, other)


def test_parts():
    assert parts(7, 3) == [[0, 1, 2], [3, 4], [5, 6]]
    assert parts(7, 3, (6, 2)) == [[0, 2, 6], [1, 3], [4, 5]]
    assert parts(4, 1, (0, 1, 2, 3)) == [[0, 1, 2, 3]]


@pytest.mark.parametrize(("n_worlds", "recorded", "says"), [(2, (), "worlds must be"), (4, (0, 1, 3), "record_worlds")])
def test_worlds_that_cannot_be_shared_are_refused(n_worlds, recorded, says):
    with pytest.raises(UserError, match=says):
        parts(n_worlds, 3, recorded)


def test_ray_computes_the_others(tmp_path, monkeypatch, capsys):
    """Also with a strategy in a file of this machine."""
    ray = pytest.importorskip("ray")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk.py").write_text(WALK)
    flags = ["--worlds=3", "--steps=10", "--no-record", "--strategy=walk.py:Walk"]
    try:
        assert code_of("clean", *SMALL, *flags, "--out=whole") == 0
        assert code_of("clean", *SMALL, *flags, "--hosts=2", "--out=shared") == 0
    finally:
        ray.shutdown()
    whole, shared = result("whole"), result("shared")
    assert all(shared[name] == whole[name] for name in ("collisions", "picked", "metrics"))


def test_faults_name_worlds_by_their_numbers_in_the_run():
    """Not by those within the share of a machine."""
    worlds = [World(PRESETS["type1"], 30, 5, index) for index in (4, 17)]
    fault = Fault(*np.array([[FaultKind.OUTSIDE, FaultKind.TOO_MANY_PAIRS], [9, 3], [7, 0]]))
    assert [(f.world, f.step) for f in decode(fault, worlds)] == [(4, 9), (17, 3)]
    assert str(decode(fault, worlds)[0]).startswith("step 9, world 4: robot 7 left the arena")
