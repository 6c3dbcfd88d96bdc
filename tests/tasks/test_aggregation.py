"""Aggregation on the brighter of two spots: the light by hand, and who gathers where."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.sensing import senses_nothing
from support.worlds import start_of, task_inputs

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust, Spots
from iswarm_mj.tasks.signatures import as_task, check_task
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import RD
from iswarm_mj.workflows.rollout import rollout

TASK = Aggregation(spot_radius=4.0, spot_offset=10.0, dim=0.25)
CONFIG = SwarmConfig()


def test_light_by_hand():
    """1 at the centre of the brighter spot, half of it halfway, 0 at the edge; a quarter of all that in the other."""
    x = np.array([10, 12, 14, 0, -10, -8, -6]) * RD
    poses = np.column_stack([x, 0 * x, 0 * x])
    for east in (1.0, -1.0):
        light = TASK.light(poses * [east, 1, 1], np.float32(east))
        np.testing.assert_allclose(light[:, 0], [1, 0.5, 0, 0, 0, 0, 0], atol=1e-6)
        np.testing.assert_allclose(light[:, 1], [0, 0, 0, 0, 0.25, 0.125, 0], atol=1e-6)


def test_either_spot_is_the_brighter_one():
    starts = [start_of(CONFIG, 50, 0, index, task=TASK) for index in range(40)]
    east = [float(start.task.east) for start in starts]
    assert set(east) == {-1.0, 1.0} and abs(np.mean(east)) < 0.5
    for start in starts[:4]:
        x, y = start.poses[:, 0] * start.task.east, start.poses[:, 1]
        inside = np.hypot(np.abs(x) - 10 * RD, y) < 4 * RD
        np.testing.assert_allclose(start.task.shares, [(inside & (x > 0)).mean(), (inside & (x < 0)).mean()])
    task, state = as_task(TASK), starts[0].task
    assert check_task(task, CONFIG, CONFIG.static, read_robot(), state, 50).keys() == {"light"}
    for sign in (-1.0, 1.0):
        areas = TASK.areas(CONFIG, starts[east.index(sign)].task)
        for name, side in (("bright", sign), ("dim", -sign)):
            assert areas[name][0].tolist() == pytest.approx([side * 10 * RD, 0, 4 * RD], rel=1e-6)


@pytest.mark.parametrize(
    "spots, size, words",
    [
        ({"spot_offset": 16.5}, 50, r"spot_offset must be at most 16 rd with spots of 9 rd .*\(got 16.5\); make"),
        ({}, 45, r"spot_offset must be at most 13.5 rd .*\(got 14.0\); make it smaller, or `arena.size` larger"),
        ({"spot_radius": 26.0, "spot_offset": 0.0}, 50, r"spot_radius must be at most 25 rd, .*\(got 26.0\); make"),
    ],
)
def test_spots_beyond_the_walls_are_refused(spots, size, words):
    with pytest.raises(ConfigError, match=words):
        start_of(SwarmConfig(ArenaConfig(size=size)), 5, 0, 0, task=Aggregation(**spots))


@pytest.mark.parametrize("spots", [{"spot_offset": 16.0}, {"spot_radius": 25.0, "spot_offset": 0.0}])
def test_spots_may_touch_the_walls(spots):
    assert len(start_of(SwarmConfig(ArenaConfig(size=50)), 5, 0, 0, task=Aggregation(**spots)).poses) == 5


def inputs_of(poses, present):
    """Inputs of the task at poses in diameters of a robot."""
    return task_inputs(CONFIG, np.multiply(poses, [RD, RD, 1.0]), None, present)


def advanced(poses, present, east=1.0, task=TASK):
    """The task's state and what robots sense."""
    state = Spots(np.float32(east), np.zeros(2, np.float32))
    return task.advance(state, inputs_of(poses, present), jax.random.key(0))


def test_shares_are_of_the_robots_that_are_there():
    poses = np.array([[10, 0, 0], [11, 0, 0], [-10, 0, 0], [0, 0, 0], [10, 1, 0]], float)
    present = np.array([True, True, True, True, False])
    for east, shares, earn in ((1.0, [0.5, 0.25], [0, 1, 4]), (-1.0, [0.25, 0.5], [2])):
        state, _ = advanced(poses, present, east)
        assert state.shares.tolist() == shares and TASK.progress(state) == 100 * shares[0]
        assert TASK.metrics(state) == {"bright": shares[0], "dim": shares[1]}
        assert np.flatnonzero(TASK.reward(state, state, inputs_of(poses, present))).tolist() == earn


