"""Checks of a strategy before it runs: what its methods return, and what else they do."""

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.sensors.fields import Integer
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.attributes import led_power, parts_of
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.teams import Teams, check_strategies
from iswarm_mj.strategy.validation import as_strategy
from iswarm_mj.utils.declared_shapes import shapes_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import user_code

N, S = 5, 6


@dataclass
class Walk(Strategy):
    """Robots that count their steps."""

    gain: float = 1.0

    def init(self, n_robots, key):
        return {"steps": jnp.zeros(n_robots)}

    def picks(self, memory):
        return memory["steps"] >= 0

    def act(self, memory, seen, key):
        return {"steps": memory["steps"] + self.gain}, Command(*jnp.zeros((2, *seen.at_dust.shape)))


def mine(**methods):
    """Return a strategy like `Walk` but for some of its methods."""
    return as_strategy(dataclass(type("Mine", (Walk,), methods))())


def check(strategy=None, sensed=None, **methods):
    """Check a strategy in one world, by default one like `Walk` but for some of its methods."""
    strategy = strategy or mine(**methods)
    of_one_world = jax.tree.map(lambda values: jnp.asarray(values)[None], strategy)
    check_strategies(of_one_world, N, S, sensed)


def speaks(bits, name="word"):
    """Return attributes of a strategy whose robots say zero in a field of this many bits."""
    return {
        "payload": {name: Integer(bits)},
        "say": lambda self, memory, is_loaded: {name: 0 * is_loaded},
    }


def refused(words, **methods):
    """Check that a strategy like `Walk` but for some of its methods is refused with these words."""
    with pytest.raises(UserError, match=words):
        check(**methods)


def test_shapes_are_those_of_the_annotations():
    shapes = shapes_of(Observation, N=N, S=S)
    assert shapes["is_heard"] == jax.ShapeDtypeStruct((N, S), bool)
    assert shapes["led"].dtype == jnp.int32
    assert shapes["ball_vector"] == jax.ShapeDtypeStruct((N, 2), jnp.float32)
    assert "payload" not in shapes and "sensed" not in shapes


def test_what_depends_on_the_arguments_alone_is_accepted():
    table = np.array([np.nan, 1.0])
    outer_key = jax.random.key(3)

    def act(self, memory, seen, key):
        numbers = jax.random.uniform(outer_key, seen.at_dust.shape)
        turn = jax.nn.relu(numbers) * self.twice * table[1]
        turn = jnp.where(jnp.isnan(jnp.asarray(table)).any(), turn, 0.0)
        return memory, Command(turn, turn)

    twice = cached_property(lambda self: 2 * self.gain)
    twice.__set_name__(Walk, "twice")
    check(act=act, twice=twice)


def test_attributes_set_in_a_step_are_lost():
    def act(self, memory, seen, key):
        self.phase = memory["steps"]
        return Walk.act(self, memory, seen, key)

    refused(
        r"Mine\.act sets self\.phase, which is lost after the call; keep it in the memory", act=act
    )

    def picks(self, memory):
        self.gain = self.gain + 1
        return Walk.picks(self, memory)

    refused(r"Mine\.picks sets self\.gain", picks=picks)


@pytest.mark.parametrize("draw", [lambda n: np.random.rand(), lambda n: np.random.rand(n)])  # noqa: NPY002
def test_numbers_drawn_by_numpy_are_compiled_in(draw):
    def act(self, memory, seen, key):
        turn = jnp.ones(N) * draw(N)
        return memory, Command(turn, turn)

    refused(
        r"Mine\.act returns something else each time .* draw random numbers by jax\.random from its key",
        act=act,
    )


def test_random_keys_in_the_memory():
    def init(self, n_robots, key):
        return {"keys": jax.random.split(key, n_robots)}

    refused(r"Mine\.init must return numbers .* keep jax\.random\.key_data\(key\)", init=init)


def test_a_memory_that_is_forgotten():
    refused(
        r"Mine\.act must return \(memory, Command\) \(got a Command\)",
        act=lambda self, memory, seen, key: Command(*jnp.zeros((2, N))),
    )


def test_the_remedy_is_that_of_the_mistake():
    def act(self, memory, seen, key):
        return memory, Command(jnp.zeros((N, 1)), jnp.zeros(N))

    refused(
        rf"float32\[{N}\] as .turn of its command \(got float32\[{N}, 1\]\); return one of that shape",
        act=act,
    )

    def whole(self, memory, seen, key):
        return memory, Command(jnp.zeros(N, int), jnp.zeros(N))

    refused(r"\(got int32\[5\]\); convert it, for instance with astype", act=whole)

    def renames(self, memory, seen, key):
        return {"count": memory["steps"]}, Command(*jnp.zeros((2, N)))

    same = r"as its memory as it was given \(got dict of 1 array\), without .*, with .*"
    refused(rf"Mine\.act must return dict of 1 array {same}; return the same type", act=renames)

    def shortens(self, memory, *_):
        return {"steps": memory["steps"][1:]}

    refused(
        rf"Mine\.listen must return float32\[{N}\] as \['steps'\] of its memory as it was given "
        r"\(got float32\[4\]\)",
        listen=shortens,
        **speaks(3),
    )


