"""MuJoCo's soft contacts without friction, as functions of numbers.

The symbols are those of MuJoCo's documentation, "Computation", section "Constraint model", and "Modeling", section
"Solver parameters". With the contact's Jacobian J, free acceleration a0, mass M, reference acceleration aref and
regularisation R, a contact force f satisfies

    f >= 0,   J M^-1 J^T f + R f + J a0 - aref >= 0,   and one of both is zero.

Times the time step h this is a condition on the impulse p = h f and on the velocity v' after the step:

    p >= 0,   J v' + R p + offset >= 0,   offset = -(J v + h aref),   and one of both is zero.

All functions take and return numbers, so that any compiler of Python functions can compile them. Units: mm, mg, s.
"""

from typing import NamedTuple

from numba.extending import register_jitable

_MIN_VALUE = 1e-15  # mjMINVAL


class ContactLaw(NamedTuple):
    """Softness of the contacts of two kinds of body; the numbers come from MuJoCo's `solref` and `solimp`."""

    stiffness: float
    """K, of the reference acceleration [1/s^2]."""
    damping: float
    """B, likewise [1/s]."""
    min_impedance: float
    """Impedance d where the surfaces just touch."""
    max_impedance: float
    """Impedance d from an overlap of `width` on."""
    width: float
    """[mm]"""
    midpoint: float
    """Share of the width at which the impedance's curvature changes its sign."""
    power: float
    """Of the impedance's polynomials."""


@register_jitable
def impedance(distance: float, law: ContactLaw) -> float:
    """Impedance d of a contact at this distance of the surfaces [mm], between 0 and 1."""
    low, high = law.min_impedance, law.max_impedance
    if low == high or law.width <= _MIN_VALUE:
        return 0.5 * (low + high)
    x = min(abs(distance) / law.width, 1.0)
    if law.power == 1.0:
        y = x
    elif x <= law.midpoint:
        y = x**law.power / law.midpoint ** (law.power - 1.0)
    else:
        y = 1.0 - (1.0 - x) ** law.power / (1.0 - law.midpoint) ** (law.power - 1.0)
    return low + y * (high - low)


@register_jitable
def regularisation(impedance: float, inverse_weight: float) -> float:
    """R = (1 - d) / d times the estimate of J M^-1 J^T [1/mg], of one row in place of the two at both rims.

    Each of the two rows would have R; together they yield like one with R / 2.

    Args:
        impedance: d.
        inverse_weight: sum of both bodies' translational `invweight0`, MuJoCo's estimate [1/mg].
    """
    return max(_MIN_VALUE, (1.0 - impedance) / impedance * inverse_weight) / 2.0


@register_jitable
def offset(impedance: float, distance: float, velocity: float, law: ContactLaw, timestep: float) -> float:
    """Velocity -(J v + h aref) with the reference acceleration aref = -B J v - K d r [mm/s].

    Args:
        impedance: d.
        distance: r of the surfaces, negative where they overlap [mm].
        velocity: J v, at which the distance grows before the step [mm/s].
        law: of the contact.
        timestep: h [s].
    """
    reference = -law.damping * velocity - law.stiffness * impedance * distance
    return -(velocity + timestep * reference)


@register_jitable
def two_impulses(
    p1: float, p2: float, w1: float, w2: float, h11: float, h12: float, h22: float, is_two: bool
) -> tuple[float, float]:
    """Impulses q >= 0 with w + H (q - p) >= 0, one of both zero in each row: a linear complementarity problem, exactly.

    Only differences from the impulses p so far are computed, so that large impulses round no worse than small ones.

    Args:
        p1: impulse of the first row so far [mg mm/s].
        p2: likewise of the second row.
        w1: left side of the first row's condition with the impulses so far [mm/s].
        w2: likewise of the second row.
        h11: of the symmetric, positive definite matrix H = J M^-1 J^T + R [1/mg].
        h12: likewise.
        h22: likewise.
        is_two: there is a second row; otherwise p2 is 0, and so is its new impulse.
    """
    if not is_two:
        return max(0.0, p1 - w1 / h11), 0.0
    inverse = 1.0 / (h11 * h22 - h12 * h12)
    q1, q2 = p1 + (h12 * w2 - h22 * w1) * inverse, p2 + (h12 * w1 - h11 * w2) * inverse
    if q1 >= 0.0 and q2 >= 0.0:
        return q1, q2
    q1 = max(0.0, p1 - (w1 - h12 * p2) / h11)
    if w2 + h12 * (q1 - p1) - h22 * p2 >= 0.0:
        return q1, 0.0
    return 0.0, max(0.0, p2 - (w2 - h12 * p1) / h22)


@register_jitable
def velocity_change(
    d1: float,
    d2: float,
    arm1: float,
    arm2: float,
    lever1: float,
    lever2: float,
    mass1: float,
    swing1: float,
    mass2: float,
    swing2: float,
) -> float:
    """By how much two impulses at most change the velocity of a point of either body [mm/s].

    Where both points nearly coincide, impulses may shift from one to the other within rounding; this does not count.

    Args:
        d1: change of the first row's impulse [mg mm/s].
        d2: likewise of the second row.
        arm1: of the first row, at the first body [mm].
        arm2: likewise of the second row.
        lever1: of the first row, at the second body [mm].
        lever2: likewise of the second row.
        mass1: inverse mass of the first body [1/mg].
        swing1: its inverse inertia times its radius [1/(mg mm)].
        mass2: inverse mass of the second body.
        swing2: likewise.
    """
    push = abs(d1 + d2)
    first = mass1 * push + swing1 * abs(arm1 * d1 + arm2 * d2)
    return max(first, mass2 * push + swing2 * abs(lever1 * d1 + lever2 * d2))
