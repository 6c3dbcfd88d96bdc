"""Teams: each strategy acts on its own robots as if it were alone; messages have the fields of
all."""

from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.small import SMALL
from support.tasks import Still

import iswarm_mj
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.sensors.fields import Flag, Integer, Real
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.genome import TYPE1, TYPE2
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.teams import Teams, team_numbers
from iswarm_mj.strategy.validation import observation_shapes
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.errors import UserError


@dataclass(frozen=True)
class Counter(Strategy):
    """Says its index, turns by chance, and remembers the largest index that it heard."""

    turn: float = 0.5
    recorded: ClassVar = {"heard": ""}
    payload: ClassVar = {"index": Integer(5)}

    def init(self, n_robots, key):
        index = jnp.arange(n_robots)
        return {"index": index, "heard": -jnp.ones_like(index)}

    def picks(self, memory):
        return memory["index"] > 0

    def say(self, memory, is_loaded):
        return {"index": memory["index"]}

    def act(self, memory, seen, key):
        heard = jnp.where(seen.is_heard, seen.payload["index"], -1).max(axis=1)
        turn = self.turn * jax.random.uniform(key, heard.shape)
        return memory | {"heard": jnp.maximum(memory["heard"], heard)}, Command(
            turn,
            jnp.full(turn.shape, 0.5),
        )


@dataclass(frozen=True)
class Loud(Strategy):
    """Says one flag."""

    payload: ClassVar = {"loud": Flag()}

    def init(self, n_robots, key):
        return jax.random.uniform(key, (n_robots, 2))

    def picks(self, memory):
        return memory[:, 0] < 2

    def say(self, memory, is_loaded):
        return {"loud": memory[:, 0] < 2}

    def act(self, memory, seen, key):
        return memory, Command(memory[:, 0], memory[:, 1])


class Relay(Loud):
    """A strategy that remembers chances and shortfalls, and says which robots are loaded."""

    def say(self, memory, is_loaded):
        return {"loud": is_loaded}

    def releases(self, memory):
        return memory[:, 0] < 2

    def led_power(self, memory):
        return memory[:, 1]

    def listen(self, memory, seen, key):
        return jax.random.uniform(key, memory.shape)

    def correct_odometry(self, memory, shortfall):
        return memory + shortfall[:, None]


class Checked(Counter):
    """Has another check."""

    payload: ClassVar = Payload(Counter.payload, "crc-8/smbus")


class Other(Counter):
    """Says another kind of index."""

    payload: ClassVar = {"index": Real(0, 1, 3)}


TEAMS = Teams({"count": (0.7, Counter()), "loud": (0.3, Loud())})


KEY = jax.random.key(3)
N_ROBOTS = 10
FIRST_TEAM = slice(0, 7)
SECOND_TEAM = slice(7, 10)


def random_observation(payload):
    """Return an observation of N robots that differs from robot to robot."""
    rng = np.random.default_rng(0)
    shapes = observation_shapes(N_ROBOTS, payload=payload)
    return jax.tree.map(
        lambda shape: jnp.asarray(rng.integers(0, 2, shape.shape), shape.dtype),
        shapes,
    )


def rows_of(tree, robots):
    """Return the rows of some robots in each array."""
    return jax.tree.map(lambda values: values[robots], tree)


def assert_equal(tree, expected):
    """Assert that two trees of arrays are equal."""
    jax.tree.map(np.testing.assert_array_equal, tree, expected)


@pytest.mark.parametrize(
    ("number", "robots"),
    [
        (0, FIRST_TEAM),
        (1, SECOND_TEAM),
    ],
)
def test_each_team_acts_on_its_robots_alone(number, robots):
    observation = random_observation(TEAMS.payload)
    memory = TEAMS.init(N_ROBOTS, KEY)
    after, command = TEAMS.act(memory, observation, KEY)

    # What the team's strategy does by itself.
    name, _, strategy = TEAMS.teams[number]
    key = jax.random.fold_in(KEY, number)
    payload = {field: observation.payload[field] for field in strategy.payload}
    observation_of_team = rows_of(observation._replace(payload=payload), robots)
    memory_of_team = strategy.init(robots.stop - robots.start, key)
    after_of_team, command_of_team = strategy.act(memory_of_team, observation_of_team, key)

    assert_equal(rows_of(memory[name], robots), memory_of_team)
    assert_equal(rows_of(after[name], robots), after_of_team)
    assert_equal(rows_of(command, robots), command_of_team)
    first_array = np.asarray(jax.tree.leaves(after[name])[0])
    assert not np.delete(first_array, robots, axis=0).any()


