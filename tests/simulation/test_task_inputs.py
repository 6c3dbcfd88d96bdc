"""What a task sees of its run: the run's own values, wherever they differ from the default."""

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from support.mjx import ran

from iswarm_mj.config.swarm import ArenaConfig, DriveConfig, OpticsConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.tasks.base import Quantity, Task, without_balls
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.units import RD

ARENA = ArenaConfig(
    size=14, dump_size=3, dust_area_size=3, dust_area_offset=4.5, n_dust=20, obstacles=((4.0, 5.0, 1.0, 0.5, 30.0),)
)
CONFIG = SwarmConfig(ARENA, optics=OpticsConfig(error_in_communication=0.2), drive=DriveConfig(error_turn=3.0))
EXPECTED = [14, 7, 7, 7, 3, 4.5, 20, 15e-6, 25e-6, 3, 0.2, 3.0, 0.5]
"""What `seen` returns in this configuration."""
CELLS, N, STEPS = 20, 8, 30


def seen(inputs):
    """All of the arena, and some of the conditions and of what is compiled in."""
    arena = jnp.concatenate([jnp.ravel(jnp.float32(part)) for part in inputs.arena])
    noise = inputs.conditions
    others = noise.dump_size, noise.error_in_communication, noise.error_turn, inputs.config.drive.step_length
    return jnp.concatenate([arena, jnp.array(others)])


@dataclass(frozen=True)
class Coverage(Task):
    """Robots are to visit all cells of the arena; the reward is the sum of what the task sees."""

    measured: ClassVar = {
        "cells": Quantity("visited"),
        **{f"seen_{k}": Quantity("a setting") for k in range(len(EXPECTED))},
    }

    def lay_out(self, config, n_robots, rng, shared, cell):
        state = np.zeros((CELLS, CELLS), bool), np.zeros(len(EXPECTED), np.float32)
        return place_robots(config.arena, n_robots, rng, cell), state

    def goal(self, config, n_robots):
        return CELLS**2

    def advance(self, state, inputs, key):
        edge = inputs.arena.size * RD
        row, column = jnp.floor((inputs.poses[:, :2] / edge + 0.5) * CELLS).astype(int).T
        state = state[0].at[row, column].set(True), seen(inputs)
        return state, without_balls(len(row))

    def progress(self, state):
        return state[0].sum(dtype=jnp.int32)

    def reward(self, before, after, inputs):
        return jnp.full(len(inputs.poses), seen(inputs).sum())

    def metrics(self, state):
        return {"cells": state[0].sum(), **{f"seen_{k}": value for k, value in enumerate(state[1])}}


ENGINE = PlanarSettings(1)


def test_a_task_counts_in_the_arena_of_its_run():
    run = Run(Scenario(CONFIG, task=Coverage(), robots=N, engine=ENGINE, seed=2, steps=STEPS))
    record = ran(run)
    poses = np.concatenate([run.start.poses, record.poses[:-1]])[..., :2]
    visited = {tuple(cell) for cell in np.floor((poses.reshape(-1, 2) / (14 * RD) + 0.5) * CELLS).astype(int)}
    metrics = run.metrics()
    assert len(visited) > 4 * N and metrics["cells"].tolist() == [len(visited)]
    np.testing.assert_allclose([metrics[f"seen_{k}"][0] for k in range(len(EXPECTED))], EXPECTED, rtol=1e-6)
