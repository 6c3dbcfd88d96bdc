"""Further decisions of robots and tasks: releases, power of LEDs, conditions, failures, rewards."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.runs import records
from support.small import SMALL
from support.tasks import COUNT, Still, Weather

from iswarm_mj.config.swarm import EnergyConfig, GripperConfig, SwarmConfig
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
WITHOUT_NOISE = SwarmConfig(SMALL.arena, optics=SMALL.optics)


def world_with_robots_at(*positions):
    """Return a world of cleaning whose robots look along x, at positions [mm]."""
    n_robots = len(positions)
    poses = np.array([(x, y, 0.0) for x, y in positions])
    _, balls = CLEANING.lay_out(
        config=SMALL,
        n_robots=n_robots,
        rng=np.random.default_rng(0),
        shared=np.random.default_rng(0),
        cell=1.0,
    )
    start = Start(poses, balls, np.ones(n_robots, bool))
    return World(TYPE1, n_robots, start=start)


class Dim(Still):
    """A strategy in which robot 0 is dark, and robot 1 has a quarter of the power."""

    def led_power(self, memory):
        return 0.25 * memory


class Fading(Still):
    """A strategy of robots that dim their LEDs step by step."""

    def led_power(self, memory):
        return 1 / (1 + memory)

    def act(self, memory, observation, key):
        _, command = super().act(memory, observation, key)
        return memory + 1, command


class TestPowerOfLEDs:
    def test_light_reaches_as_far_as_its_power_allows(self):
        """Light of a quarter of the power reaches half of 9.9 mm; robots are 6 mm apart in a row.

        Robot 0 is dark, robot 1 too weak; robot 2 is heard by robot 1, which hides it from robot 0.
        """
        scenario = Scenario(
            WITHOUT_NOISE,
            strategy=Teams({"dim": (2, Dim()), "still": (1, Still())}),
            robots=3,
            engine=ENGINE,
            worlds=[world_with_robots_at((-6.0, 8.0), (0.0, 8.0), (6.0, 8.0))],
            steps=2,
        )
        for record in records(Run(scenario)):
            receiver, side = np.nonzero(record.links.valid[0])
            sender = record.links.sender[0, receiver, side]
            pairs = set(zip(receiver.tolist(), sender.tolist(), strict=True))
            assert pairs == {(1, 2)}
            assert record.swarm.led_power[0].tolist() == [0.0, 0.25, 1.0]

    def test_power_is_that_of_the_memory_after_the_step(self):
        scenario = Scenario(WITHOUT_NOISE, strategy=Fading(), robots=2, engine=ENGINE, steps=3)
        power = [record.swarm.led_power[0] for record in records(Run(scenario))]
        np.testing.assert_allclose(power, [[1 / 2, 1 / 3], [1 / 3, 1 / 4], [1 / 4, 1 / 5]])


@dataclass(frozen=True)
class Drop(Still):
    """A strategy in which robots of odd number release their balls in the third step.

    So would robot 0, which has none. Robot 0 picks up balls from the fourth step on.
    """

    turn: float = 0.0
    """Angle by which all robots turn in each step [rad]."""

    def init(self, n_robots, key):
        return {"number": jnp.arange(n_robots), "step": jnp.zeros(n_robots, int)}

    def picks(self, memory):
        return (memory["number"] == 0) & (memory["step"] >= 3)

    def releases(self, memory):
        is_odd = memory["number"] % 2 == 1
        return (memory["step"] == 2) & (is_odd | (memory["number"] == 0))

    def act(self, memory, observation, key):
        n_robots = len(memory["step"])
        command = Command(jnp.full(n_robots, self.turn), jnp.zeros(n_robots))
        return {"number": memory["number"], "step": memory["step"] + 1}, command


class TestReleases:
    """Robot 0 has a ball at its tip, robots 1 to 3 hold one each, robot 3 over the dump."""

    @pytest.fixture
    def world(self):
        world = world_with_robots_at((-10.0, 8.0), (-10.0, 0.0), (-10.0, -8.0), (0.0, 0.0))
        ball = np.arange(SMALL.arena.n_dust)
        at_tip_of_robot_0 = np.float32([-9.1, 8.0])
        balls = world.start.task
        balls = balls._replace(
            position=np.where(ball[:, None] == 3, at_tip_of_robot_0, balls.position),
            is_held=ball < 3,
            holder=np.minimum(ball + 1, 3).astype(np.int32),
        )
        return replace(world, start=world.start._replace(task=balls))

    ENERGY = EnergyConfig(
        model="capacitor", largest_voltage=50.0, light_power=40e-6, tool_capacitance=1e-7
    )

    def run_with(self, world, release_time):
        """Return a run of six steps, and its records.

        The second world is the first, but for robot 1, which is dead.
        """
        is_alive = np.arange(4) != 1
        with_dead_robot = replace(world, start=world.start._replace(is_alive=is_alive))
        gripper = GripperConfig(release_time=release_time)
        scenario = Scenario(
            SwarmConfig(SMALL.arena, gripper=gripper, energy=self.ENERGY),
            strategy=Drop(turn=release_time / 200),
            robots=4,
            engine=ENGINE,
            worlds=[world, with_dead_robot],
            steps=6,
        )
        run = Run(scenario)
        return run, list(records(run))

    def test_robots_release_balls_where_they_want_to(self, world):
        """The ball stays on the floor, and is not delivered; one over the dump is, at once."""
        run, steps = self.run_with(world, release_time=0.0)
        balls = [record.swarm.task for record in steps]
        assert balls[1].is_held[0][:3].tolist() == [True, True, False]
        assert balls[2].is_held[0][:3].tolist() == [False, True, False]
        assert balls[-1].is_delivered[0][:3].tolist() == [False, False, True]
        assert balls[-1].is_lying[0][0]
        tip_of_robot_1 = np.array(run.robot.probe_tip) + world.start.poses[1, :2]
        np.testing.assert_allclose(balls[-1].position[0][0], tip_of_robot_1, atol=0.05)

    def test_dead_robots_release_nothing(self, world):
        run, _ = self.run_with(world, release_time=0.0)
        assert run.task_state.is_held[1][0]

    def test_tools_are_charged_for_each_attempt(self, world):
        """A grasp takes 40 V, and a release the capacitor's voltage, which is less than 55 V."""
        _, steps = self.run_with(world, release_time=0.0)
        never = 9
        release_step = np.array([never, 2, never, 0])
        grasp_step = 3
        light = 40e-6
        message = 80e-6

        energy = np.full(4, self.ENERGY.full)
        for step in range(len(steps)):
            energy = np.minimum(energy + light, self.ENERGY.full)
            voltage_squared = 2 * energy / self.ENERGY.capacitance
            charges = np.where(step == release_step, voltage_squared, 0.0)
            if step == grasp_step:
                charges[0] = 40**2
            energy -= message + self.ENERGY.tool_capacitance * charges
        np.testing.assert_allclose(steps[-1].swarm.energy[0], energy, rtol=1e-5)

    def test_robots_stand_while_they_release(self, world):
        """Robot 1 breaks off, since it does not want to release any more as the attempt ends."""
        _, steps = self.run_with(world, release_time=2.0)
        balls = steps[-1].swarm.task
        assert balls.is_held[0][:3].tolist() == [True, True, False]
        assert balls.statistics.broken_off[0][0] == 1
        stands = np.array([record.command.turn[0] == 0 for record in steps])
        steps_of_robots = [np.flatnonzero(of_robot).tolist() for of_robot in stands.T]
        assert steps_of_robots == [[], [2, 3], [], [0, 1]]

    def test_robots_that_wait_for_energy_release_nothing(self, world):
        """One step takes half of what their capacitors hold, and light charges nothing."""
        energy = EnergyConfig(model="capacitor", light_power=0.0, message_energy=0.9e-3)
        scenario = Scenario(
            SwarmConfig(SMALL.arena, energy=energy),
            strategy=Drop(),
            robots=4,
            engine=ENGINE,
            worlds=[world, world],
            steps=4,
        )
        run = Run(scenario)
        assert run.start.swarm.is_loaded[0, 0].tolist() == [False, True, True, True]

        *_, last = records(run)
        assert last.swarm.steps_without_energy[0].tolist() == [3] * 4
        assert [run.measures(row).starved for row in range(2)] == [12, 12]
        balls = last.swarm.task
        assert balls.is_held[0][:4].tolist() == [True, True, False, False]
        assert not balls.statistics.releases[0][:2].any()


