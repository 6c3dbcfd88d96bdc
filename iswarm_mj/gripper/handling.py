"""Balls and the robots' grippers in the swarm: lifting, carrying and releasing."""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.gripper.attempts import Attempts, Decider, by_balance
from iswarm_mj.gripper.laws.detachment import scattered_work
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.sensors.floor import FloorView
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.rng import draw


class Balls(NamedTuple):
    """K solder balls. Each is either lying, held or delivered."""

    position: Float[Array, "K 2"]
    """Where it lies or hangs [mm]."""
    radius: Float[Array, "K"]
    """[m]"""
    work_tool_object: Float[Array, "K"]
    """Median work of adhesion between tool and ball over attempts, at the air's humidity [J/m^2]."""
    work_object_substrate: Float[Array, "K"]
    """Median work of adhesion between ball and floor over attempts, at the air's humidity [J/m^2]."""
    is_held: Bool[Array, "K"]
    is_delivered: Bool[Array, "K"]
    """Whether it was released or dropped over the dump."""
    holder: Int[Array, "K"]
    """The robot that holds it, or the last one that did."""
    was_picked: Bool[Array, "K"]
    """Whether it was picked up at least once."""
    carried_steps: Int[Array, "K"]
    """Control steps for which it has been held."""
    attempts: Int[Array, "K"]
    """Attempts to lift it, so far."""
    failed_grasps: Int[Array, "K"]
    """Attempts to lift it that failed."""
    failed_releases: Int[Array, "K"]
    """Attempts to release it that failed."""
    releases: Int[Array, "K"]
    """Attempts to release it, so far."""
    broken_off: Int[Array, "K"]
    """Failed attempts without a trial, since neighbours pushed the robot out of reach."""
    postponed: Int[Array, "K"]
    """Attempts that were deferred, since all slots of the bench were busy."""
    wait: Int[Array, "K"]
    """Control steps until the attempt at it ends; 0 if nobody tries."""
    worker: Int[Array, "K"]
    """The robot whose attempt it is."""
    work_time: Float[Array, "K"]
    """Time that attempts at it took on the bench [s]."""
    lost_time: Float[Array, "K"]
    """Time that robots lost at it: in failed attempts, their trials included, and while attempts were deferred [s]."""
    impact: Float[Array, "K"]
    """Speed of its last landing [m/s]."""
    tried: Float[Array, "K 4"]
    """Its last attempt: voltage [V], works of adhesion to tool and floor [J/m^2], and misalignment [m]."""

    @property
    def is_lying(self) -> Bool[Array, "*B K"]:
        """Whether it lies on the floor, and was not delivered."""
        return ~self.is_held & ~self.is_delivered


def loaded(balls: Balls, n_robots: int) -> Bool[Array, "N"]:
    """Whether each robot holds a ball."""
    return jnp.zeros(n_robots, bool).at[balls.holder].max(balls.is_held)


def carry(balls: Balls, tips: Float[Array, "N 2"]) -> Balls:
    """Balls after those that are held have moved with the tips of their holders [mm]."""
    return balls._replace(position=jnp.where(balls.is_held[:, None], tips[balls.holder], balls.position))


def working(balls: Balls, n_robots: int) -> Bool[Array, "N"]:
    """Whether each robot stays at an attempt that has not ended."""
    return jnp.zeros(n_robots, bool).at[balls.worker].max(balls.wait > 0)


