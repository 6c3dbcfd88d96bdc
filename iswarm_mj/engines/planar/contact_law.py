"""MuJoCo's soft contacts without friction, as functions of numbers.

The symbols are those of MuJoCo's documentation, "Computation", section "Constraint model", and
"Modeling", section "Solver parameters". With the contact's Jacobian J, free acceleration a0, mass
M, reference acceleration aref and regularisation R, a contact force f satisfies

    f >= 0,   J M^-1 J^T f + R f + J a0 - aref >= 0,   and one of both is zero.

Times the time step h this is a condition on the impulse p = h f and on the velocity v' after the
step:

    p >= 0,   J v' + R p + offset >= 0,   offset = -(J v + h aref),   and one of both is zero.

All functions take and return numbers, so that numba and Warp can compile them.
Units: mm, mg, s.
"""

from typing import NamedTuple

from numba.extending import register_jitable

_MIN_VALUE = 1e-15  # mjMINVAL


class ContactLaw(NamedTuple):
    """Softness of contacts, from MuJoCo's `solref` and `solimp`."""

    stiffness: float
    """Stiffness K of the reference acceleration [1/s^2]."""
    damping: float
    """Damping B of the reference acceleration [1/s]."""
    margin: float
    """Distance of the surfaces below which there is a contact [mm]."""
    min_impedance: float
    """Impedance d where a contact begins."""
    max_impedance: float
    """Impedance d of surfaces nearer by at least `width`."""
    width: float
    """Distance below the margin at which the impedance has reached its maximum [mm]."""
    midpoint: float
    """Share of the width at which the impedance's curvature changes sign."""
    power: float
    """Exponent of the impedance's powers."""


@register_jitable
def impedance(distance: float, law: ContactLaw) -> float:
    """Return the impedance d, between 0 and 1, at a distance of the surfaces [mm]."""
    low = law.min_impedance
    high = law.max_impedance
    if low == high or law.width <= _MIN_VALUE:
        return 0.5 * (low + high)

    # Two powers that meet at the midpoint: y rises from 0 to 1 as x does.
    x = min(abs(distance - law.margin) / law.width, 1.0)
    if law.power == 1.0:
        y = x
    elif x <= law.midpoint:
        y = x**law.power / law.midpoint ** (law.power - 1.0)
    else:
        y = 1.0 - (1.0 - x) ** law.power / (1.0 - law.midpoint) ** (law.power - 1.0)
    return low + y * (high - low)


@register_jitable
def regularisation(impedance: float, inverse_weight: float) -> float:
    """Return R / 2 with R = (1 - d) / d times the estimate of J M^-1 J^T [1/mg].

    MuJoCo has two rows with R each, at both rims. One row with R / 2 yields like both together.

    Args:
        impedance: impedance d.
        inverse_weight: sum of both bodies' translational `invweight0`, MuJoCo's estimate [1/mg].
    """
    return max(_MIN_VALUE, (1.0 - impedance) / impedance * inverse_weight) / 2.0


@register_jitable
def offset(
    impedance: float,
    distance: float,
    velocity: float,
    law: ContactLaw,
    timestep: float,
) -> float:
    """Return the velocity -(J v + h aref) with aref = -B J v - K d r and r = distance - margin.

    Args:
        impedance: impedance d.
        distance: distance of the surfaces, negative where they overlap [mm].
        velocity: rate J v at which the distance grows before the step [mm/s].
        law: the contact's law.
        timestep: time step h [s].
    """
    violation = distance - law.margin
    reference = -law.damping * velocity - law.stiffness * impedance * violation
    return -(velocity + timestep * reference)


@register_jitable
def two_impulses(
    p1: float, p2: float, w1: float, w2: float, h11: float, h12: float, h22: float, is_two: bool
) -> tuple[float, float]:
    """Return impulses q >= 0 with w + H (q - p) >= 0, one of both zero in each row.

    This solves the linear complementarity problem of two rows exactly. Only differences from the
    impulses p so far are computed, so that large impulses round no worse than small ones.

    Args:
        p1: impulse of the first row so far [mg mm/s].
        p2: impulse of the second row so far.
        w1: left side of the first row's condition with the impulses so far [mm/s].
        w2: left side of the second row's condition.
        h11: first element of the symmetric, positive definite matrix H = J M^-1 J^T + R [1/mg].
        h12: mixed element of H.
        h22: last element of H.
        is_two: whether there is a second row; otherwise p2 is 0, and so is q2.
    """
    if not is_two:
        return max(0.0, p1 - w1 / h11), 0.0

    # Both rows push.
    inverse = 1.0 / (h11 * h22 - h12 * h12)
    q1 = p1 + (h12 * w2 - h22 * w1) * inverse
    q2 = p2 + (h12 * w1 - h11 * w2) * inverse
    if q1 >= 0.0 and q2 >= 0.0:
        return q1, q2

    # The first row pushes alone, unless that contradicts the second row.
    q1 = max(0.0, p1 - (w1 - h12 * p2) / h11)
    if w2 + h12 * (q1 - p1) - h22 * p2 >= 0.0:
        return q1, 0.0
    return 0.0, max(0.0, p2 - (w2 - h12 * p1) / h22)


@register_jitable
def velocity_change(
    impulse: float,
    angular_impulse: float,
    inverse_mass: float,
    swing: float,
) -> float:
    """Return an upper bound of the change of any point's velocity by two impulses [mm/s].

    Where both contact points nearly coincide, impulses may shift from one to the other within
    rounding. This does not count, since only their sums enter.

    Args:
        impulse: sum of the changes of both impulses [mg mm/s].
        angular_impulse: sum of the changes times their arms [mg mm^2/s].
        inverse_mass: inverse mass of the body [1/mg].
        swing: inverse inertia of the body times the radius of its circumcircle [1/(mg mm)].
    """
    return inverse_mass * abs(impulse) + swing * abs(angular_impulse)
