"""Where robots end, against much finer steps in double precision. Units: mm, rad.

The finer the steps, the shorter the margin at which contacts begin, so that the reference is that
of rigid robots. After one control step an error is that of the step. After ten, robots have slipped
to other sides of each other, and only the whole crowd compares.
`pytest -m slow tests/agreement/test_fine_steps.py -s` prints the differences.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from support.small import SMALL

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.plane import FINEST
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.settings import REFINEMENT, ModelSpec
from iswarm_mj.simulation.actuate import drive_phases
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.layout import place_robots

N_STEPS = 10
STEP = np.sqrt(2)
"""Way of a robot in a control step."""
WALKS_BEFORE = {"crowd": 3, "jam": 12}
"""Control steps of a coarse run that make the start of the comparison."""


class Ways(NamedTuple):
    """Poses of robots in a scene of one world."""

    start: np.ndarray
    """(N, 3) where all engines begin."""
    turns: np.ndarray
    """(T, N) commands of a crowd; in a jam all robots turn towards the middle."""
    ends: np.ndarray
    """(T, N, 3) after each control step of the reference."""


def planar_engine(n_robots, refinement=REFINEMENT, accuracy=None):
    """Return the planar engine of one world, with an accuracy, by default the usual one."""
    settings = PlanarSettings(threads=1, refinement=refinement)
    if accuracy is not None:
        settings = PlanarSettings(threads=1, refinement=refinement, accuracy=accuracy)
    return settings.host_engine(ModelSpec(SMALL, n_robots, n_robots))(1, 1)


def mujoco_engine(n_robots):
    """Return MuJoCo in C for one world."""
    arena = compile_arena(SMALL, n_robots, np.zeros(0))
    return MujocoEngine(SMALL, arena, 1, 1, n_robots)


ENGINES = {"planar": planar_engine, "mujoco": mujoco_engine}


def command(scene, poses, turns):
    """Return the commands of robots at poses (N, 3)."""
    if scene == "jam":
        angle = np.arctan2(-poses[:, 1], -poses[:, 0]) - poses[:, 2]
        wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
        turns = np.clip(wrapped, -np.pi / 2, np.pi / 2)
    return Command(turns[None], np.full((1, len(turns)), STEP))


def walk(engine, scene, start, turns):
    """Return where robots are (T, N, 3) after each control step."""
    bodies = engine.place(start[None], np.ones((1, len(start)), bool))
    ends = []
    for turn in turns:
        poses = engine.poses(bodies)[0]
        phases = drive_phases(SMALL.drive, command(scene, poses, turn))
        motion = engine.move(bodies, phases, np.ones(1, bool))
        assert not motion.fault.any()
        bodies = motion.bodies
        ends.append(engine.poses(bodies)[0].copy())
    return np.array(ends)


@cache
def reference(scene, n_robots, refinement):
    """Return a scene with the ways of the reference."""
    rng = np.random.default_rng(4)
    placed = place_robots(SMALL.arena, n_robots, rng)
    turns = rng.uniform(-np.pi / 2, np.pi / 2, (WALKS_BEFORE[scene], n_robots))
    start = walk(planar_engine(n_robots), scene, placed, turns)[-1]

    fine = planar_engine(n_robots, refinement, FINEST)
    turns = rng.uniform(-np.pi / 2, np.pi / 2, (N_STEPS, n_robots))
    return Ways(start, turns, walk(fine, scene, start, turns))


def errors(engine, scene, n_robots, refinement):
    """Return distances (T, N) from where the reference puts robots, and ways (2, T, N)."""
    ways = reference(scene, n_robots, refinement)
    ends = walk(ENGINES[engine](n_robots), scene, ways.start, ways.turns)
    distance = np.hypot(*np.moveaxis((ends - ways.ends)[..., :2], -1, 0))
    moved = np.stack([ends, ways.ends])[..., :2] - ways.start[:, :2]
    return distance, np.hypot(moved[..., 0], moved[..., 1])


MEAN_ERROR = 0.12
"""Largest mean distance from the reference after a control step."""
WAY_ERROR = {1: 0.1, N_STEPS: 0.15}
"""Largest difference of the mean way of all robots after some control steps, as a share of it."""


def check(engine, scene, n_robots, refinement):
    """Check the ways of an engine against those of the reference."""
    distance, way = errors(engine, scene, n_robots, refinement)
    of_engine, of_reference = way.mean(axis=2)
    for n_steps in WAY_ERROR:
        last = n_steps - 1
        print(
            f"{scene}, {engine}, {n_steps} steps: {distance[last].mean():.3f} mm, "
            f"90 % within {np.quantile(distance[last], 0.9):.3f}, way "
            f"{of_engine[last]:.3f} instead of {of_reference[last]:.3f}"
        )
    assert distance[0].mean() < MEAN_ERROR
    for n_steps, error in WAY_ERROR.items():
        last = n_steps - 1
        assert of_engine[last] == pytest.approx(of_reference[last], rel=error)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("scene", WALKS_BEFORE)
def test_a_few_robots_end_near_where_finer_steps_put_them(engine, scene):
    check(engine, scene, 20, 20)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("scene", WALKS_BEFORE)
def test_robots_end_near_where_a_hundred_times_finer_steps_put_them(engine, scene):
    check(engine, scene, 70, 100)
