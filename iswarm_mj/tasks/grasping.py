"""Balls of a task in the grippers of robots: carried, released and picked up, and where their centres are."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from iswarm_mj.geometry.robot import Robots
from iswarm_mj.gripper.handling import Balls, carry, loaded, update_grasps, working
from iswarm_mj.sensors.floor import probe_tips, sense
from iswarm_mj.tasks.base import Sensed, TaskInputs
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.rng import draw, split
from iswarm_mj.utils.units import mm_from_rd


def update_balls(balls: Balls, inputs: TaskInputs, key: Array) -> tuple[Balls, Sensed]:
    """Carry, release and pick up balls as the forces of the grippers decide; return what robots sense, too.

    Args:
        balls: from the step before.
        inputs: the world as the step begins.
        key: decides which held balls fall, and how strongly balls stick in each attempt.
    """
    conditions, gripper, n_robots = inputs.conditions, inputs.config.gripper, len(inputs.poses)
    tips = probe_tips(inputs.poses, jnp.asarray(inputs.robot.each("probe_tip", n_robots)))
    before = balls
    balls = carry(balls, tips)
    dump_size, reach = mm_from_rd(conditions.dump_size), mm_from_rd(conditions.dust_range)
    floor = sense(inputs.poses, tips, balls.position, balls.is_lying, dump_size, reach)
    floor = floor._replace(
        on_dump=floor.on_dump & inputs.notices,
        tip_on_dump=floor.tip_on_dump & inputs.notices,
        at_dust=floor.at_dust & inputs.notices,
        ball_vector=jnp.where(jnp.asarray(inputs.notices)[..., None], floor.ball_vector, 0.0),
    )
    fall_key, attempt_key = split(key, 2)
    falls = draw(fall_key, balls.is_held.shape, n_uniform=1).uniform[0][0] < conditions.drop_rate
    balls, grasp_failed = update_grasps(
        gripper,
        conditions,
        balls,
        tips,
        floor,
        inputs.picks,
        falls,
        decider=inputs.decide_attempts,
        control_period=inputs.config.drive.control_period,
        key=attempt_key,
        voltage=inputs.voltage,
        releases=inputs.releases,
    )
    sensed = Sensed(
        at_dust=floor.at_dust,
        ball_vector=floor.ball_vector,
        on_dump=floor.on_dump,
        is_loaded=loaded(balls, n_robots),
        grasp_failed=grasp_failed,
        is_busy=working(balls, n_robots),
        tool_voltage_squared=_voltage_squared(before, balls, inputs),
        own={},
    )
    return balls, sensed


def _voltage_squared(before: Balls, after: Balls, inputs: TaskInputs) -> Float[Array, "N"]:
    """Sum of V^2 over the attempts of each robot in a step; V is what was asked for, or all that its capacitor has."""
    most = jnp.inf if inputs.voltage is None else inputs.voltage[after.worker]
    lifts = after.statistics.attempts - before.statistics.attempts
    releases = after.statistics.releases - before.statistics.releases
    squares = lifts * jnp.minimum(inputs.conditions.grasp_voltage, most) ** 2
    squares += releases * jnp.minimum(inputs.conditions.release_voltage, most) ** 2
    return jnp.zeros(len(inputs.poses)).at[after.worker].add(squares)


def ball_centres(balls: Balls, poses: Float[Array, "*B N 3"], robot: Robots) -> Float[Array, "*B K 3"]:
    """Positions of the balls' centres after the robots moved to `poses` [mm]."""
    xp, numbers = array_module(poses), np.arange(poses.shape[-2])
    radius, held, holder, position = (
        xp.asarray(a) for a in (balls.radius, balls.is_held, balls.holder, balls.position)
    )
    at = xp.take_along_axis(poses, holder[..., None], axis=-2)
    c, s = xp.cos(at[..., 2]), xp.sin(at[..., 2])
    x, y = (xp.asarray(values)[holder] for values in robot.each("probe_tip", numbers).T)
    tip = xp.stack([at[..., 0] + c * x - s * y, at[..., 1] + s * x + c * y], axis=-1)
    xy = xp.where(held[..., None], tip, position)
    height = xp.where(held, xp.asarray(robot.each("tip_height", numbers))[holder] - 1e3 * radius, 1e3 * radius)
    return xp.concatenate([xy, height[..., None]], axis=-1)
