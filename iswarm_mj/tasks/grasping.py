"""Balls in the grippers of robots: how tasks carry, release and pick them up."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.geometry.robot import Robots
from iswarm_mj.gripper.handling import Balls, carry, loaded, update_grasps, working
from iswarm_mj.sensors.floor import probe_tips, sense
from iswarm_mj.tasks.base import Sensed, TaskInputs
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.rng import draw, split
from iswarm_mj.utils.units import mm_from_rd


def update_balls(balls: Balls, inputs: TaskInputs, key: Array) -> tuple[Balls, Sensed]:
    """Carry, release and pick up balls as the forces of the grippers decide.

    Args:
        balls: balls after the previous step.
        inputs: the world as the step begins.
        key: random key; decides which held balls fall, and how strongly balls stick.

    Returns:
        The balls, and what the robots sense.
    """
    n_robots = len(inputs.poses)
    conditions = inputs.conditions
    fall_key, attempt_key = split(key, 2)

    # Move held balls with their robots.
    tip_in_robot = jnp.asarray(inputs.robot.each("probe_tip", n_robots))
    tips = probe_tips(inputs.poses, tip_in_robot)
    carried = carry(balls, tips)

    # Sense what lies under the robots, unless they fail to notice it.
    floor = sense(
        poses=inputs.poses,
        tips=tips,
        balls=carried.position,
        is_lying=carried.is_lying,
        dump_size=mm_from_rd(conditions.dump_size),
        reach=mm_from_rd(conditions.dust_range),
    )
    notices = inputs.notices
    floor = floor._replace(
        on_dump=floor.on_dump & notices,
        tip_on_dump=floor.tip_on_dump & notices,
        at_dust=floor.at_dust & notices,
        ball_vector=jnp.where(jnp.asarray(notices)[..., None], floor.ball_vector, 0.0),
    )

    # Begin and end attempts to pick up and to release balls.
    chance = draw(fall_key, carried.is_held.shape, n_uniform=1).uniform[0][0]
    falls = chance < conditions.drop_rate
    handled, grasp_failed = update_grasps(
        gripper=inputs.config.gripper,
        conditions=conditions,
        balls=carried,
        tips=tips,
        view=floor,
        picks=inputs.picks,
        falls=falls,
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
        is_loaded=loaded(handled, n_robots),
        grasp_failed=grasp_failed,
        is_busy=working(handled, n_robots),
        tool_voltage_squared=_tool_voltage_squared(balls, handled, inputs),
        own={},
    )
    return handled, sensed


def _tool_voltage_squared(before: Balls, after: Balls, inputs: TaskInputs) -> Float[Array, "N"]:
    """Return the sum of V^2 over the attempts of each robot in a step [V^2].

    V is the voltage that the gripper asks for, or less if the robot's capacitor has less.
    """
    available = jnp.inf if inputs.voltage is None else inputs.voltage[after.worker]
    grasp_voltage = jnp.minimum(inputs.conditions.grasp_voltage, available)
    release_voltage = jnp.minimum(inputs.conditions.release_voltage, available)

    new_attempts = after.statistics.attempts - before.statistics.attempts
    new_releases = after.statistics.releases - before.statistics.releases
    of_balls = new_attempts * grasp_voltage**2
    of_balls += new_releases * release_voltage**2
    return jnp.zeros(len(inputs.poses)).at[after.worker].add(of_balls)


def ball_centres(
    balls: Balls,
    poses: Float[Array, "*B N 3"],
    robot: Robots,
) -> Float[Array, "*B K 3"]:
    """Return the positions of the balls' centres; NumPy or JAX.

    Args:
        balls: balls, of which held ones hang at the tips of their robots' probes.
        poses: poses of the robots after they moved, x and y in mm.
        robot: geometry of the robots.

    Returns:
        x, y and z [mm].
    """
    xp = array_module(poses)
    radius = 1e3 * xp.asarray(balls.radius)
    is_held = xp.asarray(balls.is_held)
    tip, tip_height = _probe_tips(poses, xp.asarray(balls.holder), robot)

    xy = xp.where(is_held[..., None], tip, xp.asarray(balls.position))
    z = xp.where(is_held, tip_height - radius, radius)
    return xp.concatenate([xy, z[..., None]], axis=-1)


def _probe_tips(
    poses: Float[Array, "*B N 3"], holder: Int[Array, "*B K"], robot: Robots
) -> tuple[Float[Array, "*B K 2"], Float[Array, "*B K"]]:
    """Return positions and heights of the tips of the robots that hold each ball [mm]."""
    xp = array_module(poses)
    robot_numbers = np.arange(poses.shape[-2])
    tip_ahead, tip_left = robot.each("probe_tip", robot_numbers).T
    ahead = xp.asarray(tip_ahead)[holder]
    left = xp.asarray(tip_left)[holder]
    height = xp.asarray(robot.each("tip_height", robot_numbers))[holder]

    pose = xp.take_along_axis(poses, holder[..., None], axis=-2)
    cos = xp.cos(pose[..., 2])
    sin = xp.sin(pose[..., 2])
    x = pose[..., 0] + cos * ahead - sin * left
    y = pose[..., 1] + sin * ahead + cos * left
    return xp.stack([x, y], axis=-1), height
