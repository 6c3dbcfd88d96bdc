"""Closed forms of the times of a trial that need no physics steps.

A ball that hangs while charge flows, and one that flies. Functions of numbers, see
`utils.scalar_backends`, for one trial and for batches. Units of the bench: um, ug, ms, nN, V, fC,
fF, TOhm.
"""

from math import exp, log, sqrt
from typing import NamedTuple

from jaxtyping import Bool

from iswarm_mj.gripper.units import CLEARANCE
from iswarm_mj.utils.arrays import Array, Quantity
from iswarm_mj.utils.scalar_backends import clip, where, whole

MARGIN = 0.03
"""Share of the tool's adhesion by which a ball must be held; with less it is about to leave."""
SLACK = 1.1
"""Factor by which the ball must be held by more than `MARGIN` before a leap."""
REST = 0.2
"""Speed up to which a ball that touches the tool counts as resting [um/ms]."""


class Hanging(NamedTuple):
    """A ball that hangs at rest at the tool, after a physics step."""

    voltage: Quantity
    """Voltage of the tool V, constant [V]."""
    ball_voltage: Quantity
    """Voltage of the ball in that step [V]."""
    charge: Quantity
    """Charge of the ball Q [fC]."""
    to_probe: Quantity
    """Capacitance of the ball to the tool C_t [fF]."""
    to_plate: Quantity
    """Capacitance of the ball to the plate C_p [fF]."""
    leak: Quantity
    """Resistance of the tool's contact R [TOhm]."""
    up: Quantity
    """Pull of the tool's field in that step [nN]."""
    down: Quantity
    """Pull of the plate's field in that step [nN]."""
    adhesion: Quantity
    """Adhesion of the tool [nN]."""
    hold: Quantity
    """Adhesion of the tool, less that of the plate, less the weight [nN]."""


class Leap(NamedTuple):
    """State of a ball after a leap over time; without a leap both times are 0."""

    hung: Quantity
    """Time for which the ball hung [ms]."""
    flown: Quantity
    """Time for which the ball flew [ms]."""
    lift: Quantity
    """Change of the height of the ball [um]."""
    rise: Quantity
    """Upward speed of the ball [um/ms]."""
    charge: Quantity
    """Charge of the ball [fC]."""


def leap(
    ball: Hanging,
    gaps: tuple[Quantity, Quantity],
    velocity: tuple[Quantity, Quantity, Quantity],
    gravity: Quantity,
    limits: tuple[Quantity, Quantity],
    period: Quantity,
) -> Leap:
    """Let charge flow while a ball hangs at rest, or let an uncharged ball fly on its parabola.

    The depth of a contact follows the force that holds the ball. A flight ends at a distance of
    `CLEARANCE` from tool and plate: nearer they pull the ball, farther off they change less than a
    thousandth of its energy at 1 mm/s.

    Args:
        ball: after a physics step.
        gaps: to the face of the tool and to the plate [um].
        velocity: of the ball along x, y, z [um/ms].
        gravity: acceleration [um/ms^2].
        limits: longest times of hanging and of flying [ms]; 0: no such leap.
        period: of which a leap takes a whole multiple [ms].
    """
    tool_gap, plate_gap = gaps
    longest_hanging, longest_flight = limits
    x, y, rise = velocity

    # A ball at rest at the tool hangs.
    is_slow = x * x + y * y + rise * rise < REST**2
    rests = (tool_gap <= 0) & (plate_gap > CLEARANCE) & is_slow
    hanging = _whole_periods(hanging_time(ball, longest_hanging, SLACK), period)
    hung = where(rests, hanging, 0.0)
    charge, depth_share = after_hanging(ball, hung)

    # An uncharged ball that is clear of both surfaces flies.
    is_uncharged = (ball.voltage == 0) & (ball.charge == 0)
    flies = is_uncharged & (tool_gap > CLEARANCE) & (plate_gap > CLEARANCE)
    height = where(flies, tool_gap - CLEARANCE, 1.0)
    depth = where(flies, plate_gap - CLEARANCE, 1.0)
    flight = clip(flight_time(rise, height, depth, gravity), 0.0, longest_flight)
    flown = where(flies, _whole_periods(flight, period), 0.0)

    has_hung = hung > 0
    return Leap(
        hung,
        flown,
        where(has_hung, tool_gap * (1 - depth_share), rise * flown - gravity * flown**2 / 2),
        where(has_hung, 0.0, rise - gravity * flown),
        where(has_hung, charge, ball.charge),
    )


def _whole_periods(time: Quantity, period: Quantity) -> Quantity:
    """Return the largest multiple of a period within a time, up to rounding."""
    return whole(time / period + 1e-3) * period


def _voltage_before(ball: Hanging) -> Quantity:
    """Return the voltage of the ball as the leap begins, (Q + C_t V) / (C_t + C_p)."""
    return (ball.charge + ball.to_probe * ball.voltage) / (ball.to_probe + ball.to_plate)


