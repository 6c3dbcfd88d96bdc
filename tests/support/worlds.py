"""Beginnings, parameters and states of worlds of cleaning, and where balls are."""

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
    """How world `index` of a seed begins, with the paper's robots."""
    return layouts.draw_start(config, task, read_robot(), n_robots, seed, index, failed_fraction)


def begin_with(monkeypatch, starts):
    """Let worlds begin with these starts, by their indices, however they are; the other ones as
    they are drawn."""
    draw = worlds.draw_start

    def draw_start(config, task, robot, n_robots, seed, index, *more):
        return (
            starts[index]
            if index in starts
            else draw(config, task, robot, n_robots, seed, index, *more)
        )

    monkeypatch.setattr(worlds, "draw_start", draw_start)


def centres(record):
    """Centres of the balls in the record of a run of cleaning, with the paper's robots [mm]."""
    return ball_centres(record.swarm.task, record.poses, read_robot())


def params_of(config, strategy, key, n_robots):
    """Parameters of a world of N robots, which the first delivery finishes."""
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
    """What a task finds in a world of this configuration, in which all robots live and pick
    nothing."""
    there = np.ones(len(poses), bool) if is_present is None else np.asarray(is_present)
    inputs = TaskInputs(
        poses=poses,
        is_present=there,
        is_alive=there,
        picks=np.zeros_like(there),
        team=np.zeros(len(there), np.int32),
        kind=np.zeros(len(there), np.int32),
        conditions=conditions_of(config),
        arena=arena_of(config.arena),
        config=config.static,
        robot=robot,
    )
    return inputs._replace(**more)


def swarm_of(memory, balls, n_robots):
    """State of a world of N living robots."""
    return SwarmState(memory, balls, jnp.ones(n_robots, bool), loaded(balls, n_robots))