def test_each_team_decides_whether_its_robots_pick_up_balls():
    memory = TEAMS.init(N_ROBOTS, KEY)
    assert TEAMS.picks(memory).tolist() == [False, *[True] * 9]


class TestOptionalMethods:
    """The strategy of the second team has all optional methods, that of the first has none."""

    TEAMS = Teams({"count": (0.7, Counter()), "relay": (0.3, Relay())})
    MEMORY = TEAMS.init(N_ROBOTS, KEY)

    def test_listen(self):
        """It gets the key of `act`."""
        heard = self.TEAMS.listen(self.MEMORY, random_observation(self.TEAMS.payload), KEY)
        key = jax.random.fold_in(KEY, 1)
        np.testing.assert_array_equal(heard["relay"][SECOND_TEAM], jax.random.uniform(key, (3, 2)))
        assert not heard["relay"][FIRST_TEAM].any()
        assert_equal(heard["count"], self.MEMORY["count"])

    def test_correct_odometry(self):
        shortfall = jnp.arange(10.0)
        corrected = self.TEAMS.correct_odometry(self.MEMORY, shortfall)
        expected = self.MEMORY["relay"][SECOND_TEAM] + shortfall[SECOND_TEAM, None]
        np.testing.assert_array_equal(corrected["relay"][SECOND_TEAM], expected)
        assert not corrected["relay"][FIRST_TEAM].any()
        assert_equal(corrected["count"], self.MEMORY["count"])

    def test_releases(self):
        assert self.TEAMS.releases(self.MEMORY).tolist() == [False] * 7 + [True] * 3

    def test_led_power(self):
        power = self.TEAMS.led_power(self.MEMORY)
        np.testing.assert_array_equal(power[FIRST_TEAM], 1.0)
        np.testing.assert_array_equal(power[SECOND_TEAM], self.MEMORY["relay"][SECOND_TEAM, 1])

    def test_say(self):
        is_loaded = jnp.arange(10) % 3 == 0
        is_loud = self.TEAMS.say(self.MEMORY, is_loaded)["loud"]
        assert is_loud.tolist() == [False] * 7 + is_loaded[SECOND_TEAM].tolist()


def test_robots_say_nothing_in_the_fields_of_other_teams():
    content = TEAMS.say(TEAMS.init(10, jax.random.key(0)), jnp.zeros(10, bool))
    assert content["index"].tolist() == [0, 1, 2, 3, 4, 5, 6, 0, 0, 0]
    assert content["loud"].tolist() == [False] * 7 + [True] * 3


def test_fields_of_all_teams_must_fit_into_a_message():
    """Those of both teams take 29 and 5 of 29 bits."""
    teams = Teams({"red": (1, TYPE1), "blue": (3, Counter())})
    with pytest.raises(UserError, match="4 bits"):
        teams.for_world(SMALL, read_robot(), 4)


def test_vectors_of_robots_without_such_are_unknown():
    teams = Teams({"red": (2, Still()), "blue": (2, TYPE1)}).for_world(SMALL, read_robot(), 4)
    content = teams.say(teams.init(4, jax.random.key(0)), jnp.ones(4, bool))
    field = dict(teams.payload.fields)["dust"]
    assert not field.decode(field.encode(content["dust"])).known.any()
    assert content["priority"].tolist() == [False, False, True, True]


@pytest.mark.parametrize("share", [1.0, 13])
def test_one_team_of_a_genome_is_the_paper_s_strategy(share):
    teams = Teams({"all": (share, TYPE2)}).for_world(SMALL, read_robot(), 13)
    strategy = teams.teams[0].strategy
    assert isinstance(strategy, VectorStrategy)
    assert strategy.n_scouts == 4  # 27 % of 13


