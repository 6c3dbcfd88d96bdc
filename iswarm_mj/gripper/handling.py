"""Balls and the robots' grippers in the swarm: picking up, carrying and releasing."""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.gripper.attempts import Attempts, Decider, Outcomes, by_balance
from iswarm_mj.gripper.laws.detachment import scattered_work
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.sensors.floor import FloorView
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.rng import draw

_MM = 1e3
"""Millimetres per metre."""


class AttemptStatistics(NamedTuple):
    """Counts and times of the attempts at each of K balls, from the start of the run."""

    attempts: Int[Array, "K"]
    """Number of attempts to pick up the ball."""
    failed_grasps: Int[Array, "K"]
    """Number of attempts to pick up the ball that failed."""
    failed_releases: Int[Array, "K"]
    """Number of attempts to release the ball that failed."""
    releases: Int[Array, "K"]
    """Number of attempts to release the ball."""
    broken_off: Int[Array, "K"]
    """Number of failed attempts without a trial, since neighbours pushed the robot out of reach."""
    postponed: Int[Array, "K"]
    """Number of attempts that were deferred, since all slots of the bench were busy."""
    work_time: Float[Array, "K"]
    """Time that the attempts took on the bench [s]."""
    lost_time: Float[Array, "K"]
    """Time that robots lost at the ball [s]: in failed attempts, including their trials, and while
    attempts were deferred."""
    impact: Float[Array, "K"]
    """Speed of the ball's last landing [m/s]."""
    last_attempt: Float[Array, "K 4"]
    """Last attempt with a trial at the ball; the columns are the fields of `LastAttempt`."""


class LastAttempt(NamedTuple):
    """Conditions of an attempt that statistics keep: numbers of one ball, or arrays (K,)."""

    voltage: Float[Array, "*K"] | float
    """Voltage of the tool [V]."""
    work_tool_object: Float[Array, "*K"] | float
    """Work of adhesion between tool and ball at the air's humidity [J/m^2]."""
    work_object_substrate: Float[Array, "*K"] | float
    """Work of adhesion between ball and floor at the air's humidity [J/m^2]."""
    misalignment: Float[Array, "*K"] | float
    """Lateral offset of the tool's axis from the ball's [m]."""


class Balls(NamedTuple):
    """K solder balls. Each lies on the floor, is held by a robot or has been delivered."""

    position: Float[Array, "K 2"]
    """Position at which the ball lies or hangs [mm]."""
    radius: Float[Array, "K"]
    """Radius [m]."""
    work_tool_object: Float[Array, "K"]
    """Median work of adhesion between tool and ball, at the air's humidity [J/m^2]."""
    work_object_substrate: Float[Array, "K"]
    """Median work of adhesion between ball and floor, at the air's humidity [J/m^2]."""
    is_held: Bool[Array, "K"]
    """True while a robot holds the ball."""
    is_delivered: Bool[Array, "K"]
    """True once the ball was released or dropped over the dump."""
    holder: Int[Array, "K"]
    """Index of the robot that holds the ball, or of the last one that did."""
    was_picked: Bool[Array, "K"]
    """True once the ball was picked up."""
    carried_steps: Int[Array, "K"]
    """Number of control steps for which the ball has been held."""
    wait: Int[Array, "K"]
    """Number of control steps until the attempt at the ball ends; 0 if nobody tries."""
    worker: Int[Array, "K"]
    """Index of the robot that makes the attempt at the ball, or of the last one that did."""
    statistics: AttemptStatistics
    """Statistics of the attempts at each ball."""

    @property
    def is_lying(self) -> Bool[Array, "*B K"]:
        """True where the ball lies on the floor and was not delivered."""
        return ~self.is_held & ~self.is_delivered


def loaded(balls: Balls, n_robots: int) -> Bool[Array, "N"]:
    """Return for each robot whether it holds a ball."""
    return jnp.zeros(n_robots, bool).at[balls.holder].max(balls.is_held)


def working(balls: Balls, n_robots: int) -> Bool[Array, "N"]:
    """Return for each robot whether it stays at an attempt that has not ended."""
    return jnp.zeros(n_robots, bool).at[balls.worker].max(balls.wait > 0)


def carry(balls: Balls, tips: Float[Array, "N 2"]) -> Balls:
    """Move the balls that are held with the tips of their holders [mm]."""
    position = jnp.where(balls.is_held[:, None], tips[balls.holder], balls.position)
    return balls._replace(position=position)


