"""Voltages at which a tip of any profile grasps and releases a ball, and what they cost.

As in `laws.detachment`, with the forces of boundary elements and the adhesion of `tips.adhesion`.
SI units.
"""

import math
from typing import NamedTuple

from iswarm_mj.gripper.laws.adhesion import dmt_pull_off
from iswarm_mj.gripper.laws.detachment import ball_weight
from iswarm_mj.gripper.tips.adhesion import adhesion_radius, pull_ratio
from iswarm_mj.gripper.tips.forces import Solution, Task, solve
from iswarm_mj.gripper.tips.profile import Profile

AIR_STRENGTH = 350e6
"""Field that breaks down air in gaps below 1 um [V/m].

Source: Peschot et al. 2014, gold and ruthenium electrodes.
"""
PASCHEN_MINIMUM = 327.0
"""Voltage below which no avalanche breaks down air, at any gap [V]; Paschen's law."""


class Conditions(NamedTuple):
    """Ball, adhesion and gaps of a grasp and a release."""

    radius: float
    """Radius of the ball [m]."""
    density: float
    """Density of the ball [kg/m^3]."""
    work_tool: float
    """Work of adhesion between tool and ball [J/m^2]."""
    work_plate: float
    """Work of adhesion between plate and ball [J/m^2]."""
    contact_gap: float
    """Effective electrical gap of the touching tool [m]."""
    reach: float
    """Reach of the adhesion, see `tips.adhesion` [m]."""


class TipForces(NamedTuple):
    """What a tip does to a ball, whatever the works of adhesion."""

    adhesion_radius: float
    """Radius of the ball that would adhere to a flat tip as much [m]."""
    pick: Solution
    """In contact, across the effective electrical gap."""
    release: Solution
    """At the tip, above the plate."""


class TipVoltages(NamedTuple):
    """Voltages of a tip and a ball."""

    grasp: float
    """Least voltage that lifts the ball off the plate; 0 where adhesion does [V]."""
    release: float
    """Least voltage that drops it; 0 where its weight does [V]."""
    tool_adhesion: float
    """Pull-off force of the tool [N]."""
    plate_adhesion: float
    """Pull-off force of the plate [N]."""
    weight: float
    """Weight of the ball [N]."""
    grasp_field: float
    """Greatest field in the contact at the grasp voltage [V/m]."""
    release_field: float
    """Greatest field at ball and tip at the release voltage, beside sharp edges [V/m]."""

    @property
    def higher(self) -> float:
        """The higher of both voltages [V]."""
        return max(self.grasp, self.release)

    @property
    def holds(self) -> float:
        """Times its weight that the tool holds the ball by adhesion alone."""
        return self.tool_adhesion / self.weight


def forces_of(
    profile: Profile, conditions: Conditions, gap: float, halvings: int | None = None
) -> TipForces:
    """Return the forces of a tip.

    Args:
        profile: of the tip.
        conditions: ball, contact gap and reach; works do not count.
        gap: between ball and plate at the release [m].
        halvings: of the elements; None: forces are extrapolated, and fields those of one halving.
    """
    return TipForces(
        adhesion_radius=adhesion_radius(profile, conditions.radius, conditions.reach),
        pick=_solved(profile, conditions.radius, conditions.contact_gap, "pick", halvings),
        release=_solved(profile, conditions.radius, gap, "release", halvings),
    )


def released_from(
    forces: TipForces, profile: Profile, conditions: Conditions, gap: float
) -> TipForces:
    """Return the forces of the same tip on the same ball with another gap of the release [m]."""
    release = _solved(profile, conditions.radius, gap, "release", None)
    return forces._replace(release=release)


def _solved(
    profile: Profile, radius: float, gap: float, task: Task, halvings: int | None
) -> Solution:
    """Return force and fields; see `forces_of` for the halvings."""
    if halvings is not None:
        return solve(profile, radius, gap, task, halvings)
    fine = solve(profile, radius, gap, task, 1)
    coarse = solve(profile, radius, gap, task, 0)
    return fine._replace(force=(4 * fine.force - coarse.force) / 3)


def voltages_of(forces: TipForces, conditions: Conditions) -> TipVoltages:
    """Return the voltages that overcome adhesion and weight."""
    tool_adhesion = float(dmt_pull_off(forces.adhesion_radius, conditions.work_tool))
    plate_adhesion = float(dmt_pull_off(conditions.radius, conditions.work_plate))
    weight = float(ball_weight(conditions.radius, conditions.density))

    grasp = _least_voltage(plate_adhesion + weight - tool_adhesion, forces.pick.force)
    release = _least_voltage(tool_adhesion - weight, forces.release.force)
    pick_field = max(forces.pick.ball_field, forces.pick.tip_field)
    release_field = max(forces.release.ball_field, forces.release.tip_field)
    return TipVoltages(
        grasp=grasp,
        release=release,
        tool_adhesion=tool_adhesion,
        plate_adhesion=plate_adhesion,
        weight=weight,
        grasp_field=grasp * pick_field,
        release_field=release * release_field,
    )


def _least_voltage(deficit: float, force: float) -> float:
    """Return the voltage whose force is a deficit [N]; infinite where the force is of other sign."""
    if deficit <= 0:
        return 0.0
    return math.sqrt(deficit / force) if force > 0 else math.inf


def misplaced(
    profile: Profile, forces: TipForces, conditions: Conditions, offset: float
) -> TipForces:
    """Return the forces on a ball beside the axis, approximately.

    Adhesion follows from the gaps around the displaced ball; the pull of a grasp is that on the
    axis times the ratio of both plane-capacitor integrals (`adhesion.pull_ratio`). The force of a
    release acts on the ball's other side, and stays.

    Args:
        profile: of the tip.
        forces: on the axis.
        conditions: ball, contact gap, reach.
        offset: of the ball's centre from the tip's axis [m].
    """
    radius = adhesion_radius(profile, conditions.radius, conditions.reach, offset)
    ratio = pull_ratio(profile, conditions.radius, conditions.contact_gap, offset)
    pick = forces.pick._replace(force=forces.pick.force * ratio)
    return TipForces(radius, pick, forces.release)
