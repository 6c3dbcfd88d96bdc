"""What becomes of a user's strategy: a pytree, for all worlds, recorded."""

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.simulation.given import to_json
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.pytrees import as_strategy
from iswarm_mj.utils.errors import UserError

HERE = MujocoSettings(1)


class Still(Strategy):
    """Robots that stand, without parameters."""

    recorded = ("home",)

    def init(self, n_robots, key):
        return {"home": jnp.tile(jnp.array([3.0, 4.0]), (n_robots, 1))}

    def picks(self, memory):
        return memory["home"][:, 0] > 0

    def act(self, memory, seen, key):
        return memory, Command(*jnp.zeros((2, len(seen.at_dust))))


@dataclass
class Ahead(Still):
    """Robots that go ahead, as far as their world says."""

    stride: float = 0.1
    steps: int = 1
    per_robot: float = field(default=0.0, metadata={"static": True})
    recorded = {"home": "mm"}  # noqa: RUF012

    def __post_init__(self):
        if self.stride < 0:
            raise ValueError("stride")

    def for_world(self, config, robot, n_robots):
        return Ahead(self.stride * n_robots * config.drive.loaded_speed)

    def act(self, memory, seen, key):
        n = len(seen.at_dust)
        moved = sum(self.stride for _ in range(self.steps))
        return memory, Command(jnp.zeros(n), jnp.full(n, moved))


def moved_by(run):
    """Distances of the robots [mm] in the first step of each world (W, N)."""
    record = run.advance()
    return np.linalg.norm(record.poses[0, ..., :2] - run.start.poses[0, ..., :2], axis=-1)


class TestRuns:
    def test_each_world_gets_its_own(self, small):
        """By its robots, and by its configuration if it has one."""
        slow = replace(small, drive=replace(small.drive, loaded_speed=0.5))
        worlds = [World(PRESETS["type1"], 2), World(PRESETS["type1"], 5), World(PRESETS["type1"], 5, config=slow)]
        scenario = Scenario(small, strategy=Ahead(), engine=HERE, worlds=worlds, steps=2)
        moved = moved_by(Run(scenario, record_worlds=(0, 1, 2)))
        for world, (n_robots, way) in enumerate(((2, 0.2), (5, 0.5), (5, 0.25))):
            np.testing.assert_allclose(moved[world, :n_robots], way, atol=0.02)

    def test_robots_begin_by_the_key_of_their_world(self, small):
        class Drawn(Still):
            def init(self, n_robots, key):
                return {"home": jax.random.uniform(key, (n_robots, 2))}

        worlds = [World(PRESETS["type1"], 2, seed=seed) for seed in (3, 4)]
        scenario = Scenario(small, strategy=Drawn(), engine=HERE, worlds=worlds, steps=1)
        home = Run(scenario, record_worlds=(0, 1)).start.swarm.memory["home"]
        for world, mine in zip(worlds, home[0], strict=True):
            np.testing.assert_allclose(mine, jax.random.uniform(world.random_key, (2, 2)))

    def test_is_given_in_place_of_a_genome(self, small):
        run = Run(Scenario(small, strategy=Ahead(0.3), robots=4, engine=HERE, steps=2))
        stated = {"class": "Ahead", "stride": 0.3, "steps": 1, "per_robot": 0.0}
        assert run.rules == {"strategy": stated, "task": {"class": "Cleaning"}}
        one = Run(Scenario(small, strategy=PRESETS["type2"], robots=4, engine=HERE, steps=2))
        assert one.genome == PRESETS["type2"] and one.strategy is None
        with pytest.raises(UserError, match="worlds have their own"):
            Run(Scenario(small, strategy=PRESETS["evolved"], robots=4, worlds=one.worlds, steps=2))

    def test_large_arrays_are_stated_by_their_shapes(self):
        stated = to_json(Ahead(2.0, np.arange(64), np.zeros((5, 13), np.float32)))
        assert stated == {"class": "Ahead", "stride": 2.0, "steps": list(range(64)), "per_robot": "float32[5, 13]"}

    def test_defaults_are_those_of_the_command(self, small):
        run = Run(Scenario(small, strategy=Still(), engine=HERE))
        assert (run.settings.steps, run.settings.n_robots) == (800, Run(Scenario(small, engine=HERE)).settings.n_robots)

    def test_classes_with_the_same_fields_have_programs_of_their_own(self, small):
        """JAX takes the structures of such dataclasses for equal, although their methods differ."""

        def walks(share):
            @jax.tree_util.register_dataclass
            @dataclass(frozen=True)
            class Walks(Still):
                stride: object

                def act(self, memory, seen, key):
                    n = len(seen.at_dust)
                    return memory, Command(jnp.zeros(n), jnp.full(n, share * self.stride))

            return Walks(jnp.float32(0.1))

        for share in (1, 3):
            moved = moved_by(Run(Scenario(small, strategy=walks(share), robots=4, engine=HERE, steps=2)))
            np.testing.assert_allclose(moved[0], 0.1 * share, atol=0.02)

    def test_what_is_no_number_is_compiled_in(self):
        leaves, structure = jax.tree.flatten(as_strategy(Ahead(0.3, 2, 5.0)))
        assert leaves == [0.3]
        again = jax.tree.unflatten(structure, leaves)
        assert again == Ahead(0.3, 2, 5.0)

    def test_refused(self, small):
        @dataclass
        class Listed(Still):
            names: str = ()

        class Attributes(Still):
            def __init__(self):
                self.stride = 1.0

        for strategy, words in (
            (Still, r"is the class Still itself; give an object of it, as Still\(\)"),
            (Attributes(), r"Attributes has attributes \(stride\) but is not a dataclass; write @dataclass"),
            (Listed(["a"]), "Listed.names is compiled in and must not change, but is a list; use a tuple"),
            (3.0, "float is not a strategy, since it does not derive from Strategy"),
        ):
            with pytest.raises(UserError, match=words):
                Run(Scenario(small, strategy=strategy, robots=2, engine=HERE, steps=1))
