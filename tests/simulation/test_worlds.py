"""Worlds of one run: how they begin, that they may differ in size, and what is refused."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.mjx import compilations
from support.runs import N, poses_of, records, run_of
from support.small import SMALL
from support.worlds import start_of

from iswarm_mj.config.swarm import GripperConfig, OpticsConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.simulation.build import world_params
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.setup import set_up
from iswarm_mj.simulation.worlds import World, random_keys, starts_of, vector_strategies
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import RD

TYPE1 = PRESETS["type1"]


DAMP = GripperConfig(relative_humidity=80.0, work_tool_object=2e-3)
HUMID = replace(SMALL, gripper=DAMP)
QUIET = replace(SMALL, optics=OpticsConfig(error_distance_measure=0.0))
VARIED = [
    World(TYPE1, 9),
    World(PRESETS["type2"], 1, seed=2**32 - 2, index=2**32 - 1, config=HUMID),
    World(TYPE1, 30, seed=2**31, index=4095, failed_fraction=0.29, config=QUIET),
    World(PRESETS["evolved"], 12, seed=5, index=1, failed_fraction=1.0, config=replace(HUMID, optics=QUIET.optics)),
]
"""Worlds that differ in all that a start depends on."""


class TestManyWorlds:
    """All worlds of a run at once come to what each gives alone."""

    def test_starts_are_drawn_as_one_by_one(self, small):
        """Step by step, with the cells of each world made anew: 15^2 less the 3^2 of the dump, row by row."""
        every = np.stack(np.meshgrid(np.arange(-7, 8), np.arange(-7, 8), indexing="ij"), axis=-1).reshape(-1, 2)
        cells = RD * every[np.abs(every).max(axis=1) > 1.5]
        for world, start in zip(VARIED, starts_of(small, CLEANING, read_robot(), VARIED), strict=True):
            rng, gripper, n = np.random.default_rng([world.seed, world.index]), (world.config or small).gripper, 24
            at = cells[rng.choice(216, world.n_robots, replace=False)]
            yaw = rng.uniform(-np.pi, np.pi, world.n_robots)
            np.testing.assert_array_equal(start.poses, np.column_stack([at, yaw]))
            offset = 3 * rng.uniform(-0.5, 0.5, (n, 2)) + np.where(np.arange(n) < n // 2, -5, 5)[:, None] * [1, 0]
            np.testing.assert_array_equal(start.task.position, (offset * RD).astype(np.float32))
            humid = 2.0 if gripper == DAMP else 1.0  # at 80 and at 10 %
            for what in ("tool_object", "object_substrate"):
                work = np.float32(humid * getattr(gripper, f"work_{what}"))
                np.testing.assert_array_equal(getattr(start.task, f"work_{what}"), np.full(n, work))
            radii = np.random.default_rng([world.seed, 2**32 - 1]).uniform(15e-6, 25e-6, n)
            np.testing.assert_array_equal(start.task.radius, radii.astype(np.float32))
            is_dead = np.isin(np.arange(world.n_robots), rng.permutation(world.n_robots)[: self.dead(world)])
            np.testing.assert_array_equal(start.is_alive, ~is_dead)

    def dead(self, world):
        return {0.0: 0, 0.29: 9, 1.0: 12}[world.failed_fraction]

    @pytest.mark.parametrize("given", [None, "threefry2x32", "rbg"])
    def test_keys_are_those_of_each_world(self, given):
        """`fold_in` of seed and index, or the key that is given, of any kind."""
        own = jax.random.split(jax.random.key(3, impl=given), len(VARIED))
        worlds = VARIED if given is None else [replace(world, key=own[k]) for k, world in enumerate(VARIED)]
        keys = random_keys(worlds)
        assert keys.shape == (len(VARIED),)
        for key, world, mine in zip(keys, worlds, own, strict=True):
            expected = jax.random.fold_in(jax.random.key(world.seed), world.index) if given is None else mine
            assert key == expected and jax.random.key_impl(key) == jax.random.key_impl(expected)

    def test_no_program_is_compiled_for_a_number_of_worlds(self, small):
        for n_worlds, is_first in ((2, True), (37, False)):
            worlds = [World(TYPE1, 5, index=k) for k in range(n_worlds)]
            with compilations() as names:
                strategies = vector_strategies(small, read_robot(), worlds)
                scenario = Scenario(small, engine=PlanarSettings(), worlds=worlds, steps=1)
                setup = set_up(scenario, scenario.settings())
                world_params(setup, random_keys(worlds), strategies)
            assert is_first or names == []


@pytest.mark.parametrize(("sizes", "capacity", "empty"), [((5,), None, False), ((5,), 7, True), ((3, 5), None, True)])
def test_engines_are_told_whether_places_are_empty(small, sizes, capacity, empty):
    worlds = [World(TYPE1, n) for n in sizes]
    scenario = Scenario(small, engine=PlanarSettings(), worlds=worlds, steps=1)
    assert set_up(scenario, scenario.settings(capacity=capacity)).model.is_masked == empty


class TestWorldsOfDifferentSize:
    SIZES = (N, 12)
    """Robots; a program for N is shared with the other tests."""

    def worlds(self):
        return [World(TYPE1, n, index=index) for index, n in enumerate(self.SIZES)]

    def test_absent_robots_do_nothing(self, small):
        run = run_of(small, worlds=self.worlds(), steps=12)
        before = poses_of(run)
        for record in records(run):
            step = np.linalg.norm((record.poses - before)[..., :2], axis=-1)
            before = record.poses
            for world, n_robots in enumerate(self.SIZES):
                assert record.speed[world] == pytest.approx(step[world, :n_robots].mean())
                assert not record.poses[world, n_robots:].any()
                assert not record.links.valid[world, n_robots:].any()
                assert (record.links.sender[world][record.links.valid[world]] < n_robots).all()
                balls = record.swarm.task
                assert (balls.holder[world][balls.is_held[world]] < n_robots).all()
                assert not record.has_priority[world, n_robots:].any()
            _, state = run.arrays()
            assert state.touching[1].max() < 12


def other(part, ball, value):
    """What changes a ball of a start."""

    def change(start):
        values = getattr(start.task, part).copy()
        values[ball] = value
        return start._replace(task=start.task._replace(**{part: values}))

    return change


class TestWhatDoesNotFit:
    @pytest.mark.parametrize(
        ("change", "words"),
        [
            (lambda s: s._replace(poses=s.poses[:4]), r"start\.poses must be an array of shape \(5"),
            (lambda s: s._replace(is_alive=s.is_alive[:4]), r"start\.is_alive must be an array of shape \(5"),
            (
                lambda s: s._replace(task=jax.tree.map(lambda values: values[:7], s.task)),
                r"start\.task\.position must be an array of shape \(24, 2\) \(got \(7, 2\)\)",
            ),
            (
                lambda s: s._replace(task={"light": np.zeros(5)}),
                r"start\.task must be as the task lays it out, .*Balls",
            ),
            (other("position", 2, (0, -21.5)), r"start\.task\.position must be within .*ball 2 at \[0\.0, -21\.5"),
            (other("radius", 23, 0.0), r"start\.task\.radius must be above 0 \(got 0"),
            (other("work_tool_object", 1, -1e-3), r"start\.task\.work_tool_object must be above 0 \(got -0\.001"),
            (other("holder", 0, 5), r"start\.task\.holder must be robots, 0 to 4 \(got"),
            (other("holder", 0, -1), r"start\.task\.holder must be robots, 0 to 4 \(got"),
            (other("is_delivered", 3, True), r"start\.task\.is_held must be false for delivered balls \(got \[3\]"),
            (other("holder", 3, 1), r"start\.task\.holder must be another robot for each held ball \(got \[1, 1\]"),
        ],
    )
    def test_starts(self, small, change, words):
        """Robots 1 and 4 hold balls 2 and 3; the other ones are those of robot 0."""
        start = start_of(small, 5, 0, 0)
        for where in ((2, 1), (3, 4)):
            start = other("is_held", where[0], True)(other("holder", *where)(start))
        world = World(TYPE1, 5, start=start)
        assert starts_of(small, CLEANING, read_robot(), [World(TYPE1, 3), world])[1] is not None
        with pytest.raises(ConfigError, match=words):
            starts_of(small, CLEANING, read_robot(), [replace(world, start=change(start))])

    @pytest.mark.parametrize("values", [{"n_robots": 0}, {"seed": -1}, {"index": -1}, {"failed_fraction": 5.0}])
    def test_worlds(self, values):
        with pytest.raises(ConfigError, match=next(iter(values))):
            World(**{"genome": TYPE1, "n_robots": 5, **values})

    @pytest.mark.parametrize("worlds", [[], "", [3], 0, True])
    def test_no_worlds(self, small, worlds):
        with pytest.raises(ConfigError, match="worlds must be a number above 0, a World for each, or a random key"):
            Run(Scenario(small, strategy=TYPE1, robots=5, worlds=worlds, steps=3))

    def test_a_run_of_more_robots_than_its_worlds(self, small):
        with pytest.raises(ConfigError, match=r"robots must be that of the largest world, 5 \(got 6\)"):
            Run(Scenario(small, strategy=TYPE1, robots=6, worlds=[World(TYPE1, 5)], steps=3))

    @pytest.mark.parametrize("engine", ["mjx", 3, MujocoSettings], ids=str)
    def test_engines(self, small, engine):
        with pytest.raises(ConfigError, match=r"engine must be settings of an engine, as MujocoSettings"):
            Run(Scenario(small, strategy=TYPE1, robots=5, engine=engine, steps=3))

    def test_more_deliveries_than_balls(self, small):
        with pytest.raises(ConfigError, match=r"stop_at must be between 1 and the goal of Cleaning, 24 \(got 25\)"):
            Run(Scenario(small, strategy=TYPE1, robots=5, steps=3, goal=25))
        assert Run(Scenario(small, strategy=TYPE1, robots=5, steps=3, goal=24)).goal == 24

    def test_strategies_without_an_axis_of_worlds(self, small):
        strategy = vector_strategies(small, read_robot(), [World(TYPE1, 5)] * 2)
        with pytest.raises(UserError, match=r"array of shape \(2,\); .* that of the 1 worlds"):
            Run(Scenario(small, strategy=strategy, robots=5, steps=3, strategy_per_world=True))


def test_the_number_of_scouts_is_rounded(small):
    """In each world by its genome and its robots."""
    worlds = [World(replace(TYPE1, fraction_scouts=share), n) for share, n in ((0.27, 10), (0.23, 10), (0.5, 7))]
    run = Run(Scenario(small, strategy=TYPE1, robots=10, worlds=worlds, steps=1), record_worlds=(0, 1, 2))
    assert run.start.swarm.memory.is_scout[0].sum(axis=1).tolist() == [3, 2, 4]


@pytest.mark.parametrize("key", [3, jax.random.split(jax.random.key(0), 2), np.zeros(2, np.uint32)])
def test_a_world_has_one_key(key):
    with pytest.raises(UserError, match=r"^key must be one random key, as .*\(got "):
        World(TYPE1, 5, key=key)