class _Attempting(NamedTuple):
    """Attempts at K balls in this step: which begin, and who makes them."""

    tries_to_lift: Bool[Array, "N"]
    """The robot wants to pick up a ball, which a nearer robot may get."""
    begins: Bool[Array, "K"]
    """An attempt at the ball begins."""
    worker: Int[Array, "K"]
    """Index of the robot that makes the attempt at the ball."""
    duration: Int[Array, "K"]
    """Control steps that an attempt at the ball takes, from its begin to its trial."""
    wait: Int[Array, "K"]
    """Control steps until the attempt ends, unless it is deferred."""


class _Ending(NamedTuple):
    """Attempts at K balls that end in this step."""

    ends: Bool[Array, "K"]
    """The attempt at the ball ends."""
    is_broken_off: Bool[Array, "K"]
    """It ends without a trial, since the robot was pushed away meanwhile."""

    @property
    def has_trial(self) -> Bool[Array, "K"]:
        """The attempt ends by a trial."""
        return self.ends & ~self.is_broken_off


def update_grasps(  # noqa: PLR0913 - arrays of robots and balls that have nothing in common
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
    """Release, pick up and drop balls, as the force balance or the bench decides.

    A robot tries to pick up the ball that it senses if its tool reaches the ball; of several robots
    at one ball the nearest succeeds. A loaded robot tries to release its ball on the dump, and
    wherever it wants to. Where attempts take time, robot and ball are occupied until the attempt
    ends, and its trial takes place then. The attempt is broken off if the robot was pushed away
    meanwhile, so that its tool no longer reaches the ball, or is not over the dump although the
    robot wants to release its ball only there: the attempt fails, and a robot keeps the ball that
    it holds. A deferred attempt is made as the next step begins.

    Args:
        gripper: reach and its error, gap of the release, durations of attempts.
        conditions: voltages of grasp and release, spreads of the works of adhesion.
        balls: K balls; those held are at their holders' tips.
        tips: tips of the N robots' probes [mm].
        view: the floor as the robots sense it.
        picks: robots that pick up dust.
        falls: balls that fall if they are held.
        decider: decides the outcomes of attempts.
        control_period: duration of a control step [s].
        key: draws the works of adhesion and the tool's offset of each attempt.
        voltage: voltage that each robot's capacitor has [V]; None: as much as is asked for.
        releases: robots that release their ball wherever they are; None: over the dump alone.

    Returns:
        The balls, and for each robot whether it failed to pick one up.
    """
    n_robots = len(tips)
    wants_release = jnp.zeros(n_robots, bool) if releases is None else releases

    attempting = _begin_attempts(gripper, balls, tips, view, picks, wants_release, control_period)
    ending = _end_attempts(gripper, balls, tips, view, wants_release, attempting)
    attempts = _describe_attempts(
        gripper=gripper,
        conditions=conditions,
        balls=balls,
        worker=attempting.worker,
        has_trial=ending.has_trial,
        key=key,
        voltage=voltage,
    )
    outcomes = decider(gripper, attempts)

    is_made = ending.ends & ~outcomes.postponed
    has_failed = is_made & ~outcomes.lifted & ~outcomes.released
    lift_failed = has_failed & balls.is_lying

    moved = _move_balls(balls, attempting, outcomes, falls, view.tip_on_dump)
    lost_time = jnp.where(
        has_failed,
        attempting.duration * control_period + outcomes.duration,
        outcomes.postponed * control_period,
    )
    statistics = _count_attempts(
        balls,
        attempts,
        ending,
        outcomes,
        is_made=is_made,
        has_failed=has_failed,
        lost_time=lost_time,
    )

    # The robots that lost to a nearer one fail with it, unless it is still at work.
    is_empty_and_idle = ~loaded(moved, n_robots) & ~working(moved, n_robots)
    fails_to_lift = attempting.tries_to_lift & is_empty_and_idle
    fails_to_lift = fails_to_lift.at[attempting.worker].max(lift_failed)
    return moved._replace(statistics=statistics), fails_to_lift


def _begin_attempts(
    gripper: StaticGripper,
    balls: Balls,
    tips: Float[Array, "N 2"],
    view: FloorView,
    wants_lift: Bool[Array, "N"],
    wants_release: Bool[Array, "N"],
    control_period: float,
) -> _Attempting:
    """Begin attempts to pick up and to release balls, and count down those under way.

    Args:
        gripper: reach, and durations of attempts.
        balls: K balls before the step.
        tips: tips of the N robots' probes [mm].
        view: the floor as the robots sense it.
        wants_lift: robots that pick up dust.
        wants_release: robots that release their ball wherever they are.
        control_period: duration of a control step [s].
    """
    n_robots = len(tips)

    # Idle robots begin to pick up the balls that they reach; `lifter` is N where no robot does.
    is_idle = ~working(balls, n_robots)
    tries_to_lift, lifter = _find_lifters(gripper, balls, tips, view, wants_lift & is_idle)
    lift_begins = lifter < n_robots

    # Holders begin to release: with centre and tip over the dump, or wherever they want to.
    may_release = (view.on_dump & view.tip_on_dump) | wants_release
    release_begins = balls.is_held & may_release[balls.holder] & (balls.wait == 0)

    begins = lift_begins | release_begins
    worker = jnp.where(release_begins, balls.holder, balls.worker)
    worker = jnp.where(lift_begins, lifter, worker).astype(jnp.int32)

    # Durations in control steps.
    lift_duration = _whole_steps(gripper.grasp_time, control_period)
    release_duration = _whole_steps(gripper.release_time, control_period)
    duration = jnp.where(balls.is_held, release_duration, lift_duration)

    # A ball with a wait of 1 ends its attempt in this step and has 0 after it.
    wait = jnp.where(begins, duration, jnp.maximum(balls.wait - 1, 0)).astype(jnp.int32)
    return _Attempting(tries_to_lift, begins, worker, duration, wait)


def _whole_steps(time: float, control_period: float) -> int:
    """Return the number of control steps that a time takes, rounded up; both in seconds."""
    return math.ceil(time / control_period - 1e-9)


def _find_lifters(
    gripper: StaticGripper,
    balls: Balls,
    tips: Float[Array, "N 2"],
    view: FloorView,
    picks: Bool[Array, "N"],
) -> tuple[Bool[Array, "N"], Int[Array, "K"]]:
    """Find the robots that try to pick up a ball, and for each ball the nearest of them.

    Returns:
        The robots that try; and for each ball the index of its robot, the lowest of those equally
        near, N if there is none.
    """
    n_robots = len(tips)
    n_balls = len(balls.radius)

    distance = jnp.linalg.norm(balls.position[view.ball] - tips, axis=-1)
    ball_is_free = balls.wait[view.ball] == 0
    is_within_reach = distance <= gripper.tool_reach * _MM
    tries = view.at_dust & picks & ball_is_free & ~loaded(balls, n_robots) & is_within_reach

    least_distance = jnp.full(n_balls, jnp.inf)
    least_distance = least_distance.at[view.ball].min(jnp.where(tries, distance, jnp.inf))
    is_nearest = tries & (distance == least_distance[view.ball])
    candidate = jnp.where(is_nearest, jnp.arange(n_robots), n_robots)
    return tries, jnp.full(n_balls, n_robots).at[view.ball].min(candidate)


def _end_attempts(
    gripper: StaticGripper,
    balls: Balls,
    tips: Float[Array, "N 2"],
    view: FloorView,
    wants_release: Bool[Array, "N"],
    attempting: _Attempting,
) -> _Ending:
    """Find the attempts that end now, and those of them whose robot was pushed away meanwhile."""
    ends_at_once = attempting.begins & (attempting.duration == 0)
    ends_after_waiting = ~attempting.begins & (balls.wait == 1)
    ends = ends_at_once | ends_after_waiting

    distance = jnp.linalg.norm(balls.position - tips[attempting.worker], axis=-1)
    is_out_of_reach = distance > gripper.tool_reach * _MM
    may_release = view.tip_on_dump[balls.holder] | wants_release[balls.holder]
    was_pushed_away = jnp.where(balls.is_held, ~may_release, is_out_of_reach)
    return _Ending(ends, is_broken_off=ends & ~attempting.begins & was_pushed_away)


def _describe_attempts(
    gripper: StaticGripper,
    conditions: Conditions,
    balls: Balls,
    worker: Int[Array, "K"],
    has_trial: Bool[Array, "K"],
    key: Array,
    voltage: Float[Array, "N"] | None,
) -> Attempts:
    """Draw the conditions of the attempts that have their trial now.

    The works of adhesion are log-normal from attempt to attempt, so that a ball at which an attempt
    fails can be picked up later. In attempts to lift, the tool's place errs normally along both
    axes.
    """
    releases = has_trial & balls.is_held

    asked = jnp.where(balls.is_held, conditions.release_voltage, conditions.grasp_voltage)
    available = asked if voltage is None else jnp.minimum(asked, voltage[worker])

    work_normals, offset_normals = draw(key, balls.radius.shape, n_normal=2).normal
    work_tool_object = scattered_work(
        balls.work_tool_object,
        conditions.spread_tool_object,
        work_normals[0],
    )
    work_object_substrate = scattered_work(
        balls.work_object_substrate, conditions.spread_object_substrate, work_normals[1]
    )
    misalignment = gripper.tool_error * jnp.hypot(*offset_normals)

    return Attempts(
        lifts=has_trial & balls.is_lying,
        releases=releases,
        voltage=available,
        radius=balls.radius,
        work_tool_object=jnp.asarray(work_tool_object),
        work_object_substrate=jnp.asarray(work_object_substrate),
        misalignment=jnp.where(releases, 0.0, misalignment),
    )


def _move_balls(
    balls: Balls,
    attempting: _Attempting,
    outcomes: Outcomes,
    falls: Bool[Array, "K"],
    tip_on_dump: Bool[Array, "N"],
) -> Balls:
    """Give balls that were picked up to their robots, and put down those released or dropped."""
    is_dropped = balls.is_held & falls & ~outcomes.released
    stays_held = balls.is_held & ~outcomes.released & ~is_dropped
    is_held = stays_held | outcomes.lifted
    is_put_down = outcomes.released | is_dropped

    # A deferred attempt ends in the next step; one at a ball that drops is over.
    wait = jnp.where(outcomes.postponed, 1, attempting.wait)
    wait = jnp.where(is_dropped, 0, wait)

    return balls._replace(
        is_held=is_held,
        is_delivered=balls.is_delivered | (is_put_down & tip_on_dump[balls.holder]),
        holder=jnp.where(outcomes.lifted, attempting.worker, balls.holder).astype(jnp.int32),
        was_picked=balls.was_picked | outcomes.lifted,
        carried_steps=balls.carried_steps + is_held,
        wait=wait,
        worker=attempting.worker,
    )


def _count_attempts(
    balls: Balls,
    attempts: Attempts,
    ending: _Ending,
    outcomes: Outcomes,
    *,
    is_made: Bool[Array, "K"],
    has_failed: Bool[Array, "K"],
    lost_time: Float[Array, "K"],
) -> AttemptStatistics:
    """Return the statistics after the attempts of this step.

    Args:
        balls: before the step.
        attempts: what was tried.
        ending: which attempts ended.
        outcomes: of the trials.
        is_made: attempts that ended and were not deferred.
        has_failed: attempts that were made in vain.
        lost_time: time lost at each ball in this step [s].
    """
    statistics = balls.statistics
    last_attempt = LastAttempt(
        voltage=attempts.voltage,
        work_tool_object=attempts.work_tool_object,
        work_object_substrate=attempts.work_object_substrate,
        misalignment=attempts.misalignment,
    )
    return AttemptStatistics(
        attempts=statistics.attempts + (is_made & balls.is_lying),
        failed_grasps=statistics.failed_grasps + (has_failed & balls.is_lying),
        failed_releases=statistics.failed_releases + (has_failed & balls.is_held),
        releases=statistics.releases + (is_made & balls.is_held),
        broken_off=statistics.broken_off + ending.is_broken_off,
        postponed=statistics.postponed + outcomes.postponed,
        work_time=statistics.work_time + outcomes.duration,
        lost_time=statistics.lost_time + lost_time,
        impact=jnp.where(outcomes.impact > 0, outcomes.impact, statistics.impact),
        last_attempt=jnp.where(
            ending.has_trial[:, None],
            jnp.stack(last_attempt, axis=-1),
            statistics.last_attempt,
        ),
    )


class Tried(NamedTuple):
    """An attempt that was made, and its outcome. SI units."""

    ball: int
    """Index of the ball."""
    is_lift: bool
    """True for an attempt to pick up the ball, false for one to release it."""
    succeeded: bool
    """True if the ball was picked up, or was released and stayed on the floor."""
    radius: float
    """Radius of the ball [m]."""
    voltage: float
    """Voltage of the tool [V]."""
    work_tool_object: float
    """Work of adhesion between tool and ball in this attempt, at the air's humidity [J/m^2]."""
    work_object_substrate: float
    """Work of adhesion between ball and floor in this attempt, at the air's humidity [J/m^2]."""
    misalignment: float
    """Lateral offset of the tool's axis from the ball's [m]."""


def attempts_between(before: Balls, after: Balls) -> list[Tried]:
    """Return the attempts of one world in a control step, by balls, without those broken off.

    Args:
        before: the balls before the step, as NumPy arrays.
        after: the balls after it.
    """
    earlier = before.statistics
    later = after.statistics
    is_lift = later.attempts > earlier.attempts
    is_release = later.releases > earlier.releases
    grasp_failed = later.failed_grasps > earlier.failed_grasps
    release_failed = later.failed_releases > earlier.failed_releases
    has_trial = later.broken_off == earlier.broken_off

    tried = []
    for ball in np.flatnonzero((is_lift | is_release) & has_trial):
        conditions = LastAttempt(*later.last_attempt[ball].tolist())
        tried.append(
            Tried(
                ball=int(ball),
                is_lift=bool(is_lift[ball]),
                succeeded=not (grasp_failed[ball] or release_failed[ball]),
                radius=float(after.radius[ball]),
                **conditions._asdict(),
            )
        )
    return tried
