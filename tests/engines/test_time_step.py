"""Servos and contacts follow the time step."""

import numpy as np
import pytest

from iswarm_mj.config.swarm import DriveConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena


@pytest.mark.parametrize("refinement", [1, 7])
@pytest.mark.parametrize(
    "drive", [DriveConfig(control_period=0.2), DriveConfig(turn_substeps=10, walk_substeps=30), DriveConfig()]
)
def test_contacts_take_two_time_steps_and_servos_one(drive, refinement):
    arena = compile_arena(SwarmConfig(drive=drive), 2, np.zeros(0), refinement=refinement)
    model, h = arena.model, drive.timestep / refinement
    assert (model.opt.timestep, arena.refinement) == (h, refinement)
    np.testing.assert_allclose(model.geom_solref[[*arena.hull, *arena.walls]], [[2 * h, 1]] * 6, rtol=1e-15)
    np.testing.assert_allclose(model.dof_damping[arena.qpos] * h, [[10, 10, 20 / 3]] * 2)
