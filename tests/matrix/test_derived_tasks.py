"""Tasks that derive from `Cleaning`: they see the arena of their own world, and drive its boxes.
Units: mm, s."""

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

N = 6
CONFIG = SwarmConfig(
    ArenaConfig(
        size=30.0,
        n_dust=6,
        dust_area_size=4.0,
        dust_area_offset=8.0,
        boxes=((10, 8, 1, 1, 0, 0, 0), (10, -8, 1, 1, 0, 0, 0), (-10, 8, 1, 1, 0, 1e-5, 0.01)),
    )
)
ENGINES = [MujocoSettings(threads=1), PlanarSettings(threads=1)]
YIELDS = 0.02
"""A gate gives way by at most this to a robot that it pushes [mm]."""


class Gates(NamedTuple):
    """State of the task: balls, gates, and what `advance` saw."""

    balls: Balls
    boxes: np.ndarray
    """Where they are to be [mm, mm, rad]."""
    edge: np.ndarray
    """Edge of the arena [rd]."""
    offset: np.ndarray
    """Of the dust areas [rd]."""


@dataclass(frozen=True)
class Gated(Cleaning):
    """Cleaning with two gates, boxes of mass 0, that slide away from each other by 2 mm a step."""

    measured: ClassVar = {
        **Cleaning.measured,
        "edge": Quantity("edge of the arena", "rd"),
        "offset": Quantity("offset of the dust areas", "rd"),
    }

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, balls = CLEANING.lay_out(config, n_robots, rng, shared, cell)
        nothing = np.zeros((), np.float32)
        return poses, Gates(
            balls, poses_of_boxes(config.arena.boxes).astype(np.float32), nothing, nothing
        )

    def advance(self, state: Gates, inputs: Any, key: Any):
        balls, sensed = update_balls(state.balls, inputs, key)
        way = jnp.array([[0.0, 2.0, 0.0], [0.0, -2.0, 0.0], [5.0, 5.0, 0.0]])
        return Gates(
            balls, inputs.boxes + way, inputs.arena.size, inputs.arena.dust_area_offset
        ), sensed

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


def check_gates(before, after, steps):
    """Both gates moved apart, and the box that has a mass stayed where no robot pushed it."""
    moved = np.asarray(after) - np.asarray(before)
    north, south = (
        np.broadcast_to([0, side * 2.0 * steps], moved[..., 0, :2].shape) for side in (1, -1)
    )
    np.testing.assert_allclose(moved[..., 0, :2], north, atol=YIELDS)
    np.testing.assert_allclose(moved[..., 1, :2], south, atol=YIELDS)
    assert (np.abs(moved[..., 2, :2]).max(axis=-1) < 1.5 * steps).all()


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: engine.name)
def test_worlds_of_a_run_see_their_own_arenas_and_their_gates_open(engine):
    others = [
        replace(CONFIG, arena=replace(CONFIG.arena, dust_area_offset=offset))
        for offset in (8.0, 9.0, 10.0)
    ]
    worlds = [World(TYPE1, N, index=k, config=config) for k, config in enumerate(others)]
    scenario = Scenario(CONFIG, task=Gated(), engine=engine, worlds=worlds, steps=3)
    run = Run(scenario, record_worlds=(0, 1, 2))
    record = ran(run)
    metrics = run.metrics()
    assert metrics["edge"].tolist() == [30.0] * 3 and metrics["offset"].tolist() == [8.0, 9.0, 10.0]
    check_gates(run.start.boxes[0], record.boxes[-1], 3)


@pytest.mark.parametrize("engine", ENGINES, ids=lambda engine: engine.name)
def test_environments_see_their_own_arena_and_their_gates_open(engine):
    env = make_env(config=CONFIG, task=Gated(), robots=N, engine=engine, worlds=2)
    state = env.reset(jax.random.split(jax.random.key(0), 2))
    before = env.boxes(state)
    for _ in range(3):
        state = env.step(state, jnp.zeros((2, N, env.action_size)))
    assert state.metrics["edge"].tolist() == [30.0, 30.0] and (state.reward >= 30.0).all()
    check_gates(before, env.boxes(state), 3)


def test_the_page_shows_a_task_its_own_arena_also_after_a_change():
    session = Session(
        PageScenario(CONFIG, task=Gated(), robots=N, engine=PlanarSettings(threads=1))
    )
    before = session.snapshots[-1].record.boxes[0, 0]
    session.advance()
    session.set("arena.dust_area_offset", 9.0)
    session.advance()
    assert session.lines["edge"][-1] == 30.0
    check_gates(before, session.snapshots[-1].record.boxes[0, 0], 2)
