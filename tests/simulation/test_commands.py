"""What robots may decide beside their motion, and what tasks may change: releases, LED power, conditions, failures."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.runs import records
from support.small import SMALL
from support.tasks import COUNT, Still, Weather

from iswarm_mj.config.swarm import EnergyConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.envs.make import make_env
from iswarm_mj.simulation.layouts import Start
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

ENGINE = PlanarSettings(threads=1)
CALM = SwarmConfig(SMALL.arena, optics=SMALL.optics)


class Dim(Still):
    """Robot 0 is silent, 1 has a quarter of the power."""

    def led_power(self, memory):
        return 0.25 * memory


def placed(*places):
    """A run's worlds of robots that look along x, at places [mm]."""
    poses = np.array([(x, y, 0.0) for x, y in places])
    _, state = CLEANING.lay_out(SMALL, len(places), np.random.default_rng(0), np.random.default_rng(0), 1.0)
    return [World(TYPE1, len(places), start=Start(poses, state, np.ones(len(places), bool)))]


def test_light_reaches_as_far_as_its_power_allows():
    """Robots in a row, 6 mm apart: light of a quarter of the power reaches half of 9.9 mm."""
    teams, worlds = Teams({"dim": (2, Dim()), "still": (1, Still())}), placed((-6.0, 8.0), (0.0, 8.0), (6.0, 8.0))
    for record in records(Run(Scenario(CALM, strategy=teams, robots=3, engine=ENGINE, worlds=worlds, steps=2))):
        links = record.links
        heard = {(i, int(links.sender[0, i, s])) for i, s in zip(*np.nonzero(links.valid[0]), strict=True)}
        assert heard == {(1, 2)}  # 0 is dark, 1 too weak, 2 is heard by 1; 1 hides it from 0
        assert record.swarm.led_power[0].tolist() == [0.0, 0.25, 1.0]


class Fading(Still):
    """Robots dim their LEDs step by step."""

    def led_power(self, memory):
        return 1 / (1 + memory)

    def act(self, memory, seen, key):
        return memory + 1, super().act(memory, seen, key)[1]


def test_power_is_that_of_the_memory_after_the_step():
    run = Run(Scenario(CALM, strategy=Fading(), robots=2, engine=ENGINE, steps=3))
    power = [record.swarm.led_power[0] for record in records(run)]
    np.testing.assert_allclose(power, [[1 / 2, 1 / 3], [1 / 3, 1 / 4], [1 / 4, 1 / 5]])


@dataclass(frozen=True)
class Drop(Still):
    """Robots hold a ball, and those of odd number release it in the third step, as robot 0 wants to without a ball;
    that one picks up balls from the fourth step on."""

    turn: float = 0.0

    def init(self, n_robots, key):
        return jnp.stack([jnp.arange(n_robots), jnp.zeros(n_robots, int)], axis=1)

    def picks(self, memory):
        return (memory[:, 0] == 0) & (memory[:, 1] >= 3)

    def releases(self, memory):
        return (memory[:, 1] == 2) & ((memory[:, 0] % 2 == 1) | (memory[:, 0] == 0))

    def act(self, memory, seen, key):
        return memory + jnp.array([0, 1]), Command(jnp.full(len(memory), self.turn), jnp.zeros(len(memory)))


def carrying():
    """A run's worlds of four robots, of which the first has a ball at its tip; the others hold one, the last one over
    the dump."""
    (world,) = placed((-10.0, 8.0), (-10.0, 0.0), (-10.0, -8.0), (0.0, 0.0))
    held = np.arange(SMALL.arena.n_dust) < 3
    places = np.where(np.arange(len(held))[:, None] == 3, np.float32([-9.1, 8.0]), world.start.task.position)
    balls = world.start.task._replace(
        position=places, is_held=held, holder=np.minimum(np.arange(len(held)) + 1, 3).astype(np.int32)
    )
    return [World(TYPE1, 4, start=world.start._replace(task=balls))]


