"""Attempts that a swarm made."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.handling import Balls


class Tried(NamedTuple):
    """An attempt that was made, and its outcome. SI units."""

    ball: int
    """Its index."""
    is_lift: bool
    """To lift it; otherwise to release it."""
    succeeded: bool
    """Lifted, or released and stayed on the floor."""
    radius: float
    """Of the ball [m]."""
    voltage: float
    """Of the tool [V]."""
    work_tool_object: float
    """Of this attempt, at the air's humidity [J/m^2]."""
    work_object_substrate: float
    """[J/m^2]"""
    misalignment: float
    """Lateral offset of the tool's axis from the ball's [m]."""


def attempts_between(before: Balls, after: Balls) -> list[Tried]:
    """Attempts of a world in a control step, by balls; those that were broken off are left out.

    Args:
        before: the K balls as the step began, as NumPy arrays.
        after: as it ended.
    """
    lifts, releases = after.attempts > before.attempts, after.releases > before.releases
    failed = (after.failed_grasps > before.failed_grasps) | (after.failed_releases > before.failed_releases)
    made = (lifts | releases) & (after.broken_off == before.broken_off)
    return [
        Tried(int(ball), bool(lifts[ball]), not failed[ball], float(after.radius[ball]), *map(float, after.tried[ball]))
        for ball in np.flatnonzero(made)
    ]