def test_photodiodes_err_by_their_share():
    """5 % of the light where the robot is, whatever the spot."""
    n = 4000
    for x, light in ((10.0, 1.0), (-10.0, 0.25)):
        _, sensed = advanced(np.tile([x, 0.0, 0.0], (n, 1)), np.ones(n, bool))
        seen = np.asarray(sensed.own["light"])
        np.testing.assert_allclose([seen.mean(), seen.std()], [light, 0.05 * light], rtol=0.05)
    _, sensed = advanced(np.tile([10.0, 0.0, 0.0], (n, 1)), np.ones(n, bool), task=replace(TASK, error_light=1.0))
    assert (sensed.own["light"].min(), sensed.own["light"].max()) == (0.0, 2.0)


class TestBeeclust:
    def test_without_light_the_task_that_has_it_is_named(self):
        keys = jax.random.split(jax.random.key(0), 1)
        with pytest.raises(UserError, match="--task aggregation"):
            rollout(Scenario(CONFIG, strategy=Beeclust(), robots=4, engine=PlanarSettings(1), worlds=keys, steps=1))

    def test_waits_as_long_as_it_is_bright(self):
        """Of robots that meet, one in the dark turns away, one in the light waits 300 l^2 / (l^2 + 0.25) steps, and one
        that leaves meets nobody."""
        bees, n = Beeclust(), 4
        light = jnp.array([0.0, 0.5, 1.0, 1.0])
        nothing = senses_nothing(n)._replace(sensed={"light": light})
        meeting = nothing._replace(is_heard=jnp.ones((n, 4), bool), distance=jnp.full((n, 4), 1.2 * RD))
        memory, command = bees.act({"wait": jnp.array([0.0, 0.0, 0.0, -200.0])}, meeting, jax.random.key(0))
        assert memory["wait"].tolist() == [0.0, 150.0, 240.0, -199.0]
        assert abs(command.turn[0]) >= np.pi / 4 - 1e-6 and command.forward[0] > 0
        assert command.turn[1:3].tolist() == [0, 0] and command.forward[1:3].tolist() == [0, 0]
        for _ in range(149):
            memory, command = bees.act(memory, meeting, jax.random.key(1))
        assert memory["wait"].tolist() == [0.0, 1.0, 91.0, -50.0] and command.forward[1] == 0
        memory, command = bees.act(memory, meeting, jax.random.key(1))
        assert memory["wait"][1] == -bees.leaving and command.forward[1] > 0
        for _ in range(4):
            memory, _ = bees.act(memory, nothing, jax.random.key(1))
        assert memory["wait"][1] == 0

    def test_turns_away_from_walls_in_front_to_either_side(self):
        """By 45 to 90 degrees; else it walks straight on, but for 0.1 rad: beside walls, and beside others 1.5 rd away,
        or that it does not hear."""
        n, kind = 400, np.arange(400) % 4
        nothing = senses_nothing(n)._replace(sensed={"light": jnp.ones(n)})
        walls = np.column_stack([kind == 0, *[kind == 1] * 3])
        distance = np.where(kind == 2, 1.5, 1.2)[:, None] * np.full(4, RD)
        seen = nothing._replace(sees_wall=walls, is_heard=np.tile((kind == 2)[:, None], 4), distance=distance)
        memory, command = Beeclust().act({"wait": jnp.zeros(n)}, seen, jax.random.key(0))
        turn, ahead = np.asarray(command.turn), kind == 0
        assert not memory["wait"].any()
        np.testing.assert_allclose(command.forward, 0.5 * RD, rtol=1e-6)
        for turns, low, high in ((turn[ahead], np.pi / 4, np.pi / 2), (turn[~ahead], 0.0, 0.1)):
            assert np.abs(turns).min() >= low - 1e-6 and low + 0.9 * (high - low) < np.abs(turns).max() <= high + 1e-6
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
