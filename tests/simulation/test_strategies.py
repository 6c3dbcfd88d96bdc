"""Strategies of users in runs: pytrees, one for each world, stated in results."""

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.stacking import to_json
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.validation import as_strategy
from iswarm_mj.utils.errors import UserError

ENGINE = MujocoSettings(1)
TYPE1 = PRESETS["type1"]
TYPE2 = PRESETS["type2"]


class Still(Strategy):
    """Robots that stand, without parameters."""

    recorded = ("home",)

    def init(self, n_robots, key):
        return {"home": jnp.tile(jnp.array([3.0, 4.0]), (n_robots, 1))}

    def picks(self, memory):
        return memory["home"][:, 0] > 0

    def act(self, memory, observation, key):
        n_robots = len(observation.at_dust)
        return memory, Command(jnp.zeros(n_robots), jnp.zeros(n_robots))


@dataclass
class Ahead(Still):
    """Robots that go ahead, the farther the more robots their world has."""

    stride: float = 0.1
    steps: int = 1
    per_robot: float = field(default=0.0, metadata={"static": True})
    recorded = {"home": "mm"}  # noqa: RUF012

    def __post_init__(self):
        if self.stride < 0:
            raise ValueError("stride")

    def for_world(self, config, robot, n_robots):
        return Ahead(self.stride * n_robots * config.drive.loaded_speed)

    def act(self, memory, observation, key):
        n_robots = len(observation.at_dust)
        distance = sum(self.stride for _ in range(self.steps))
        return memory, Command(jnp.zeros(n_robots), jnp.full(n_robots, distance))


def first_distances(run):
    """Return the distances of the robots [mm] in the first step of each world (W, N)."""
    record = run.advance()
    positions = record.poses[0, ..., :2]
    start = run.start.poses[0, ..., :2]
    return np.linalg.norm(positions - start, axis=-1)


class TestWorlds:
    def test_each_world_gets_a_strategy_of_its_own(self, small):
        """It follows from its robots, and from its configuration if it has one."""
        slow = replace(small, drive=replace(small.drive, loaded_speed=0.5))
        worlds = [World(TYPE1, 2), World(TYPE1, 5), World(TYPE1, 5, config=slow)]
        scenario = Scenario(small, strategy=Ahead(), engine=ENGINE, worlds=worlds, steps=2)
        distances = first_distances(Run(scenario, record_worlds=(0, 1, 2)))
        for world, expected in enumerate((0.2, 0.5, 0.25)):
            n_robots = worlds[world].n_robots
            np.testing.assert_allclose(distances[world, :n_robots], expected, atol=0.02)

    def test_robots_begin_by_the_key_of_their_world(self, small):
        class RandomHome(Still):
            def init(self, n_robots, key):
                return {"home": jax.random.uniform(key, (n_robots, 2))}

        worlds = [World(TYPE1, 2, seed=seed) for seed in (3, 4)]
        scenario = Scenario(small, strategy=RandomHome(), engine=ENGINE, worlds=worlds, steps=1)
        start = Run(scenario, record_worlds=(0, 1)).start
        for world, home in zip(worlds, start.swarm.memory["home"][0], strict=True):
            np.testing.assert_allclose(home, jax.random.uniform(world.random_key, (2, 2)))


class TestResults:
    def test_state_a_strategy_in_place_of_a_genome(self, small):
        run = Run(Scenario(small, strategy=Ahead(0.3), robots=4, engine=ENGINE, steps=2))
        strategy = {"class": "Ahead", "stride": 0.3, "steps": 1, "per_robot": 0.0}
        assert run.rules == {"strategy": strategy, "task": {"class": "Cleaning"}}

    def test_a_run_has_the_genome_of_its_worlds(self, small):
        run = Run(Scenario(small, strategy=TYPE2, robots=4, engine=ENGINE, steps=2))
        assert run.genome == TYPE2
        assert run.strategy is None
        with pytest.raises(UserError, match="worlds have their own"):
            Run(Scenario(small, strategy=PRESETS["evolved"], robots=4, worlds=run.worlds, steps=2))

    def test_large_arrays_are_stated_by_their_shapes(self):
        strategy = Ahead(2.0, np.arange(64), np.zeros((5, 13), np.float32))
        assert to_json(strategy) == {
            "class": "Ahead",
            "stride": 2.0,
            "steps": list(range(64)),
            "per_robot": "float32[5, 13]",
        }


def test_defaults_are_those_of_the_command(small):
    run = Run(Scenario(small, strategy=Still(), engine=ENGINE))
    n_robots = Run(Scenario(small, engine=ENGINE)).settings.n_robots
    assert run.settings.steps == 800
    assert run.settings.n_robots == n_robots


class TestPrograms:
    @pytest.mark.parametrize("factor", [1, 3])
    def test_classes_with_the_same_fields_have_their_own(self, small, factor):
        """JAX takes the structures of such dataclasses for equal, although their methods differ."""

        @jax.tree_util.register_dataclass
        @dataclass(frozen=True)
        class Walks(Still):
            stride: object

            def act(self, memory, observation, key):
                n_robots = len(observation.at_dust)
                distance = jnp.full(n_robots, factor * self.stride)
                return memory, Command(jnp.zeros(n_robots), distance)

        strategy = Walks(jnp.float32(0.1))
        run = Run(Scenario(small, strategy=strategy, robots=4, engine=ENGINE, steps=2))
        np.testing.assert_allclose(first_distances(run)[0], 0.1 * factor, atol=0.02)

    def test_what_is_no_number_is_compiled_in(self):
        strategy = Ahead(0.3, 2, 5.0)
        leaves, structure = jax.tree.flatten(as_strategy(strategy))
        assert leaves == [0.3]
        assert jax.tree.unflatten(structure, leaves) == strategy


@dataclass
class Listed(Still):
    """A strategy whose names should be a tuple."""

    names: str = ()


class Attributes(Still):
    """A strategy with attributes that JAX does not see."""

    def __init__(self):
        self.stride = 1.0


@pytest.mark.parametrize(
    ("strategy", "says"),
    [
        (Still, r"is the class Still itself; give an object of it, as Still\(\)"),
        (
            Attributes(),
            r"Attributes has attributes \(stride\) but is not a dataclass; write @dataclass",
        ),
        (
            Listed(["a"]),
            "Listed.names is compiled in and must not change, but is a list; use a tuple",
        ),
        (3.0, "float is not a strategy, since it does not derive from Strategy"),
    ],
    ids=["a class", "no dataclass", "a list", "a number"],
)
def test_others_are_refused(small, strategy, says):
    with pytest.raises(UserError, match=says):
        Run(Scenario(small, strategy=strategy, robots=2, engine=ENGINE, steps=1))