class TestTasks:
    """Bad weather, in which no message arrives from step 3 on, and robots of odd number die."""

    def test_change_conditions_and_let_robots_fail(self):
        n_robots = 12
        is_even = np.arange(n_robots) % 2 == 0
        everyone = np.ones(n_robots, bool)
        scenario = Scenario(
            SMALL,
            strategy=TYPE1,
            task=Weather(),
            robots=n_robots,
            engine=ENGINE,
            steps=6,
        )
        *good_days, third, fourth, fifth, sixth = records(Run(scenario))
        for record in good_days:
            assert record.swarm.is_alive[0].tolist() == everyone.tolist()
            assert record.is_heard[0].sum() == record.links.valid[0].sum() > 0

        for record in (third, fourth, fifth, sixth):
            assert record.swarm.is_alive[0].tolist() == is_even.tolist()
            assert not record.is_heard[0].any()
        for record in (fourth, fifth, sixth):
            forward = record.command.forward[0]
            assert not forward[~is_even].any()
            assert forward[is_even].any()

    def test_reward_commands_and_messages(self):
        """The reward is the distance walked less the number that the robot sends."""
        n_robots = 12
        env = make_env(config=SMALL, task=Weather(), robots=n_robots, engine=ENGINE, payload=COUNT)
        forward = np.linspace(-1, 1, n_robots)
        number = np.linspace(1, -1, n_robots)
        action = np.zeros((1, n_robots, env.action_size), np.float32)
        action[0, :, 1] = forward
        action[0, :, 2] = number

        state = env.reset(jax.random.split(jax.random.key(0), 1))
        state = env.step(state, action)
        distance = forward * 0.5 * RD
        sent = np.round((number + 1) / 2 * 15)
        np.testing.assert_allclose(state.reward[0], distance - sent, atol=1e-5)


class BadPower(Still):
    """A strategy that returns whole numbers as power."""

    def led_power(self, memory):
        return memory


class BadRelease(Still):
    """A strategy that returns whole numbers as flags."""

    def releases(self, memory):
        return memory


class BadWeather(Weather):
    """A task that returns three drop rates."""

    def conditions(self, state, conditions):
        return conditions._replace(drop_rate=jnp.zeros(3))


class BadFailures(Weather):
    """A task that returns one flag for all robots."""

    def survives(self, state):
        return jnp.bool_(True)


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"strategy": BadPower()}, r"BadPower\.led_power must return float32\[12\]"),
        ({"strategy": BadRelease()}, r"BadRelease\.releases must return bool\[12\]"),
        (
            {"task": BadWeather()},
            r"BadWeather\.conditions must return float32\[\] as \.drop_rate",
        ),
        ({"task": BadFailures()}, r"BadFailures\.survives must return bool\[12\]"),
    ],
)
def test_mistakes_are_refused(fields, says):
    with pytest.raises(UserError, match=says):
        Run(Scenario(SMALL, robots=12, steps=2, **fields))
