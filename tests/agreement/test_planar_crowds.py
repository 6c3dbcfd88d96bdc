"""The planar engine, at MuJoCo's time step, against MuJoCo in C: crowds of cleaning runs.

Bodies are taken from runs in C before some control steps, and take each of these with the planar
engine. `pytest -m slow tests/agreement/test_planar_crowds.py -s` prints the differences. Units:
mm, rad.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import jax
import numpy as np
import pytest
from support.mujoco import velocities_of
from support.planar import as_mujoco
from support.touching import pairs_of

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar import batch_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS

pytestmark = pytest.mark.slow

AT_STEPS = (50, 100, 150, 200, 250, 300)
N_WORLDS = 2
ALLOWED = 0.02
"""Largest difference of a pose."""
SMALL_DIFFERENCE = 1e-3
"""Difference beyond which 1 % of the poses may be."""
CONFIG = SwarmConfig()
GENOME = replace(PRESETS["type1"], use_hop_count=False)
"""Genome of swarms that have not delivered all balls by step 300."""


class Crowd(NamedTuple):
    """Control step of some worlds in C."""

    poses: np.ndarray
    """(B, N, 3) before the step."""
    velocities: np.ndarray
    """(B, N, 3) before the step."""
    phases: list
    """Phases of the step."""
    ends: np.ndarray
    """(B, N, 3) poses after the step."""
    touching: np.ndarray
    """Pairs in contact, see `Motion.touching`."""


@cache
def crowds(n_robots):
    """Return control steps from N_WORLDS runs in C."""
    recorded = []
    steps_of_engine = {}
    move_in_c = MujocoEngine.move

    def move_and_record(engine, bodies, phases, running):
        step = steps_of_engine.get(id(engine), 0) + 1
        steps_of_engine[id(engine)] = step
        poses = bodies.poses.copy()
        velocities = velocities_of(engine, bodies)
        motion = move_in_c(engine, bodies, phases, running)
        if step in AT_STEPS:
            assert running.all()
            assert not motion.fault.any()
            ends = motion.bodies.poses
            recorded.append(Crowd(poses, velocities, phases, ends, motion.touching))
        return motion

    # The runs are those of users; only their steps are recorded.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MujocoEngine, "move", move_and_record)
        scenario = Scenario(
            CONFIG,
            strategy=GENOME,
            robots=n_robots,
            engine=MujocoSettings(1),
            seed=11,
            worlds=N_WORLDS,
            steps=max(AT_STEPS),
        )
        run = Run(scenario, record_worlds=())
        while not run.is_over:
            run.advance()
    assert sum(len(crowd.poses) for crowd in recorded) == len(AT_STEPS) * N_WORLDS
    return recorded


def move_in_planar(impl, crowd):
    """Return the motion of a crowd in the planar engine, at MuJoCo's time step."""
    arena = compile_arena(CONFIG, 1, np.zeros(0))
    if impl == "numba":
        engine = as_mujoco(PlanarEngine(CONFIG, arena, 1))
    else:
        engine = as_mujoco(batch_engine.read_engine(arena, CONFIG, jax.default_backend()))
    bodies = engine.place(crowd.poses, np.ones(crowd.poses.shape[:2], bool))
    velocity = np.asarray(crowd.velocities, bodies.poses.dtype)
    bodies = bodies._replace(velocity=velocity)
    motion = engine.move(bodies, crowd.phases, np.ones(len(crowd.poses), bool))
    return jax.tree.map(np.asarray, motion)


@pytest.mark.parametrize("impl", ["numba", "warp"])
@pytest.mark.parametrize("n_robots", [283, 785])
def test_crowds_of_runs_end_where_mujoco_ends(n_robots, impl):
    """A few pairs may differ with 32 bits, where rounding decides between equal faces."""
    if impl == "warp":
        pytest.importorskip("warp")
    differences = []
    n_touching = []
    for crowd in crowds(n_robots):
        motion = move_in_planar(impl, crowd)
        assert not motion.fault.any()
        differences.append(np.abs(motion.bodies.poses - crowd.ends).max(axis=-1))
        np.testing.assert_array_equal(motion.touching, crowd.touching)
        n_touching += pairs_of(crowd.touching).sum(axis=(1, 2)).tolist()

    differences = np.array(differences)
    n_different = (differences > SMALL_DIFFERENCE).sum()
    print(
        f"{n_robots} robots, {impl}: {differences.max():.1e} mm or rad, "
        f"{n_different} beyond {SMALL_DIFFERENCE} of {differences.size}"
    )
    if impl == "numba":
        assert differences.max() <= ALLOWED
    assert n_different <= 0.01 * differences.size
    assert min(n_touching) > 10
