"""Starts, parameters and states of worlds of cleaning, and the places of their balls."""

import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.arena import read_robot
from iswarm_mj.gripper.handling import loaded
from iswarm_mj.sensors.arena import arena_of
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.simulation import layouts, worlds
from iswarm_mj.simulation.state import SwarmState, WorldParams
from iswarm_mj.tasks.base import TaskInputs
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.grasping import ball_centres


def start_of(config, n_robots, seed, index, failed_fraction=0.0, task=CLEANING):
    """Return the start of world `index` of a seed, with the paper's robots."""
    return layouts.draw_start(config, task, read_robot(), n_robots, seed, index, failed_fraction)


def begin_with(monkeypatch, starts):
    """Let worlds begin with these starts, by their indices; the other starts are drawn."""
    draw = worlds.draw_start

    def draw_start(config, task, robot, n_robots, seed, index, *more):
        if index in starts:
            return starts[index]
        return draw(config, task, robot, n_robots, seed, index, *more)

    monkeypatch.setattr(worlds, "draw_start", draw_start)


def centres(record):
    """Return the centres of the balls in a record of cleaning by the paper's robots [mm]."""
    return ball_centres(record.swarm.task, record.poses, read_robot())


def params_of(config, strategy, key, n_robots):
    """Return the parameters of a world of N robots, which the first delivery finishes."""
    return WorldParams(
        strategy=strategy,
        conditions=conditions_of(config),
        key=key,
        is_present=jnp.ones(n_robots, bool),
        goal=jnp.int32(1),
        task=CLEANING,
        arena=arena_of(config.arena),
        is_driven=jnp.zeros(0, bool),
    )


def task_inputs(config, poses, robot, is_present=None, **more):
    """Return the inputs of a task in a world whose robots all live and pick nothing up."""
    n_robots = len(poses)
    is_present = np.ones(n_robots, bool) if is_present is None else np.asarray(is_present)
    inputs = TaskInputs(
        poses=poses,
        is_present=is_present,
        is_alive=is_present,
        picks=np.zeros(n_robots, bool),
        team=np.zeros(n_robots, np.int32),
        kind=np.zeros(n_robots, np.int32),
        conditions=conditions_of(config),
        arena=arena_of(config.arena),
        config=config.static,
        robot=robot,
    )
    return inputs._replace(**more)


def swarm_of(memory, balls, n_robots):
    """Return the state of a world of N living robots."""
    return SwarmState(memory, balls, jnp.ones(n_robots, bool), loaded(balls, n_robots))
