"""What all engines do around their physics steps: phase after phase, faults, worlds that do not run. Units: mm, s."""

import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.engines.base import FreeBodies, Phase, take_phases
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.geometry.walls import corners_of, half_planes
from iswarm_mj.utils.errors import FaultKind

N, BOX = 2, 1
WALLS = half_planes(corners_of([(40.0, 12.0)]))


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_world_takes_no_further_step_after_a_fault(xp):
    """Worlds: one does not run, three fail in the first, the second and no phase, and a robot of the last gets lost."""
    fails = [[1, 1, 0, 0, 0], [0, 0, 1, 0, 0]]
    failed, full, seen = int(FaultKind.SOLVER_FAILED), int(FaultKind.TOO_MANY_PAIRS), []

    def take(bodies, targets, n_substeps, runs, touching):
        failure = xp.where(runs, xp.asarray(fails[len(seen)]) * [failed, full][len(seen)], 0)
        seen.append((n_substeps, np.asarray(runs).tolist(), np.asarray(targets[-1]).tolist()))
        moved = bodies._replace(poses=bodies.poses + targets, velocity=targets)
        return moved, xp.where(runs[:, None, None], touching + n_substeps, touching), failure

    start = np.tile([(0.0, 0, 0), (8.0, 0, 0), (-5.0, 0, 0)], (5, 1, 1))
    start[0, 0, 0], start[4, 1, 1] = np.nan, 4.5
    present = np.tile([True, True, True], (5, 1))
    bodies = FreeBodies(*map(xp.asarray, (start, 0 * start, present)), None, xp.arange(5))
    boxes = xp.asarray(np.tile([0.0, 0.0, 3.0], (5, 1, 1)))
    phases = [Phase(4, lambda poses: 0 * poses + 1.0, boxes), Phase(6, lambda poses: poses - 1.0)]
    running = xp.asarray([False, True, True, True, True])
    motion = take_phases(bodies, phases, running, WALLS, read_robot(), N, take)
    assert [each[:2] for each in seen] == [(4, [False, *[True] * 4]), (6, [False, False, True, True, True])]
    assert seen[0][2] == [[1, 1, 1], [1, 1, 1], [0, 0, 3]]
    assert seen[1][2] == [[0, 0, 0], [8, 4.5, 0], [0, 0, 0]]
    assert motion.fault.tolist() == [0, failed, full, 0, FaultKind.OUTSIDE] and motion.robot[4] == 1
    ends = np.array([(1.0, 1, 1), (17.0, 1, 1), (-5.0, 0, 3)])
    np.testing.assert_array_equal(motion.bodies.poses, [*start[:3], ends, start[4]])
    np.testing.assert_array_equal(motion.bodies.velocity[:3], 0 * start[:3])
    assert motion.bodies.velocity[3, 1, 0] == 8 and motion.touching[:, 0, 0].tolist() == [0, 4, 10, 10, 10]
