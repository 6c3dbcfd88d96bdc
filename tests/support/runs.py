"""Whole runs on MuJoCo in C: all worlds recorded, one record a control step; and strategies that do
as they are told.

Programs are compiled for each number of worlds and of robots: N robots in one or three worlds cost
nothing more.
"""

from dataclasses import dataclass
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


def run_of(config, genome=PRESETS["type1"], n_robots=N, steps=200, *, threads=1, **settings):
    """Run of small swarms, of which all worlds are recorded.

    Args:
        config: of all worlds.
        genome: of all worlds, unless `strategy` has a first axis of worlds.
        n_robots: N.
        steps: control steps at most.
        threads: of MuJoCo.
        settings: further fields of the scenario; `record_worlds` and `capacity` go to `Run`, and
            `failed_fraction` to each world.
    """
    if failed_fraction := settings.pop("failed_fraction", 0.0):
        seed, n_worlds = settings.pop("seed", 0), settings.pop("worlds", 1)
        settings["worlds"] = [
            World(genome, n_robots, seed, k, failed_fraction) for k in range(n_worlds)
        ]
    options = {
        name: settings.pop(name) for name in ("record_worlds", "capacity") if name in settings
    }
    settings.setdefault("strategy_per_world", "strategy" in settings)
    settings.setdefault("strategy", genome)
    scenario = Scenario(
        config, robots=n_robots, steps=steps, engine=MujocoSettings(threads), **settings
    )
    return Run(scenario, **{"record_worlds": range(scenario.n_worlds), **options})


def records(run):
    """Records (W, ...) of the control steps that are left, one by one."""
    while not run.is_over:
        yield first_step(run.advance())


def first_step(record):
    """Of records (T, W, ...) the first one (W, ...)."""
    return jax.tree.map(lambda a: a[0], record)


def engine_of(run):
    """The engine of the first world, and of those of the same share."""
    return place_of(run, 0)[0]


def place_of(run, world):
    """The engine of a world on the host, and the world's place in it."""
    parts, shares = run._loop._slices, run._loop._shards
    share = next(index for index, part in enumerate(parts) if part.start <= world < part.stop)
    return shares[share].engine, world - parts[share].start


def poses_of(run):
    """Where the robots of all worlds are (B, N, 3)."""
    return run.arrays()[1].bodies.poses


def end_of(run):
    """Poses and measures at the end."""
    for _ in records(run):
        pass
    return poses_of(run), [run.measures(w) for w in range(len(run.worlds))]


def check_balls(run, record):
    """Each ball is lying, held or delivered; held ones hang at a tip, one a robot; delivered ones
    lie in the dump."""
    balls, arena, robot = record.swarm.task, run.config.arena, run.robot
    centres = ball_centres(balls, record.poses, robot)
    for world in range(run.settings.n_worlds):
        held, delivered, lying = (
            balls.is_held[world],
            balls.is_delivered[world],
            balls.is_lying[world],
        )
        assert lying.sum() + held.sum() + delivered.sum() == arena.n_dust
        assert not (held & delivered).any() and not (lying & (held | delivered)).any()
        holder = balls.holder[world]
        assert len(set(holder[held])) == held.sum()
        x, y, yaw = record.poses[world, holder[held]].T
        ahead, beside = robot.probe_tip
        tip = [
            x + ahead * np.cos(yaw) - beside * np.sin(yaw),
            y + ahead * np.sin(yaw) + beside * np.cos(yaw),
        ]
        at = centres[world]
        np.testing.assert_allclose(at[held, :2].T, tip, atol=1e-5)
        assert (at[held, 2] < robot.tip_height).all()
        assert np.abs(at[delivered, :2]).max(initial=0.0) <= arena.dump_size / 2 * RD + 1e-4
        radius = balls.radius[world]
        np.testing.assert_allclose(at[~held, 2], 1e3 * radius[~held], rtol=1e-6)


def spoil(run, step, world, robot, value=1e3):
    """Put a robot of a world at x = `value` in the middle of a control step, counted from 1."""
    (engine, place), steps = place_of(run, world), iter(range(1, 10**6))
    move = engine.move

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
    """The paper's strategy until a control step, from which on one robot of the world, or all, get another command."""

    inner: VectorStrategy
    step: jax.Array
    """Counted from 1."""
    robot: jax.Array
    """-1 for all."""
    turn: jax.Array
    forward: jax.Array

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
        mine = (age >= self.step) & ((jnp.arange(len(age)) == self.robot) | (self.robot < 0))
        told = Command(
            jnp.where(mine, self.turn, command.turn), jnp.where(mine, self.forward, command.forward)
        )
        return CountingMemory(after, age), told


def scripted(run, *, step, robot, turn, forward):
    """`Scripted` with the strategy of a run; each argument is a number, or one for each world."""
    numbers = (np.int32(step), np.int32(robot), np.float32(turn), np.float32(forward))
    return Scripted(
        run.arrays()[0].strategy, *(np.broadcast_to(a, run.settings.n_worlds) for a in numbers)
    )