@pytest.mark.parametrize("release_time", [0.0, 2.0])
def test_robots_release_balls_where_they_want_to(release_time):
    """The ball stays there, lies on the floor, and is not delivered; one over the dump is, at once. Tools are charged
    to 40 V for a grasp, and to the voltage of the capacitor, which is less than 55 V, for a release."""
    (world,) = carrying()
    dead = replace(world, start=world.start._replace(is_alive=np.arange(4) != 1))
    gripper = type(SMALL.gripper)(release_time=release_time)
    energy = EnergyConfig(model="capacitor", largest_voltage=50.0, light_power=40e-6, tool_capacitance=1e-7)
    config = SwarmConfig(SMALL.arena, gripper=gripper, energy=energy)
    run = Run(
        Scenario(config, strategy=Drop(release_time / 200), robots=4, engine=ENGINE, worlds=[world, dead], steps=6)
    )
    seen = list(records(run))
    swarms = [record.swarm for record in seen]
    states = [swarm.task for swarm in swarms]
    assert run.task_state.is_held[1][0]
    if release_time:  # the robot does not want to any more as the attempt ends
        assert states[-1].is_held[0][:3].tolist() == [True, True, False] and states[-1].statistics.broken_off[0][0] == 1
        stands = np.array([record.command.turn[0] == 0 for record in seen])
        assert [list(np.flatnonzero(robot)) for robot in stands.T] == [[], [2, 3], [], [0, 1]]
        return
    assert [state.is_held[0][:3].tolist() for state in states[1:3]] == [[True, True, False], [False, True, False]]
    last = states[-1]
    assert last.is_delivered[0][:3].tolist() == [False, False, True] and last.is_lying[0][0]
    tip = np.array(run.robot.probe_tip) + world.start.poses[1, :2]
    np.testing.assert_allclose(last.position[0][0], tip, atol=0.05)
    left = np.full(4, energy.full)
    for step in range(6):
        left = np.minimum(left + 40e-6, energy.full)
        charges = np.where(step == np.array([9, 2, 9, 0]), 2 * left / energy.capacitance, [1600 * (step == 3), 0, 0, 0])
        left -= 80e-6 + 1e-7 * charges
    np.testing.assert_allclose(swarms[-1].energy[0], left, rtol=1e-5)


def test_robots_that_wait_for_energy_release_nothing():
    """One step takes half of what their capacitors hold, and light puts nothing in."""
    energy = EnergyConfig(model="capacitor", light_power=0.0, message_energy=0.9e-3)
    run = Run(
        Scenario(
            SwarmConfig(SMALL.arena, energy=energy),
            strategy=Drop(),
            robots=4,
            engine=ENGINE,
            worlds=carrying() * 2,
            steps=4,
        )
    )
    assert run.start.swarm.is_loaded[0, 0].tolist() == [False, True, True, True]
    last = [record.swarm for record in records(run)][-1]
    assert last.steps_without_energy[0].tolist() == [3] * 4
    assert [run.measures(world).starved for world in range(2)] == [12, 12]
    assert (
        last.task.is_held[0][:4].tolist() == [True, True, False, False]
        and not last.task.statistics.releases[0][:2].any()
    )


def test_a_task_changes_conditions_and_lets_robots_fail():
    run = Run(Scenario(SMALL, strategy=TYPE1, task=Weather(), robots=12, engine=ENGINE, steps=6))
    for step, record in enumerate(records(run)):
        if step < 2:
            assert record.is_heard[0].sum() == record.links.valid[0].sum() > 0
        else:
            assert not record.is_heard.any()
        alive = np.arange(12) % 2 == 0 if step >= 2 else np.ones(12, bool)
        assert record.swarm.is_alive[0].tolist() == alive.tolist()
        if step > 2:
            assert not record.command.forward[0][~alive].any() and record.command.forward[0][alive].any()


def test_rewards_see_commands_and_messages():
    env = make_env(config=SMALL, task=Weather(), robots=12, engine=ENGINE, payload=COUNT)
    state = env.reset(jax.random.split(jax.random.key(0), 1))
    action = np.zeros((1, 12, env.action_size), np.float32)
    action[0, :, 1], action[0, :, 2] = np.linspace(-1, 1, 12), np.linspace(1, -1, 12)
    state = env.step(state, action)
    expected = np.linspace(-1, 1, 12) * 0.5 * RD - np.round((np.linspace(1, -1, 12) + 1) / 2 * 15)
    np.testing.assert_allclose(state.reward[0], expected, atol=1e-5)


class BadPower(Still):
    def led_power(self, memory):
        return memory


class BadRelease(Still):
    def releases(self, memory):
        return memory


class BadWeather(Weather):
    def conditions(self, state, conditions):
        return conditions._replace(drop_rate=jnp.zeros(3))


class BadFailures(Weather):
    def survives(self, state):
        return jnp.bool_(True)


@pytest.mark.parametrize(
    ("strategy", "task", "match"),
    [
        (BadPower(), None, r"BadPower\.led_power must return float32\[12\]"),
        (BadRelease(), None, r"BadRelease\.releases must return bool\[12\]"),
        (None, BadWeather(), r"BadWeather\.conditions must return float32\[\] as \.drop_rate"),
        (None, BadFailures(), r"BadFailures\.survives must return bool\[12\]"),
    ],
)
def test_mistakes_are_refused(strategy, task, match):
    with pytest.raises(UserError, match=match):
        Run(Scenario(SMALL, strategy=strategy or TYPE1, task=task or CLEANING, robots=12, steps=2))
