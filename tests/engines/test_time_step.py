"""Servos and contacts follow the time step."""

import numpy as np
import pytest

from iswarm_mj.config.swarm import DriveConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena

MASS = 10.0
"""Mass of the paper's robot [mg]."""
YAW_INERTIA = 20 / 3
"""Yaw inertia of the paper's robot [mg mm^2]."""


@pytest.mark.parametrize("refinement", [1, 7])
@pytest.mark.parametrize(
    "drive",
    [
        DriveConfig(control_period=0.2),
        DriveConfig(turn_substeps=10, walk_substeps=30),
        DriveConfig(),
    ],
)
def test_contacts_take_two_time_steps_and_servos_one(drive, refinement):
    n_robots = 2
    config = SwarmConfig(drive=drive)
    arena = compile_arena(config, n_robots, np.zeros(0), refinement=refinement)
    time_step = drive.timestep / refinement
    assert (arena.model.opt.timestep, arena.refinement) == (time_step, refinement)

    geoms = [*arena.hull, *arena.walls]
    time_constants = [[2 * time_step, 1]] * len(geoms)
    np.testing.assert_allclose(arena.model.geom_solref[geoms], time_constants, rtol=1e-15)

    gains = arena.model.dof_damping[arena.qpos]
    inertias = [[MASS, MASS, YAW_INERTIA]] * n_robots
    np.testing.assert_allclose(gains * time_step, inertias)
