"""Closed forms of times of a trial that need no physics steps: a ball that hangs while charge flows, one that flies.

Functions of numbers, see `utils.numbers`, for one trial and for batches. Units of the bench.
"""

from math import exp, log, sqrt
from typing import NamedTuple

from jaxtyping import Bool

from iswarm_mj.gripper.units import CLEARANCE
from iswarm_mj.utils.arrays import Array, Quantity
from iswarm_mj.utils.scalar_backends import clip, where, whole

MARGIN = 0.03
"""Part of the tool's adhesion by which a ball must be held while a leap lasts: with less it is about to leave."""
SLACK = 1.1
"""Factor by which it must be held by more than that before a leap."""
REST = 0.2
"""Speed up to which a ball that touches the tool counts as resting [um/ms]."""


class Hanging(NamedTuple):
    """A ball that hangs at rest at the tool, after a physics step."""

    voltage: Quantity
    """Of the tool, constant."""
    mine: Quantity
    """Voltage of the ball in that step."""
    charge: Quantity
    to_probe: Quantity
    """Capacitance."""
    to_plate: Quantity
    """Capacitance."""
    leak: Quantity
    """Resistance of the tool's contact."""
    up: Quantity
    """Pull of the tool's field in that step."""
    down: Quantity
    """Pull of the plate's field in that step."""
    adhesion: Quantity
    """Of the tool."""
    hold: Quantity
    """Adhesion of the tool, less that of the plate, less the weight."""


class Leap(NamedTuple):
    """Where a ball is after a leap over time; without a leap both times are 0."""

    hung: Quantity
    """Time for which it hung."""
    flown: Quantity
    """Time for which it flew."""
    lift: Quantity
    """Change of its height."""
    rise: Quantity
    """Its upward speed."""
    charge: Quantity


def leap(
    ball: Hanging,
    gaps: tuple[Quantity, Quantity],
    velocity: tuple[Quantity, Quantity, Quantity],
    gravity: Quantity,
    limits: tuple[Quantity, Quantity],
    period: Quantity,
) -> Leap:
    """Let charge flow while a ball hangs at rest, or an uncharged one fly on its parabola until it is near a surface.

    The depth of a contact follows the force that holds the ball. Nearer than `CLEARANCE` the surfaces pull a ball that
    flies; farther off they change less than a thousandth of its energy at 1 mm/s.

    Args:
        ball: after a physics step.
        gaps: to the face of the tool and to the plate.
        velocity: of the ball along x, y, z.
        gravity: acceleration.
        limits: longest times of hanging and of flying; 0: no such leap.
        period: of which a leap takes a whole multiple.
    """
    (above, below), (x, y, rise) = gaps, velocity
    rests = (above <= 0) & (below > CLEARANCE) & (x * x + y * y + rise * rise < REST**2)
    hung = where(rests, _multiple(hanging_time(ball, limits[0], SLACK), period), 0.0)
    charge, share = after_hanging(ball, hung)
    flies = (ball.voltage == 0) & (ball.charge == 0) & (above > CLEARANCE) & (below > CLEARANCE)
    high, low = where(flies, above - CLEARANCE, 1.0), where(flies, below - CLEARANCE, 1.0)
    flown = clip(flight_time(rise, high, low, gravity), 0.0, limits[1])
    flown = where(flies, _multiple(flown, period), 0.0)
    return Leap(
        hung,
        flown,
        where(hung > 0, above * (1 - share), rise * flown - gravity * flown**2 / 2),
        where(hung > 0, 0.0, rise - gravity * flown),
        where(hung > 0, charge, ball.charge),
    )


def _multiple(time: Quantity, period: Quantity) -> Quantity:
    """The multiple of a period that fits into a time."""
    return whole(time / period + 1e-3) * period


def _start(ball: Hanging) -> Quantity:
    """Voltage of the ball as the leap begins."""
    return (ball.charge + ball.to_probe * ball.voltage) / (ball.to_probe + ball.to_plate)


def _relaxes(ball: Hanging) -> Bool[Array, "..."] | bool:
    """Whether the ball's voltage is between 0 and the tool's, which it follows."""
    start = _start(ball)
    return (ball.leak > 0) & (ball.mine > 0) & (ball.mine < ball.voltage) & (start > 0) & (start < ball.voltage)


def _pulls(ball: Hanging) -> tuple[Quantity, Quantity]:
    """Pulls of the two fields over the squares of their voltages."""
    relaxes = _relaxes(ball)
    return (
        ball.up / where(relaxes, ball.voltage - ball.mine, 1.0) ** 2,
        ball.down / where(relaxes, ball.mine, 1.0) ** 2,
    )


def _held(ball: Hanging, volts: Quantity) -> Quantity:
    """Force that holds the ball at the tool when it has this voltage."""
    up, down = _pulls(ball)
    return ball.hold + up * (ball.voltage - volts) ** 2 - down * volts**2


def hanging_time(ball: Hanging, limit: Quantity, slack: Quantity) -> Quantity:
    """Time until the ball is held with no more than `MARGIN`, at most `limit`; 0 if no leap is possible.

    Its voltage follows that of the tool, u' = (V - u) / T, T = (C_t + C_p) R, and with it falls the force that holds
    it, adhesion + a (V - u)^2 - b u^2 - weight.

    Args:
        ball: at rest.
        limit: longest time.
        slack: `MARGIN` is exceeded at the start by this factor at least.
    """
    start, voltage, least, (up, down) = _start(ball), ball.voltage, MARGIN * ball.adhesion, _pulls(ball)
    can = _relaxes(ball) & (_held(ball, start) > slack * least)
    square = up * voltage**2 + ball.hold - least
    inside = (up * voltage) ** 2 - (up - down) * square
    end = square / where(can, up * voltage + sqrt(where(can & (inside > 0), inside, 0.0)), 1.0)
    leaves = can & (_held(ball, voltage) <= least) & (start < end) & (end < voltage)
    share = where(leaves, voltage - start, 1.0) / where(leaves, voltage - end, 1.0)
    time = where(leaves, ball.leak * (ball.to_probe + ball.to_plate) * log(share), limit)
    return where(can, where(time < limit, time, limit), 0.0)


def after_hanging(ball: Hanging, time: Quantity) -> tuple[Quantity, Quantity]:
    """Charge of the ball after this time, and the share of its depth in the tool's contact that is left."""
    start, can = _start(ball), _relaxes(ball)
    relaxation = where(can, ball.leak * (ball.to_probe + ball.to_plate), 1.0)
    volts = ball.voltage + (start - ball.voltage) * exp(-time / relaxation)
    held = _held(ball, start)
    share = _held(ball, volts) / where(held > 0, held, 1.0)
    return ball.to_plate * volts - ball.to_probe * (ball.voltage - volts), share


def flight_time(rise: Quantity, above: Quantity, below: Quantity, gravity: Quantity) -> Quantity:
    """Time until a ball with this upward speed reaches the height `above` or falls by `below`, both above 0."""
    reaches = (rise > 0) & (rise**2 > 2 * gravity * above)
    up = 2 * above / where(reaches, rise + sqrt(where(reaches, rise**2 - 2 * gravity * above, 0.0)), 1.0)
    lowest = rise**2 + 2 * gravity * below
    return where(reaches, up, (rise + sqrt(where(lowest > 0, lowest, 0.0))) / gravity)
