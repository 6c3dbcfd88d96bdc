"""Whole runs on MuJoCo in C, of which all worlds are recorded; and scripted strategies.

Programs are compiled for each number of worlds and of robots: N robots in one or three worlds share
theirs.
"""

from dataclasses import dataclass
from itertools import count
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.controller import RobotMemory
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.tasks.grasping import ball_centres
from iswarm_mj.utils.units import RD
from support.mujoco import spoil as spoil_steps

N = 30
"""Robots of a world."""


def run_of(config, genome=PRESETS["type1"], n_robots=N, steps=200, *, threads=1, **settings):
    """Return a run of small swarms, of which all worlds are recorded.

    Args:
        config: of all worlds.
        genome: of all worlds, unless `strategy` has a first axis of worlds.
        n_robots: N.
        steps: control steps at most.
        threads: of MuJoCo.
        settings: further fields of the scenario; `record_worlds` and `capacity` go to `Run`, and
            `failed_fraction` to each world.
    """
    options_of_run = {}
    for name in ("record_worlds", "capacity"):
        if name in settings:
            options_of_run[name] = settings.pop(name)

    failed_fraction = settings.pop("failed_fraction", 0.0)
    if failed_fraction:
        seed = settings.pop("seed", 0)
        indices = range(settings.pop("worlds", 1))
        settings["worlds"] = [
            World(genome, n_robots, seed, index, failed_fraction) for index in indices
        ]

    settings.setdefault("strategy_per_world", "strategy" in settings)
    settings.setdefault("strategy", genome)
    scenario = Scenario(
        config,
        robots=n_robots,
        steps=steps,
        engine=MujocoSettings(threads),
        **settings,
    )
    return Run(scenario, **{"record_worlds": range(scenario.n_worlds), **options_of_run})


def records(run):
    """Yield the records (W, ...) of the control steps that are left."""
    while not run.is_over:
        yield first_step(run.advance())


def first_step(record):
    """Return the first step (W, ...) of records (T, W, ...)."""
    return jax.tree.map(lambda values: values[0], record)


def loop_of(run):
    """Return the loop of a run, which no user needs: tests that break or replace parts of it do."""
    return run._loop


def shards_of(run):
    """Return the shards of a run on the host, each with the slice of its worlds."""
    loop = loop_of(run)
    return list(zip(loop._slices, loop._shards, strict=True))


def engine_of(run):
    """Return the engine of the first world, and of those of the same shard."""
    engine, _ = engine_and_place(run, 0)
    return engine


def engine_and_place(run, world):
    """Return the engine of a world on the host, and the place of the world in it."""
    for worlds, shard in shards_of(run):
        if worlds.start <= world < worlds.stop:
            return shard.engine, world - worlds.start
    raise ValueError(f"the run has no world {world}")


def poses_of(run):
    """Return the poses of the robots of all worlds (B, N, 3)."""
    return run.arrays()[1].bodies.poses


def end_of(run):
    """Return poses and measures at the end of a run."""
    for _ in records(run):
        pass
    return poses_of(run), [run.measures(world) for world in range(len(run.worlds))]


def check_balls(run, record):
    """Check that each ball lies on the floor, hangs at the tip of a robot, or is in the dump."""
    centres = ball_centres(record.swarm.task, record.poses, run.robot)
    for world in range(run.settings.n_worlds):
        balls = jax.tree.map(lambda values, world=world: values[world], record.swarm.task)
        check_balls_of_world(run, balls, record.poses[world], centres[world])


def check_balls_of_world(run, balls, poses, centres):
    """Check the balls of a world, whose robots are at poses (N, 3) and balls at centres (K, 3)."""
    is_held = balls.is_held
    is_delivered = balls.is_delivered
    places = np.stack([balls.is_lying, is_held, is_delivered])
    np.testing.assert_array_equal(places.sum(axis=0), np.ones(run.config.arena.n_dust))

    # Those held hang at tips, one a robot.
    holders = balls.holder[is_held]
    assert len(set(holders)) == is_held.sum()
    x, y, yaw = poses[holders].T
    ahead, beside = run.robot.probe_tip
    tip_x = x + ahead * np.cos(yaw) - beside * np.sin(yaw)
    tip_y = y + ahead * np.sin(yaw) + beside * np.cos(yaw)
    np.testing.assert_allclose(centres[is_held, :2].T, [tip_x, tip_y], atol=1e-5)
    assert (centres[is_held, 2] < run.robot.tip_height).all()

    # All others lie on the floor, those delivered in the dump.
    half_dump = run.config.arena.dump_size / 2 * RD
    assert np.abs(centres[is_delivered, :2]).max(initial=0.0) <= half_dump + 1e-4
    radius = 1e3 * balls.radius[~is_held]
    np.testing.assert_allclose(centres[~is_held, 2], radius, rtol=1e-6)


def spoil(run, step, world, robot, value=1e3):
    """Put a robot of a world at x = `value` in the middle of a control step, counted from 1."""
    engine, place = engine_and_place(run, world)
    move = engine.move
    steps = count(1)

    def move_and_spoil(*arguments):
        if next(steps) == step:
            spoil_steps(engine, place, robot, value)
        return move(*arguments)

    engine.move = move_and_spoil


class CountingMemory(NamedTuple):
    """The paper's memory, and the number of control steps so far (N,)."""

    inner: RobotMemory
    age: jax.Array

    @property
    def dust(self):
        return self.inner.dust

    @property
    def dump(self):
        return self.inner.dump

    @property
    def is_scout(self):
        return self.inner.is_scout


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Scripted(Strategy):
    """The paper's strategy up to a control step, from which on some robots get a fixed command."""

    inner: VectorStrategy
    step: jax.Array
    """First control step of the command, from 1."""
    robot: jax.Array
    """Robot that gets the command; -1 for all."""
    turn: jax.Array
    """Turn of the command [rad]."""
    forward: jax.Array
    """Distance of the command [mm]."""

    def init(self, n_robots, key):
        return CountingMemory(self.inner.init(n_robots, key), jnp.zeros(n_robots, jnp.int32))

    @property
    def payload(self):
        return self.inner.payload

    def say(self, memory, is_loaded):
        return self.inner.say(memory.inner, is_loaded)

    def picks(self, memory):
        return self.inner.picks(memory.inner)

    def act(self, memory, observation, key):
        after, command = self.inner.act(memory.inner, observation, key)
        age = memory.age + 1
        is_chosen = (jnp.arange(len(age)) == self.robot) | (self.robot < 0)
        is_told = (age >= self.step) & is_chosen
        command = Command(
            turn=jnp.where(is_told, self.turn, command.turn),
            forward=jnp.where(is_told, self.forward, command.forward),
        )
        return CountingMemory(after, age), command


def scripted(run, *, step, robot, turn, forward):
    """Return `Scripted` around the strategy of a run.

    Each argument is a number, or one for each world.
    """
    params, _ = run.arrays()
    numbers = (np.int32(step), np.int32(robot), np.float32(turn), np.float32(forward))
    of_worlds = (np.broadcast_to(number, run.settings.n_worlds) for number in numbers)
    return Scripted(params.strategy, *of_worlds)