def handle(
    gripper: StaticGripper,
    conditions: Conditions,
    balls: Balls,
    tips: Float[Array, "N 2"],
    view: FloorView,
    picks: Bool[Array, "N"],
    falls: Bool[Array, "K"],
    *,
    decider: Decider = by_balance,
    control_period: float = 1.0,
    key: Array,
    voltage: Float[Array, "N"] | None = None,
    releases: Bool[Array, "N"] | None = None,
) -> tuple[Balls, Bool[Array, "N"]]:
    """Release, lift and drop balls, as the balance of the forces or the bench decides.

    A robot tries to lift the ball that it senses if its tool reaches the ball; of several robots at one ball the
    nearest succeeds. A loaded robot tries to release its ball on the dump, and wherever it wants to. Where attempts
    take time, the robot and the ball are occupied until they end; then their outcome is found. If the robot was pushed
    meanwhile, so that its tool does not reach the ball any more, or is neither over the dump nor wants to release, the
    attempt is broken off: it fails, and a robot keeps the ball that it holds. An attempt that is deferred is made as
    the next step begins.

    Args:
        gripper: reach and its error, gap of the release, times of attempts.
        conditions: voltages of grasp and release, spreads of the works of adhesion.
        balls: K balls; those held are at their holders' tips.
        tips: of the probes [mm].
        view: the floor as the N robots sense it.
        picks: robots that pick up dust.
        falls: balls that fall if they are held.
        decider: decides the outcomes of attempts.
        control_period: of the robots [s].
        key: draws the works of adhesion and the tool's place of each attempt.
        voltage: that the robots' capacitors have [V]; None: as much as is asked for.
        releases: robots that release their ball wherever they are; None: over the dump alone.

    Returns:
        The balls, and whether each robot failed to lift one.
    """
    n_robots = len(tips)
    idle = ~working(balls, n_robots)
    tries, winner = _tries(gripper, balls, tips, view, picks & idle)
    new_lifts = winner < n_robots
    wants = jnp.zeros(n_robots, bool) if releases is None else releases
    may_release, over_dump = (view.on_dump & view.tip_on_dump) | wants, view.tip_on_dump[balls.holder]
    stays = over_dump | wants[balls.holder]
    new_releases = balls.is_held & may_release[balls.holder] & (balls.wait == 0)
    begins = new_lifts | new_releases
    worker = jnp.where(new_lifts, winner, jnp.where(new_releases, balls.holder, balls.worker)).astype(jnp.int32)
    steps = [math.ceil(time / control_period - 1e-9) for time in (gripper.grasp_time, gripper.release_time)]
    lasts = jnp.where(balls.is_held, steps[1], steps[0])
    wait = jnp.where(begins, lasts, jnp.maximum(balls.wait - 1, 0)).astype(jnp.int32)
    ends = (begins & (lasts == 0)) | (~begins & (balls.wait == 1))
    away = jnp.linalg.norm(balls.position - tips[worker], axis=-1)
    broken = ends & ~begins & jnp.where(balls.is_held, ~stays, away > gripper.tool_reach * 1e3)
    attempts = _attempts(gripper, conditions, balls, worker, ends & ~broken, key, voltage)
    found = decider(gripper, attempts)
    lifts = found.lifted
    dropped = balls.is_held & falls & ~found.released
    is_held = (balls.is_held & ~found.released & ~dropped) | lifts
    made = ends & ~found.postponed
    failed = made & ~lifts & ~found.released
    works = attempts.work_tool_object, attempts.work_object_substrate
    numbers = jnp.stack([attempts.voltage, *works, attempts.misalignment], axis=-1)
    not_lifted = failed & balls.is_lying
    lost = jnp.where(failed, lasts * control_period + found.duration, found.postponed * control_period)
    balls = balls._replace(
        is_held=is_held,
        is_delivered=balls.is_delivered | ((found.released | dropped) & over_dump),
        holder=jnp.where(lifts, worker, balls.holder).astype(jnp.int32),
        was_picked=balls.was_picked | lifts,
        carried_steps=balls.carried_steps + is_held,
        attempts=balls.attempts + (made & balls.is_lying),
        failed_grasps=balls.failed_grasps + not_lifted,
        failed_releases=balls.failed_releases + (failed & balls.is_held),
        releases=balls.releases + (made & balls.is_held),
        broken_off=balls.broken_off + broken,
        postponed=balls.postponed + found.postponed,
        wait=jnp.where(dropped, 0, jnp.where(found.postponed, 1, wait)),
        worker=worker,
        work_time=balls.work_time + found.duration,
        lost_time=balls.lost_time + lost,
        impact=jnp.where(found.impact > 0, found.impact, balls.impact),
        tried=jnp.where((ends & ~broken)[:, None], numbers, balls.tried),
    )
    in_vain = tries & ~loaded(balls, n_robots) & ~working(balls, n_robots)
    return balls, in_vain.at[worker].max(not_lifted)


def _attempts(
    gripper: StaticGripper,
    conditions: Conditions,
    balls: Balls,
    worker: Int[Array, "K"],
    ends: Bool[Array, "K"],
    key: Array,
    voltage: Float[Array, "N"] | None,
) -> Attempts:
    """What is tried at the balls whose attempts end now, by these robots.

    The works of adhesion are log-normal from attempt to attempt, so that a ball at which one fails can be lifted later.
    """
    releases = ends & balls.is_held
    asked = jnp.where(balls.is_held, conditions.release_voltage, conditions.grasp_voltage)
    works, places = draw(key, balls.radius.shape, n_normal=2).normal
    miss = gripper.tool_error * jnp.hypot(*places)
    return Attempts(
        ends & balls.is_lying,
        releases,
        asked if voltage is None else jnp.minimum(asked, voltage[worker]),
        balls.radius,
        jnp.asarray(scattered_work(balls.work_tool_object, conditions.spread_tool_object, works[0])),
        jnp.asarray(scattered_work(balls.work_object_substrate, conditions.spread_object_substrate, works[1])),
        jnp.where(releases, 0.0, miss),
    )


def _tries(
    gripper: StaticGripper, balls: Balls, tips: Float[Array, "N 2"], view: FloorView, picks: Bool[Array, "N"]
) -> tuple[Bool[Array, "N"], Int[Array, "K"]]:
    """Which robots try to lift a ball, and for each ball the nearest of them, the one of lowest index; N if none."""
    n_robots, n_balls = len(tips), len(balls.radius)
    gap = jnp.linalg.norm(balls.position[view.ball] - tips, axis=-1)
    free = balls.wait[view.ball] == 0
    tries = view.at_dust & picks & free & ~loaded(balls, n_robots) & (gap <= gripper.tool_reach * 1e3)
    nearest = jnp.full(n_balls, jnp.inf).at[view.ball].min(jnp.where(tries, gap, jnp.inf))
    first = tries & (gap == nearest[view.ball])
    robots = jnp.where(first, jnp.arange(n_robots), n_robots)
    return tries, jnp.full(n_balls, n_robots).at[view.ball].min(robots)


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
    """Attempts of a world in a control step, by balls; those that were broken off are left out. Arrays are NumPy's."""
    lifts, releases = after.attempts > before.attempts, after.releases > before.releases
    failed = (after.failed_grasps > before.failed_grasps) | (after.failed_releases > before.failed_releases)
    made = (lifts | releases) & (after.broken_off == before.broken_off)
    return [
        Tried(int(ball), bool(lifts[ball]), not failed[ball], float(after.radius[ball]), *map(float, after.tried[ball]))
        for ball in np.flatnonzero(made)
    ]
