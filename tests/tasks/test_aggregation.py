"""Aggregation in the brighter of two spots: the light by hand, and how robots gather."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.sensing import senses_nothing
from support.settings import refused_setting
from support.worlds import start_of, task_inputs

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust, Spots
from iswarm_mj.tasks.validation import as_task, check_task
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD
from iswarm_mj.workflows.rollout import rollout

TASK = Aggregation(spot_radius=4.0, spot_offset=10.0, dim=0.25)
CONFIG = SwarmConfig()


def test_light_by_hand():
    """The light falls from 1 at a centre to 0 at the edge; in the dimmer spot it is a quarter."""
    x = np.array([10, 12, 14, 0, -10, -8, -6]) * RD
    poses = np.column_stack([x, 0 * x, 0 * x])
    for east in (1.0, -1.0):
        mirrored = poses * [east, 1, 1]
        light = TASK.light(mirrored, np.float32(east))
        np.testing.assert_allclose(light[:, 0], [1, 0.5, 0, 0, 0, 0, 0], atol=1e-6)
        np.testing.assert_allclose(light[:, 1], [0, 0, 0, 0, 0.25, 0.125, 0], atol=1e-6)


def test_either_spot_is_the_brighter_one():
    starts = [start_of(CONFIG, 50, 0, index, task=TASK) for index in range(40)]
    east = [float(start.task.east) for start in starts]
    assert set(east) == {-1.0, 1.0}
    assert abs(np.mean(east)) < 0.5


@pytest.mark.parametrize("index", range(4))
def test_shares_at_the_start_are_those_of_the_poses(index):
    start = start_of(CONFIG, 50, 0, index, task=TASK)
    towards_brighter = start.poses[:, 0] * start.task.east
    y = start.poses[:, 1]
    is_inside = np.hypot(np.abs(towards_brighter) - 10 * RD, y) < 4 * RD
    in_brighter = is_inside & (towards_brighter > 0)
    in_dimmer = is_inside & (towards_brighter < 0)
    np.testing.assert_allclose(start.task.shares, [in_brighter.mean(), in_dimmer.mean()])


def test_it_is_a_task():
    state = start_of(CONFIG, 50, 0, 0, task=TASK).task
    sensed = check_task(as_task(TASK), CONFIG, CONFIG.static, read_robot(), state, 50)
    assert sensed.keys() == {"light"}


@pytest.mark.parametrize("east", [-1.0, 1.0])
def test_areas_are_the_spots(east):
    state = Spots(np.float32(east), np.zeros(2, np.float32))
    areas = TASK.areas(CONFIG, state)
    bright = [east * 10 * RD, 0, 4 * RD]
    dim = [-east * 10 * RD, 0, 4 * RD]
    assert areas["bright"][0].tolist() == pytest.approx(bright, rel=1e-6)
    assert areas["dim"][0].tolist() == pytest.approx(dim, rel=1e-6)


@pytest.mark.parametrize(
    ("spots", "size", "name", "constraint"),
    [
        ({"spot_offset": 16.5}, 50, "spot_offset", "at most 16 rd with spots of 9 rd"),
        ({"spot_offset": 14.0}, 45, "spot_offset", "at most 13.5 rd"),
        ({"spot_radius": 26.0, "spot_offset": 0.0}, 50, "spot_radius", "at most 25 rd"),
    ],
)
def test_spots_beyond_the_walls_are_refused(spots, size, name, constraint):
    with refused_setting(name, spots[name], constraint):
        start_of(SwarmConfig(ArenaConfig(size=size)), 5, 0, 0, task=Aggregation(**spots))


@pytest.mark.parametrize(
    "spots",
    [
        {"spot_offset": 16.0},
        {"spot_radius": 25.0, "spot_offset": 0.0},
    ],
)
def test_spots_may_touch_the_walls(spots):
    config = SwarmConfig(ArenaConfig(size=50))
    assert len(start_of(config, 5, 0, 0, task=Aggregation(**spots)).poses) == 5


def inputs_of(poses, is_present):
    """Return the task's inputs; x and y of the poses are in rd."""
    return task_inputs(CONFIG, np.multiply(poses, [RD, RD, 1.0]), None, is_present)


def advance(poses, is_present, east=1.0, task=TASK):
    """Return the task's state after a step, and what robots sense."""
    state = Spots(np.float32(east), np.zeros(2, np.float32))
    return task.advance(state, inputs_of(poses, is_present), jax.random.key(0))


@pytest.mark.parametrize(
    ("east", "shares", "rewarded"),
    [
        (1.0, [0.5, 0.25], [0, 1]),
        (-1.0, [0.25, 0.5], [2]),
    ],
)
def test_shares_and_rewards_are_of_the_robots_that_are_present(east, shares, rewarded):
    """Robots 0, 1 and 4 are in the eastern spot, 2 in the western one; place 4 is empty."""
    poses = np.array([[10, 0, 0], [11, 0, 0], [-10, 0, 0], [0, 0, 0], [10, 1, 0]], float)
    is_present = np.array([True, True, True, True, False])
    state, _ = advance(poses, is_present, east)
    assert state.shares.tolist() == shares
    assert TASK.progress(state) == 100 * shares[0]
    assert TASK.metrics(state) == {"bright": shares[0], "dim": shares[1]}

    reward = TASK.reward(state, state, inputs_of(poses, is_present))
    assert np.flatnonzero(reward).tolist() == rewarded


