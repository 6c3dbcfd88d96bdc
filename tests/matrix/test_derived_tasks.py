"""Tasks that derive from `Cleaning` see the arena of their world, and drive its boxes.

Units are mm and s.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.mjx import ran

from iswarm_mj import make_env
from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.geometry.obstacles import poses_of_boxes
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.tasks.base import Quantity
from iswarm_mj.tasks.cleaning import CLEANING, Cleaning
from iswarm_mj.tasks.grasping import update_balls

N_ROBOTS = 6
CONFIG = SwarmConfig(
    ArenaConfig(
        size=30.0,
        n_dust=6,
        dust_area_size=4.0,
        dust_area_offset=8.0,
        boxes=(
            (10, 8, 1, 1, 0, 0, 0),
            (10, -8, 1, 1, 0, 0, 0),
            (-10, 8, 1, 1, 0, 1e-5, 0.01),
        ),
    )
)
"""Configuration of an arena with two boxes of mass 0 and one that robots push."""
ENGINES = [
    pytest.param(MujocoSettings(threads=1), marks=pytest.mark.slow),
    PlanarSettings(threads=1),
]
STEP_MM = 2.0
"""Distance by which a gate slides in a step [mm]."""
YIELD_MM = 0.02
"""Largest distance by which a gate gives way to a robot that it pushes [mm]."""
PUSHED_MM = 1.5
"""Largest distance by which robots push a box in a step [mm]."""


class Gates(NamedTuple):
    """State of the task: balls, gates, and what `advance` saw."""

    balls: Balls
    """Balls of cleaning."""
    boxes: np.ndarray
    """Poses that the boxes are to have (3, 3) [mm, mm, rad]."""
    edge: np.ndarray
    """Edge of the arena [rd]."""
    offset: np.ndarray
    """Offset of the dust areas [rd]."""


@dataclass(frozen=True)
class Gated(Cleaning):
    """Cleaning with two gates, boxes of mass 0, that slide away from each other."""

    measured: ClassVar = {
        **Cleaning.measured,
        "edge": Quantity("edge of the arena", "rd"),
        "offset": Quantity("offset of the dust areas", "rd"),
    }

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, balls = CLEANING.lay_out(config, n_robots, rng, shared, cell)
        boxes = poses_of_boxes(config.arena.boxes).astype(np.float32)
        unknown = np.zeros((), np.float32)
        return poses, Gates(balls, boxes, edge=unknown, offset=unknown)

    def advance(self, state: Gates, inputs: Any, key: Any):
        balls, sensed = update_balls(state.balls, inputs, key)

        # The third box has a mass, so that nothing drives it.
        motion = jnp.array([[0.0, STEP_MM, 0.0], [0.0, -STEP_MM, 0.0], [5.0, 5.0, 0.0]])
        gates = Gates(
            balls,
            boxes=inputs.boxes + motion,
            edge=inputs.arena.size,
            offset=inputs.arena.dust_area_offset,
        )
        return gates, sensed

    def drive_boxes(self, state):
        return state.boxes

    def balls(self, state):
        return state.balls

    def progress(self, state):
        return CLEANING.progress(state.balls)

    def reward(self, before, after, inputs):
        return CLEANING.reward(before.balls, after.balls, inputs) + inputs.arena.size

    def metrics(self, state):
        return CLEANING.metrics(state.balls) | {"edge": state.edge, "offset": state.offset}

    def areas(self, config, state):
        return CLEANING.areas(config, state.balls)


def assert_gates_open(before, after, n_steps):
    """Assert that both gates moved apart, and that no robot pushed the other box far.

    Args:
        before: poses of the boxes at first (..., 3, 3).
        after: poses of the boxes after some control steps (..., 3, 3).
        n_steps: number of these steps.
    """
    moved = (np.asarray(after) - np.asarray(before))[..., :2]
    north = np.array([0.0, STEP_MM * n_steps])
    np.testing.assert_allclose(moved[..., 0, :] - north, 0.0, atol=YIELD_MM)
    np.testing.assert_allclose(moved[..., 1, :] + north, 0.0, atol=YIELD_MM)
    assert (np.abs(moved[..., 2, :]) < PUSHED_MM * n_steps).all()


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: engine.name)
def test_worlds_of_a_run_see_their_own_arenas_and_their_gates_open(engine):
    offsets = [8.0, 9.0, 10.0]
    worlds = []
    for index, offset in enumerate(offsets):
        arena = replace(CONFIG.arena, dust_area_offset=offset)
        config = replace(CONFIG, arena=arena)
        worlds.append(World(TYPE1, N_ROBOTS, index=index, config=config))
    scenario = Scenario(CONFIG, task=Gated(), engine=engine, worlds=worlds, steps=3)
    run = Run(scenario, record_worlds=(0, 1, 2))
    record = ran(run)
    metrics = run.metrics()
    assert metrics["edge"].tolist() == [30.0, 30.0, 30.0]
    assert metrics["offset"].tolist() == offsets
    assert_gates_open(run.start.boxes[0], record.boxes[-1], n_steps=3)


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: engine.name)
def test_environments_see_their_own_arena_and_their_gates_open(engine):
    env = make_env(config=CONFIG, task=Gated(), robots=N_ROBOTS, engine=engine, worlds=2)
    state = env.reset(jax.random.split(jax.random.key(0), 2))
    boxes = env.boxes(state)
    for _ in range(3):
        state = env.step(state, jnp.zeros((2, N_ROBOTS, env.action_size)))
    assert state.metrics["edge"].tolist() == [30.0, 30.0]
    assert (state.reward >= 30.0).all()
    assert_gates_open(boxes, env.boxes(state), n_steps=3)


def test_the_page_shows_a_task_its_own_arena_also_after_a_change():
    engine = PlanarSettings(threads=1)
    session = Session(PageScenario(CONFIG, task=Gated(), robots=N_ROBOTS, engine=engine))
    before = session.snapshots[-1].record.boxes[0, 0]
    session.advance()
    session.set("arena.dust_area_offset", 9.0)
    session.advance()
    assert session.lines["edge"][-1] == 30.0
    assert_gates_open(before, session.snapshots[-1].record.boxes[0, 0], n_steps=2)
