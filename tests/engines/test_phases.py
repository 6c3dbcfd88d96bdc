"""Phases of a motion, the same in all engines: steps, faults, worlds that do not run.

Units: mm, s.
"""

import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.engines.base import FreeBodies, Phase, take_phases
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.geometry.walls import corners_of, half_planes
from iswarm_mj.utils.errors import FaultKind

N_ROBOTS = 2
N_WORLDS = 5
WALLS = half_planes(corners_of([(40.0, 12.0)]))

FAILED = int(FaultKind.SOLVER_FAILED)
FULL = int(FaultKind.TOO_MANY_PAIRS)
FAULTS_OF_PHASES = [[FAILED, FAILED, 0, 0, 0], [0, 0, FULL, 0, 0]]
"""Fault of each world in the first phase, and in the second."""
IS_RUNNING = [False, True, True, True, True]

START = np.tile([(0.0, 0, 0), (8.0, 0, 0), (-5.0, 0, 0)], (N_WORLDS, 1, 1))
"""Poses of two robots and a box in each world."""
START[0, 0, 0] = np.nan
START[4, 1, 1] = 4.5


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_world_takes_no_further_step_after_a_fault(xp):
    """The first world does not run; the next two fail in a phase, and the last loses a robot."""
    calls = []

    def step_bodies(bodies, targets, phase, runs, touching):
        """Move bodies by their targets, and fail in some worlds."""
        fault = xp.where(runs, xp.asarray(FAULTS_OF_PHASES[len(calls)]), 0)
        calls.append(
            (phase.n_substeps, np.asarray(runs).tolist(), np.asarray(targets[-1]).tolist())
        )
        stepped = bodies._replace(poses=bodies.poses + targets, velocity=targets)
        touching = xp.where(runs[:, None, None], touching + phase.n_substeps, touching)
        return stepped, touching, fault

    bodies = FreeBodies(
        poses=xp.asarray(START),
        velocity=xp.asarray(0 * START),
        is_present=xp.ones((N_WORLDS, 3), bool),
        overlap=None,
        work=xp.arange(N_WORLDS),
    )
    velocity_of_boxes = xp.asarray(np.tile([0.0, 0.0, 3.0], (N_WORLDS, 1, 1)))
    phases = [
        Phase(4, lambda poses: 0 * poses + 1.0, velocity_of_boxes),
        Phase(6, lambda poses: poses - 1.0),
    ]
    motion = take_phases(
        bodies=bodies,
        phases=phases,
        is_running=xp.asarray(IS_RUNNING),
        walls=WALLS,
        robot=read_robot(),
        n_robots=N_ROBOTS,
        step_bodies=step_bodies,
    )

    # Worlds that failed do not run in the second phase; targets are those of the last world.
    first, second = calls
    assert first == (4, IS_RUNNING, [[1, 1, 1], [1, 1, 1], [0, 0, 3]])
    assert second == (6, [False, False, True, True, True], [[0, 0, 0], [8, 4.5, 0], [0, 0, 0]])

    # Worlds with a fault, and the one that does not run, keep their bodies.
    assert motion.fault.tolist() == [0, FAILED, FULL, 0, FaultKind.OUTSIDE]
    assert motion.robot[4] == 1
    moved = np.array([(1.0, 1, 1), (17.0, 1, 1), (-5.0, 0, 3)])
    np.testing.assert_array_equal(motion.bodies.poses, [*START[:3], moved, START[4]])
    np.testing.assert_array_equal(motion.bodies.velocity[:3], 0 * START[:3])
    assert motion.bodies.velocity[3, 1, 0] == 8
    assert motion.touching[:, 0, 0].tolist() == [0, 4, 10, 10, 10]
