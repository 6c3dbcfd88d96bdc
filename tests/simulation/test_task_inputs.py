"""Inputs of a task: they are the values of its own run, wherever these differ from the defaults."""

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

SIZE = 14
CONFIG = SwarmConfig(
    ArenaConfig(
        size=SIZE,
        dump_size=3,
        dust_area_size=3,
        dust_area_offset=4.5,
        n_dust=20,
        obstacles=((4.0, 5.0, 1.0, 0.5, 30.0),),
    ),
    optics=OpticsConfig(error_in_communication=0.2),
    drive=DriveConfig(error_turn=3.0),
)
EXPECTED_SETTINGS = [14, 7, 7, 7, 3, 4.5, 20, 15e-6, 25e-6, 3, 0.2, 3.0, 0.5]
"""Values of `settings_of` in this configuration."""
N_CELLS = 20
"""Cells in a row of the grid that robots are to visit."""


def settings_of(inputs):
    """Return all of the arena, some of the conditions, and one setting that is compiled in."""
    arena = jnp.concatenate([jnp.ravel(jnp.float32(part)) for part in inputs.arena])
    conditions = inputs.conditions
    some = [conditions.dump_size, conditions.error_in_communication, conditions.error_turn]
    return jnp.concatenate([arena, jnp.array([*some, inputs.config.drive.step_length])])


def cells_of(positions, size, xp):
    """Return the cells (row, column) of positions (..., 2) [mm] in an arena of a size [rd]."""
    fraction = positions / (size * RD) + 0.5
    return xp.floor(fraction * N_CELLS).astype(int)


@dataclass(frozen=True)
class Coverage(Task):
    """Robots are to visit all cells of the arena; metrics have the settings that the task sees."""

    measured: ClassVar = {
        "cells": Quantity("visited"),
        **{f"setting_{k}": Quantity("a setting") for k in range(len(EXPECTED_SETTINGS))},
    }

    def lay_out(self, config, n_robots, rng, shared, cell):
        state = {
            "is_visited": np.zeros((N_CELLS, N_CELLS), bool),
            "settings": np.zeros(len(EXPECTED_SETTINGS), np.float32),
        }
        return place_robots(config.arena, n_robots, rng, cell), state

    def goal(self, config, n_robots):
        return N_CELLS**2

    def advance(self, state, inputs, key):
        row, column = cells_of(inputs.poses[:, :2], inputs.arena.size, jnp).T
        state = {
            "is_visited": state["is_visited"].at[row, column].set(True),
            "settings": settings_of(inputs),
        }
        return state, without_balls(len(row))

    def progress(self, state):
        return state["is_visited"].sum(dtype=jnp.int32)

    def metrics(self, state):
        settings = {f"setting_{k}": value for k, value in enumerate(state["settings"])}
        return {"cells": state["is_visited"].sum(), **settings}


def test_a_task_counts_in_the_arena_of_its_run():
    n_robots = 8
    engine = PlanarSettings(1)
    scenario = Scenario(CONFIG, task=Coverage(), robots=n_robots, engine=engine, seed=2, steps=30)
    run = Run(scenario)
    record = ran(run)

    # A task sees poses as steps begin.
    positions = np.concatenate([run.start.poses, record.poses[:-1]])[..., :2]
    cells = cells_of(positions.reshape(-1, 2), SIZE, np)
    n_visited = len({tuple(cell) for cell in cells.tolist()})
    metrics = run.metrics()
    assert n_visited > 4 * n_robots
    assert metrics["cells"].tolist() == [n_visited]

    settings = [metrics[f"setting_{k}"][0] for k in range(len(EXPECTED_SETTINGS))]
    np.testing.assert_allclose(settings, EXPECTED_SETTINGS, rtol=1e-6)