@pytest.mark.parametrize(
    ("shares", "n_robots", "sizes"),
    [
        ((0.5, 0.5), 5, (3, 2)),
        ((0.33, 0.33, 0.34), 10, (3, 4, 3)),
        ((2, 5), 7, (2, 5)),
        ((2, 5), 9, (2, 7)),
    ],
)
def test_sizes(shares, n_robots, sizes):
    teams = Teams({f"team{k}": (share, Loud()) for k, share in enumerate(shares)})
    assert teams.sizes(n_robots) == sizes
    assert np.bincount(team_numbers(teams, n_robots)).tolist() == list(sizes)


def test_a_swarm_of_two_teams_is_recorded_by_team(tmp_path):
    run = Run(Scenario(SMALL, strategy=TEAMS, robots=10, engine=PlanarSettings(1), steps=12))
    from iswarm_mj.workflows.clean import run_swarm

    run_swarm(run, tmp_path)
    saved = iswarm_mj.load(tmp_path)
    assert (saved.scene.team_names, saved.scene.team_sizes) == (("count", "loud"), (7, 3))
    table = saved.robots.filter(saved.robots["step"].to_numpy() == 12)
    assert table["team"].to_pylist() == ["count"] * 7 + ["loud"] * 3
    assert table["said_loud"].to_pylist() == [False] * 7 + [True] * 3
    assert table["said_index"].to_pylist() == [0, 1, 2, 3, 4, 5, 6, 0, 0, 0]
    assert 0 <= max(table["count_heard"].to_pylist()) <= 6
    assert saved.result["strategy"]["count"] == {"share": 0.7, "class": "Counter", "turn": 0.5}


def test_worlds_of_other_sizes_are_refused():
    from iswarm_mj.simulation.worlds import World

    worlds = [World(TYPE1, 10), World(TYPE1, 8)]
    with pytest.raises(UserError, match="differ in the values of their arrays alone"):
        Run(Scenario(SMALL, strategy=TEAMS, robots=10, worlds=worlds, steps=2))


@pytest.mark.parametrize(
    ("teams", "match"),
    [
        ({}, "a dictionary of shares"),
        ({"a b": (1.0, Loud())}, "cannot be called 'a b'"),
        ({"a": (0.5, Loud()), "b": (0.4, Loud())}, r"add up to 1 \(got 0.9\)"),
        ({"a": (0.5, Loud()), "b": (4, Loud())}, "give one kind"),
        ({"a": (0, Loud())}, "share of team a must be"),
        ({"a": (True, Loud())}, "share of team a must be"),
        ({"a": (1.0, object())}, "does not derive from Strategy"),
        ({"a": (0.5, Counter()), "b": (0.5, Counter(0.2))}, None),
        ({"a": (0.5, Checked()), "b": (0.5, Still())}, None),
        ({"a": (0.5, Counter()), "b": (0.5, Other())}, "equal fields of the same name"),
        ({"a": (0.5, Loud()), "b": (0.5, Checked())}, "must check messages alike"),
    ],
)
def test_mistakes_are_refused(teams, match):
    if match is None:
        assert Teams(teams).payload.bits == 5
    else:
        with pytest.raises(UserError, match=match):
            Teams(teams)


@pytest.mark.parametrize(
    ("teams", "match"),
    [
        ({"a": (3, Loud()), "b": (4, Loud())}, r"10 robots together, all that there are \(got 7\)"),
        ({"a": (0.99, Loud()), "b": (0.01, Loud())}, "enough for one of 10 robots"),
    ],
)
def test_sizes_that_do_not_fit_are_refused(teams, match):
    with pytest.raises(UserError, match=match):
        Run(Scenario(SMALL, strategy=Teams(teams), robots=10, steps=2))


def test_errors_name_the_method_of_the_team():
    class Silent(Loud):
        def act(self, memory, seen, key):
            return memory

    with pytest.raises(UserError, match=r"Silent\.act must return"):
        Run(
            Scenario(
                SMALL,
                strategy=Teams({"a": (0.5, Silent()), "b": (0.5, Loud())}),
                robots=10,
                steps=2,
            )
        )