def test_messages_have_room_and_sides():
    """The number of one of six sides takes three bits."""

    def act(self, memory, seen, key):
        turn = jnp.where(seen.is_heard, seen.payload["word"], 0).sum(axis=1) * 1.0
        return memory, Command(turn, turn)

    check(act=act, **speaks(28))
    refused("29 bits .* by 1 bits", **speaks(29))
    with pytest.raises(UserError, match=r"29 bits .* by 1 bits"):
        check(Teams({"one": (2, mine(**speaks(14))), "two": (3, mine(**speaks(15, "other")))}))


def test_teams_sense_what_their_own_robots_do():
    def act(self, memory, seen, key):
        return memory, Command(seen.sensed["light"], seen.sensed["light"])

    teams = Teams({"one": (2, mine(act=act)), "two": (3, mine(act=act))})
    check(teams, sensed={"light": jax.ShapeDtypeStruct((N,), jnp.float32)})


def test_power_is_within_its_bounds():
    dim = mine(led_power=lambda self, memory: memory["steps"])
    np.testing.assert_array_equal(led_power(dim, {"steps": jnp.array([-1, 0.5, 3])}), [0, 0.5, 1])


def test_what_is_recorded_has_a_name_and_a_unit():
    for wrong in ("steps", {"steps": 3}):
        refused(
            r"Mine\.recorded must be a tuple of names .* or a dictionary of names and units",
            recorded=wrong,
        )
    refused("names 'stride', which its memory lacks .it has steps.;", recorded=("stride",))

    remembers_one_array = {
        "init": lambda self, n_robots, key: jnp.zeros(n_robots),
        "picks": lambda self, memory: memory < 1,
    }
    refused(
        "names 'steps', which its memory lacks .it has no parts with names.;",
        recorded=("steps",),
        **remembers_one_array,
    )


class Colour(Enum):
    RED = 1


@dataclass
class Many(Walk):
    """Strategy with fields of all kinds, of which the numbers from 1 to 6 are arrays."""

    say = Walk.picks
    colour: Colour = Colour.RED
    file: Path = Path("a")
    word: Literal["x", 3] = "x"
    whole: tuple[int, ...] = (7, 8)
    perhaps: int | None = 9
    several: tuple[float, ...] = (2.0, 3.0)
    mixed: tuple[int, float] = (4, 5.0)
    listed: list[int] = field(default_factory=lambda: [6])
    payload: Any = "none"


def test_only_numbers_that_may_change_are_arrays():
    assert jax.tree.leaves(as_strategy(Many())) == [1.0, 2.0, 3.0, 4, 5.0, 6]


def test_errors_name_the_innermost_line_of_the_user():
    def fails(error):
        raise error

    place = r"\(.*test_validation\.py, line \d+: `raise error`\)"
    for error, raised in (
        (ValueError("of mine\nand more"), "ValueError: of mine"),
        (ValueError(), "ValueError"),
        (SystemExit(3), "SystemExit: 3"),
    ):
        sentence = rf"^Mine\.act raised {raised} {place}; correct it there$"
        with pytest.raises(UserError, match=sentence), user_code("Mine.act"):
            fails(error)


def test_arrays_as_conditions_are_errors_that_name_where():
    cure = r"correct it there: arrays hold a value for each robot, so write jnp\.where\(.*`or`"
    refused(
        cure + r", as https://docs\.jax\.dev/.*\.TracerBoolConversionError explains$",
        act=lambda self, memory, seen, key: 1 if seen.at_dust.any() else 2,
    )
    refused(
        r"than one element is ambiguous \(.*\); " + cure + "$",
        act=lambda self, memory, seen, key: 1 if seen.at_dust else 2,
    )


def test_names_of_the_parts_of_a_memory():
    memory = {"state": 1, "home": VectorMemory(2, 3, 4), "pair": (5, [6])}
    parts = {
        "state": 1,
        "home.vector": 2,
        "home.hop": 3,
        "home.known": 4,
        "pair.0": 5,
        "pair.1.0": 6,
    }
    assert parts_of(memory) == parts


def test_parts_of_a_memory_with_other_names_are_named():
    def act(self, memory, seen, key):
        return {"count": memory["steps"]}, Command(*jnp.zeros((2, N)))

    refused(
        r"\(got dict of 1 array\), without \['steps'\], with \['count'\]; return the same type",
        act=act,
    )


def test_what_a_task_lets_robots_sense_is_listed_where_a_strategy_senses_something_else():
    def act(self, memory, seen, key):
        return memory, Command(seen.sensed["is_there"], seen.sensed["is_there"])

    sensed = {
        "light": jax.ShapeDtypeStruct((N,), jnp.float32),
        "east": jax.ShapeDtypeStruct((N,), jnp.float32),
    }
    line = act.__code__.co_firstlineno + 1
    place = rf"\(.*test_validation.py, line {line}\)"
    words = rf"^Mine.act reads sensed\['is_there'\] {place}, but of its own the task offers east, light;"
    with pytest.raises(UserError, match=words):
        check(sensed=sensed, act=act)
    with pytest.raises(UserError, match="offers nothing; choose a task that offers it"):
        check(act=act)


def test_other_missing_keys_are_errors_of_their_own():
    def act(self, memory, seen, key):
        return memory["age"], None

    refused("Mine.act raised KeyError: 'age'", act=act)

    def act_without_a_key(self, memory, seen, key):
        raise KeyError

    refused(r"Mine.act raised KeyError \(", act=act_without_a_key)