@pytest.mark.parametrize(
    ("x", "light"),
    [
        (10.0, 1.0),
        (-10.0, 0.25),
    ],
)
def test_measured_light_errs_by_5_percent_in_both_spots(x, light):
    n_robots = 4000
    poses = np.tile([x, 0.0, 0.0], (n_robots, 1))
    _, sensed = advance(poses, np.ones(n_robots, bool))
    measured = np.asarray(sensed.own["light"])
    np.testing.assert_allclose([measured.mean(), measured.std()], [light, 0.05 * light], rtol=0.05)


def test_measured_light_is_clipped():
    n_robots = 4000
    poses = np.tile([10.0, 0.0, 0.0], (n_robots, 1))
    sloppy = replace(TASK, error_light=1.0)
    _, sensed = advance(poses, np.ones(n_robots, bool), task=sloppy)
    assert sensed.own["light"].min() == 0.0
    assert sensed.own["light"].max() == 2.0


class TestBeeclust:
    def test_without_light_the_task_that_has_it_is_named(self):
        keys = jax.random.split(jax.random.key(0), 1)
        with pytest.raises(UserError, match="--task aggregation"):
            rollout(
                Scenario(
                    CONFIG,
                    strategy=Beeclust(),
                    robots=4,
                    engine=PlanarSettings(1),
                    worlds=keys,
                    steps=1,
                )
            )

    def test_waits_longer_in_brighter_light(self):
        """Four robots meet others: one in the dark, two in light l, and one that still leaves.

        The first turns away, those in the light wait for 300 l^2 / (l^2 + 0.25) steps, and the last
        one does not stop again.
        """
        bees = Beeclust()
        n_robots = 4
        light = jnp.array([0.0, 0.5, 1.0, 1.0])
        alone = senses_nothing(n_robots)._replace(sensed={"light": light})
        meeting = alone._replace(
            is_heard=jnp.ones((n_robots, 4), bool),
            distance=jnp.full((n_robots, 4), 1.2 * RD),
        )

        memory = {"wait": jnp.array([0.0, 0.0, 0.0, -200.0])}
        memory, command = bees.act(memory, meeting, jax.random.key(0))
        assert memory["wait"].tolist() == [0.0, 150.0, 240.0, -199.0]
        assert abs(command.turn[0]) >= np.pi / 4 - 1e-6
        assert command.forward[0] > 0
        assert command.turn[1:3].tolist() == [0, 0]
        assert command.forward[1:3].tolist() == [0, 0]

        # After 149 further steps the second robot has one left.
        for _ in range(149):
            memory, command = bees.act(memory, meeting, jax.random.key(1))
        assert memory["wait"].tolist() == [0.0, 1.0, 91.0, -50.0]
        assert command.forward[1] == 0

        # Then it leaves, and after four steps may stop again.
        memory, command = bees.act(memory, meeting, jax.random.key(1))
        assert memory["wait"][1] == -bees.leaving
        assert command.forward[1] > 0
        for _ in range(4):
            memory, _ = bees.act(memory, alone, jax.random.key(1))
        assert memory["wait"][1] == 0

    def test_turns_aside_only_for_walls_ahead_and_robots_that_it_meets(self):
        """A quarter of the robots each have a wall ahead, walls at all other sides, and neighbours
        1.5 rd away; the last quarter has neighbours at 1.2 rd that it does not hear.
        """
        n_robots = 400
        quarter = np.arange(n_robots) % 4
        wall_ahead = quarter == 0
        wall_elsewhere = quarter == 1
        hears_others = quarter == 2
        observation = senses_nothing(n_robots)._replace(
            sensed={"light": jnp.ones(n_robots)},
            sees_wall=np.column_stack([wall_ahead, *[wall_elsewhere] * 3]),
            is_heard=np.tile(hears_others[:, None], 4),
            distance=np.where(hears_others, 1.5, 1.2)[:, None] * np.full(4, RD),
        )

        memory = {"wait": jnp.zeros(n_robots)}
        memory, command = Beeclust().act(memory, observation, jax.random.key(0))
        assert not memory["wait"].any()
        np.testing.assert_allclose(command.forward, 0.5 * RD, rtol=1e-6)
        turn = np.asarray(command.turn)
        self.assert_spread(turn[wall_ahead], smallest=np.pi / 4, largest=np.pi / 2)
        self.assert_spread(turn[~wall_ahead], smallest=0.0, largest=0.1)

    def assert_spread(self, turns, smallest, largest):
        """Assert that turns go to either side, and are spread from the smallest to the largest."""
        size = np.abs(turns)
        assert size.min() >= smallest - 1e-6
        assert smallest + 0.9 * (largest - smallest) < size.max() <= largest + 1e-6
        assert 0.3 < (turns > 0).mean() < 0.7

    @pytest.mark.slow
    def test_gathers_on_the_brighter_spot(self):
        """Three worlds of 150 robots; a random walk of the same robots gathers nowhere."""
        scenario = Scenario(
            CONFIG,
            strategy=Beeclust(),
            task=Aggregation(),
            robots=150,
            engine=PlanarSettings(refinement=4),
            worlds=jax.random.split(jax.random.key(0), 3),
            steps=2000,
        )
        bees = rollout(scenario, every=500).metrics
        walk = rollout(replace(scenario, strategy=Beeclust(longest_wait=0.0)), every=500).metrics
        assert (bees["bright"] > 0.35).all() and bees["bright"].mean() > 1.5 * bees["dim"].mean()
        assert (walk["bright"] < 0.25).all()
