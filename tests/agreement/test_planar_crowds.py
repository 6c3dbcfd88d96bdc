"""The planar engine, at MuJoCo's time step, against MuJoCo in C: one control step of crowds of cleaning runs.

`pytest -m slow tests/agreement/test_planar_crowds.py -s` prints what was found.
"""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
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
AT_STEPS, N_WORLDS, ALLOWED = (50, 100, 150, 200, 250, 300), 2, 0.02
CONFIG = SwarmConfig()
GENOME = replace(PRESETS["type1"], use_hop_count=False)
"""Swarms that have not delivered all balls by step 300."""


@cache
def crowds(n_robots):
    """Bodies, set points of the servos, and where MuJoCo ends, of B control steps from N_WORLDS runs in C.

    Returns:
        Poses and velocities (B, N, 3) before, phases' set points for each control step, poses after (B, N, 3) and pairs
        in contact, see `Motion.touching`.
    """
    found, step = [], {}
    in_c = MujocoEngine.move

    def watched(engine, bodies, phases, running):
        step[id(engine)] = now = step.get(id(engine), 0) + 1
        poses, velocities = bodies.poses.copy(), engine._qvel[:, engine._arena.qpos]
        motion = in_c(engine, bodies, phases, running)
        if now in AT_STEPS:
            assert running.all() and not motion.fault.any()
            found.append((poses, velocities, phases, motion.bodies.poses, motion.touching))
        return motion

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MujocoEngine, "move", watched)
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
    assert sum(len(crowd[0]) for crowd in found) == len(AT_STEPS) * N_WORLDS
    return found


def moved(impl, poses, velocities, phases):
    """Motion of these bodies in the planar engine, at MuJoCo's time step."""
    arena, present = compile_arena(CONFIG, 1, np.zeros(0)), np.ones(poses.shape[:2], bool)
    if impl == "numba":
        engine = PlanarEngine(CONFIG, arena, 1)
    else:
        engine = batch_engine.read_engine(arena, CONFIG, jax.default_backend())
    bodies = engine.place(poses, present)
    bodies = bodies._replace(velocity=np.asarray(velocities, bodies.poses.dtype))
    return jax.tree.map(np.asarray, engine.move(bodies, phases, np.ones(len(poses), bool)))


@pytest.mark.parametrize("impl", ["numba", "warp"])
@pytest.mark.parametrize("n_robots", [283, 785])
def test_crowds_of_runs_end_where_mujoco_ends(n_robots, impl):
    if impl == "warp":
        pytest.importorskip("warp")
    distances, n_touching = [], []
    for poses, velocities, phases, ends, touching in crowds(n_robots):
        here = moved(impl, poses, velocities, phases)
        assert not here.fault.any()
        distances.append(np.abs(here.bodies.poses - ends).max(axis=-1))
        np.testing.assert_array_equal(here.touching, touching)
        n_touching += pairs_of(touching).sum(axis=(1, 2)).tolist()
    found = np.array(distances)
    print(
        f"{n_robots} robots, {impl}: {found.max():.1e} mm or rad, {(found > 1e-3).sum()} beyond 0.001 of {found.size}"
    )
    if impl == "numba":
        assert found.max() <= ALLOWED
    assert (found > 1e-3).sum() <= 0.01 * found.size and min(
        n_touching
    ) > 10  # with 32 bits rounding decides between equal faces
