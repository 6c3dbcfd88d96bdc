"""What is found wrong with a strategy before it runs: what its methods return, and what they do beside."""

from dataclasses import dataclass
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.contract import shapes_of
from iswarm_mj.strategy.declared import parts_of
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.pytrees import as_strategy
from iswarm_mj.strategy.signatures import check_strategies
from iswarm_mj.utils.errors import UserError

N, S = 5, 6


@dataclass
class Walk:
    """Robots that count their steps."""

    gain: float = 1.0

    def init(self, n_robots, key):
        return {"steps": jnp.zeros(n_robots)}

    def picks(self, memory):
        return memory["steps"] >= 0

    def act(self, memory, seen, key):
        return {"steps": memory["steps"] + self.gain}, Command(*jnp.zeros((2, *seen.at_dust.shape)))


def check(**methods):
    """Check a strategy like `Walk` but for some of its methods."""
    given = as_strategy(dataclass(type("Mine", (Walk,), methods))())
    check_strategies(jax.tree.map(lambda a: jnp.asarray(a)[None], given), N, S)


def refused(words, **methods):
    with pytest.raises(UserError, match=words):
        check(**methods)


def test_shapes_are_those_of_the_annotations():
    shapes = shapes_of(Observation, N=N, S=S)
    assert shapes["is_heard"] == jax.ShapeDtypeStruct((N, S), bool) and shapes["led"].dtype == jnp.int32
    assert shapes["ball_vector"] == jax.ShapeDtypeStruct((N, 2), jnp.float32)
    assert "payload" not in shapes and "sensed" not in shapes


def test_what_depends_on_the_arguments_alone_is_accepted():
    table = np.array([np.nan, 1.0])
    is_closed_over = jax.random.key(3)

    def act(self, memory, seen, key):
        turn = jax.nn.relu(jax.random.uniform(is_closed_over, seen.at_dust.shape)) * self.twice * table[1]
        turn = jnp.where(jnp.isnan(jnp.asarray(table)).any(), turn, 0.0)
        return memory, Command(turn, turn)

    twice = cached_property(lambda self: 2 * self.gain)
    twice.__set_name__(Walk, "twice")
    check(act=act, twice=twice)


def test_attributes_set_in_a_step_are_lost():
    def act(self, memory, seen, key):
        self.phase = memory["steps"]
        return Walk.act(self, memory, seen, key)

    refused(r"Mine\.act sets self\.phase, which is lost after the call; keep it in the memory", act=act)

    def picks(self, memory):
        self.gain = self.gain + 1
        return Walk.picks(self, memory)

    refused(r"Mine\.picks sets self\.gain", picks=picks)


@pytest.mark.parametrize("draw", [lambda n: np.random.rand(), lambda n: np.random.rand(n)])  # noqa: NPY002
def test_numbers_drawn_by_numpy_are_compiled_in(draw):
    def act(self, memory, seen, key):
        turn = jnp.ones(N) * draw(N)
        return memory, Command(turn, turn)

    refused(r"Mine\.act returns something else each time .* draw random numbers by jax\.random from its key", act=act)


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

    refused(rf"float32\[{N}\] as .turn of its command \(got float32\[{N}, 1\]\); return one of that shape", act=act)

    def whole(self, memory, seen, key):
        return memory, Command(jnp.zeros(N, int), jnp.zeros(N))

    refused(r"\(got int32\[5\]\); convert it, for instance with astype", act=whole)


def test_names_of_the_parts_of_a_memory():
    memory = {"state": 1, "home": VectorMemory(2, 3, 4), "pair": (5, [6])}
    parts = {"state": 1, "home.vector": 2, "home.hop": 3, "home.known": 4, "pair.0": 5, "pair.1.0": 6}
    assert parts_of(memory) == parts