def _relaxes(ball: Hanging) -> Bool[Array, "..."] | bool:
    """Return whether the ball's voltage is between 0 and the tool's, which it follows."""
    before = _voltage_before(ball)
    was_between = (ball.ball_voltage > 0) & (ball.ball_voltage < ball.voltage)
    return (ball.leak > 0) & was_between & (before > 0) & (before < ball.voltage)


def _pulls_per_volt2(ball: Hanging) -> tuple[Quantity, Quantity]:
    """Return the pulls of tool and plate over the squares of their voltages, a and b."""
    relaxes = _relaxes(ball)
    across = where(relaxes, ball.voltage - ball.ball_voltage, 1.0)
    below = where(relaxes, ball.ball_voltage, 1.0)
    return ball.up / across**2, ball.down / below**2


def _holding_force(ball: Hanging, volts: Quantity) -> Quantity:
    """Return the force that holds the ball at its voltage u, hold + a (V - u)^2 - b u^2."""
    up, down = _pulls_per_volt2(ball)
    return ball.hold + up * (ball.voltage - volts) ** 2 - down * volts**2


def hanging_time(ball: Hanging, limit: Quantity, slack: Quantity) -> Quantity:
    """Return the time until the ball is held with no more than `MARGIN`; 0 if no leap is possible.

    The ball's voltage follows that of the tool, u' = (V - u) / T, T = (C_t + C_p) R, and with it
    falls the force that holds it, F(u) = hold + a (V - u)^2 - b u^2. The time until F(u) = F_0 is
    T ln((V - u_0) / (V - u)), with the root u of the quadratic equation,
    u = (a V^2 + hold - F_0) / (a V + sqrt((a V)^2 - (a - b) (a V^2 + hold - F_0))).

    Args:
        ball: at rest.
        limit: longest time [ms].
        slack: factor by which the ball must be held by more than `MARGIN` at the start.
    """
    start_voltage = _voltage_before(ball)
    least_force = MARGIN * ball.adhesion
    can_leap = _relaxes(ball) & (_holding_force(ball, start_voltage) > slack * least_force)

    # It comes to the voltage of the least force only if it is let go at the tool's own.
    end_voltage = _voltage_of_force(ball, least_force, can_leap=can_leap)
    is_let_go = _holding_force(ball, ball.voltage) <= least_force
    is_ahead = (start_voltage < end_voltage) & (end_voltage < ball.voltage)
    leaves = can_leap & is_let_go & is_ahead

    start_difference = where(leaves, ball.voltage - start_voltage, 1.0)
    end_difference = where(leaves, ball.voltage - end_voltage, 1.0)
    relaxation_time = ball.leak * (ball.to_probe + ball.to_plate)
    time = where(leaves, relaxation_time * log(start_difference / end_difference), limit)
    return where(can_leap, where(time < limit, time, limit), 0.0)


def _voltage_of_force(
    ball: Hanging, force: Quantity, *, can_leap: Bool[Array, "..."] | bool
) -> Quantity:
    """Return the ball's voltage at which a force F_0 holds it, the root u in `hanging_time`.

    Args:
        ball: at rest.
        force: force F_0 [nN].
        can_leap: balls that have such a voltage; that of others is undefined, but finite.
    """
    up, down = _pulls_per_volt2(ball)
    constant = up * ball.voltage**2 + ball.hold - force
    discriminant = (up * ball.voltage) ** 2 - (up - down) * constant
    root = sqrt(where(can_leap & (discriminant > 0), discriminant, 0.0))
    return constant / where(can_leap, up * ball.voltage + root, 1.0)


def after_hanging(ball: Hanging, time: Quantity) -> tuple[Quantity, Quantity]:
    """Return the ball's charge after it hung, and the share of its contact's depth that is left.

    Args:
        ball: before.
        time: for which it hangs [ms].
    """
    before = _voltage_before(ball)
    relaxation = where(_relaxes(ball), ball.leak * (ball.to_probe + ball.to_plate), 1.0)
    volts = ball.voltage + (before - ball.voltage) * exp(-time / relaxation)
    charge = ball.to_plate * volts - ball.to_probe * (ball.voltage - volts)

    force_before = _holding_force(ball, before)
    share = _holding_force(ball, volts) / where(force_before > 0, force_before, 1.0)
    return charge, share


def flight_time(rise: Quantity, above: Quantity, below: Quantity, gravity: Quantity) -> Quantity:
    """Return the time until a ball has risen by `above` or fallen by `below`, whichever is first.

    Args:
        rise: its upward speed v [um/ms].
        above: height h, above 0 [um].
        below: depth d, above 0 [um].
        gravity: acceleration g [um/ms^2].

    Returns:
        2 h / (v + sqrt(v^2 - 2 g h)) if it rises that high, else (v + sqrt(v^2 + 2 g d)) / g [ms].
    """
    reaches = (rise > 0) & (rise**2 > 2 * gravity * above)
    speed_above = sqrt(where(reaches, rise**2 - 2 * gravity * above, 0.0))
    time_up = 2 * above / where(reaches, rise + speed_above, 1.0)

    square_below = rise**2 + 2 * gravity * below
    speed_below = sqrt(where(square_below > 0, square_below, 0.0))
    return where(reaches, time_up, (rise + speed_below) / gravity)
