"""Servos and contacts follow the time step. Units: mm, mg, s."""

import numpy as np
import pytest

from iswarm_mj.config.swarm import DriveConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.utils.units import mm_from_rd

PUSH = 0.03
"""Share of the way to the margin by which contacts push bodies apart in a time step."""
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
def test_contacts_and_servos_are_as_quick_in_time_steps(drive, refinement):
    """A contact ends an approach, and a servo reaches its set point, in one time step."""
    n_robots = 2
    config = SwarmConfig(drive=drive)
    arena = compile_arena(config, n_robots, np.zeros(0), refinement=refinement)
    time_step = drive.timestep / refinement
    assert (arena.model.opt.timestep, arena.refinement) == (time_step, refinement)

    geoms = [*arena.hull, *arena.walls]
    solref = arena.model.geom_solref[geoms]
    largest_impedance = arena.model.geom_solimp[geoms, 1]
    stiffness, damping = -(solref / largest_impedance[:, None] ** [2, 1]).T
    np.testing.assert_allclose(damping * time_step, 1)
    np.testing.assert_allclose(stiffness * time_step**2, PUSH)

    walk = mm_from_rd(drive.step_length) / drive.walk_substeps
    turn = np.deg2rad(drive.max_turn) / drive.turn_substeps / 2
    margin = 1.5 * max(walk, np.sqrt(2) * turn) / refinement  # of two geoms
    np.testing.assert_allclose(2 * arena.model.geom_margin[geoms], margin)
    np.testing.assert_allclose(arena.model.geom_solimp[geoms, 2], margin)

    gains = arena.model.dof_damping[arena.qpos]
    inertias = [[MASS, MASS, YAW_INERTIA]] * n_robots
    np.testing.assert_allclose(gains * time_step, inertias)
