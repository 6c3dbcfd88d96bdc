"""Worlds of one run: their starts, keys and sizes, and what is refused."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.mjx import compilations
from support.runs import N, poses_of, records, run_of
from support.settings import refused_setting
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
N_BALLS = 24
"""Balls of the small arena."""

DAMP = GripperConfig(relative_humidity=80.0, work_tool_object=2e-3)
HUMID = replace(SMALL, gripper=DAMP)
QUIET = replace(SMALL, optics=OpticsConfig(error_distance_measure=0.0))
VARIED = [
    World(TYPE1, 9),
    World(PRESETS["type2"], 1, seed=2**32 - 2, index=2**32 - 1, config=HUMID),
    World(TYPE1, 30, seed=2**31, index=4095, failed_fraction=0.29, config=QUIET),
    World(
        PRESETS["evolved"],
        12,
        seed=5,
        index=1,
        failed_fraction=1.0,
        config=replace(HUMID, optics=QUIET.optics),
    ),
]
"""Worlds that differ in all that a start depends on."""


class TestStarts:
    """Starts of the worlds above, drawn again here step by step."""

    N_DEAD = {0.0: 0, 0.29: 9, 1.0: 12}  # noqa: RUF012
    """Dead robots of these worlds, by the fraction that failed."""

    @staticmethod
    def cells():
        """Return the free cells: 15^2 less the 3^2 of the dump, row by row."""
        numbers = np.arange(-7, 8)
        grid = np.stack(np.meshgrid(numbers, numbers, indexing="ij"), axis=-1).reshape(-1, 2)
        return RD * grid[np.abs(grid).max(axis=1) > 1.5]

    @pytest.mark.parametrize("row", range(len(VARIED)))
    def test_are_drawn_as_one_by_one(self, small, row):
        world = VARIED[row]
        start = starts_of(small, CLEANING, read_robot(), VARIED)[row]
        rng = np.random.default_rng([world.seed, world.index])
        shared_by_seed = np.random.default_rng([world.seed, 2**32 - 1])

        cells = self.cells()
        places = cells[rng.choice(len(cells), world.n_robots, replace=False)]
        yaw = rng.uniform(-np.pi, np.pi, world.n_robots)
        np.testing.assert_array_equal(start.poses, np.column_stack([places, yaw]))

        # Half of the balls lie in an area of 3 x 3 rd to the west, half to the east.
        middle = np.where(np.arange(N_BALLS) < N_BALLS // 2, -5, 5)[:, None] * [1, 0]
        position = 3 * rng.uniform(-0.5, 0.5, (N_BALLS, 2)) + middle
        balls = start.task
        np.testing.assert_array_equal(balls.position, (position * RD).astype(np.float32))
        radii = shared_by_seed.uniform(15e-6, 25e-6, N_BALLS)
        np.testing.assert_array_equal(balls.radius, radii.astype(np.float32))

        n_dead = self.N_DEAD[world.failed_fraction]
        dead = rng.permutation(world.n_robots)[:n_dead]
        is_dead = np.isin(np.arange(world.n_robots), dead)
        np.testing.assert_array_equal(start.is_alive, ~is_dead)

    @pytest.mark.parametrize("row", range(len(VARIED)))
    @pytest.mark.parametrize("name", ["work_tool_object", "work_object_substrate"])
    def test_works_of_adhesion_are_those_of_the_air(self, small, row, name):
        """They double from 10 % to 80 % relative humidity."""
        start = starts_of(small, CLEANING, read_robot(), VARIED)[row]
        gripper = (VARIED[row].config or small).gripper
        factor = 2.0 if gripper == DAMP else 1.0
        work = np.float32(factor * getattr(gripper, name))
        np.testing.assert_array_equal(getattr(start.task, name), np.full(N_BALLS, work))


class TestKeys:
    def test_are_folded_from_seed_and_index(self):
        keys = random_keys(VARIED)
        assert keys.shape == (len(VARIED),)
        for key, world in zip(keys, VARIED, strict=True):
            assert key == jax.random.fold_in(jax.random.key(world.seed), world.index)

    @pytest.mark.parametrize("impl", ["threefry2x32", "rbg"])
    def test_may_be_given_and_of_any_kind(self, impl):
        own_keys = jax.random.split(jax.random.key(3, impl=impl), len(VARIED))
        worlds = [replace(world, key=key) for world, key in zip(VARIED, own_keys, strict=True)]
        keys = random_keys(worlds)
        assert jax.random.key_impl(keys) == jax.random.key_impl(own_keys)
        assert (keys == own_keys).all()

    @pytest.mark.parametrize(
        "key", [3, jax.random.split(jax.random.key(0), 2), np.zeros(2, np.uint32)], ids=str
    )
    def test_of_a_world_are_one_key(self, key):
        with pytest.raises(UserError, match=r"^key must be one random key, as .*\(got "):
            World(TYPE1, 5, key=key)


def test_no_program_is_compiled_for_a_number_of_worlds(small):
    def prepare(n_worlds):
        """Return the names of the programs that the parameters of worlds take."""
        worlds = [World(TYPE1, 5, index=index) for index in range(n_worlds)]
        with compilations() as names:
            strategies = vector_strategies(small, read_robot(), worlds)
            scenario = Scenario(small, engine=PlanarSettings(), worlds=worlds, steps=1)
            setup = set_up(scenario, scenario.settings())
            world_params(setup, random_keys(worlds), strategies)
        return names

    prepare(2)
    assert prepare(37) == []


@pytest.mark.parametrize(
    ("sizes", "capacity", "has_empty_places"),
    [((5,), None, False), ((5,), 7, True), ((3, 5), None, True)],
)
def test_engines_are_told_whether_places_are_empty(small, sizes, capacity, has_empty_places):
    worlds = [World(TYPE1, n_robots) for n_robots in sizes]
    scenario = Scenario(small, engine=PlanarSettings(), worlds=worlds, steps=1)
    setup = set_up(scenario, scenario.settings(capacity=capacity))
    assert setup.model.is_masked == has_empty_places


def test_absent_robots_do_nothing(small):
    """One of two worlds has robots in all N places, as in other tests, and one in twelve."""
    sizes = (N, 12)
    worlds = [World(TYPE1, n_robots, index=index) for index, n_robots in enumerate(sizes)]
    run = run_of(small, worlds=worlds, steps=12)

    before = poses_of(run)
    for record in records(run):
        distance = np.linalg.norm((record.poses - before)[..., :2], axis=-1)
        before = record.poses
        for world, n_robots in enumerate(sizes):
            valid = record.links.valid[world]
            assert record.speed[world] == pytest.approx(distance[world, :n_robots].mean())
            assert not record.poses[world, n_robots:].any()
            assert not valid[n_robots:].any()
            assert (record.links.sender[world][valid] < n_robots).all()
            assert not record.has_priority[world, n_robots:].any()

            balls = record.swarm.task
            holders = balls.holder[world][balls.is_held[world]]
            assert (holders < n_robots).all()

        _, state = run.arrays()
        assert state.touching[1].max() < sizes[1]


def with_ball(part, ball, value):
    """Return a change of one ball of a start."""

    def change(start):
        values = getattr(start.task, part).copy()
        values[ball] = value
        return start._replace(task=start.task._replace(**{part: values}))

    return change


class TestRefusedStarts:
    """Starts of five robots, of which robots 1 and 4 hold balls 2 and 3.

    Other balls have holder 0.
    """

    @pytest.fixture
    def world(self, small):
        start = start_of(small, 5, 0, 0)
        for ball, robot in ((2, 1), (3, 4)):
            start = with_ball("holder", ball, robot)(start)
            start = with_ball("is_held", ball, True)(start)
        return World(TYPE1, 5, start=start)

    def test_this_one_is_right(self, small, world):
        """Also beside a world of another size."""
        _, start = starts_of(small, CLEANING, read_robot(), [World(TYPE1, 3), world])
        assert start is not None

    @pytest.mark.parametrize(
        ("change", "says"),
        [
            (
                lambda start: start._replace(poses=start.poses[:4]),
                r"start\.poses must be an array of shape \(5",
            ),
            (
                lambda start: start._replace(is_alive=start.is_alive[:4]),
                r"start\.is_alive must be an array of shape \(5",
            ),
            (
                lambda start: start._replace(task=jax.tree.map(lambda a: a[:7], start.task)),
                r"start\.task\.position must be an array of shape \(24, 2\) \(got \(7, 2\)\)",
            ),
            (
                lambda start: start._replace(task={"light": np.zeros(5)}),
                r"start\.task must be as the task lays it out, .*Balls",
            ),
            (
                with_ball("position", 2, (0, -21.5)),
                r"start\.task\.position must be within .*ball 2 at \[0\.0, -21\.5",
            ),
            (with_ball("radius", 23, 0.0), r"start\.task\.radius must be above 0 \(got 0"),
            (
                with_ball("work_tool_object", 1, -1e-3),
                r"start\.task\.work_tool_object must be above 0 \(got -0\.001",
            ),
            (with_ball("holder", 0, 5), r"start\.task\.holder must be robots, 0 to 4 \(got"),
            (with_ball("holder", 0, -1), r"start\.task\.holder must be robots, 0 to 4 \(got"),
            (
                with_ball("is_delivered", 3, True),
                r"start\.task\.is_held must be false for delivered balls \(got \[3\]",
            ),
            (
                with_ball("holder", 3, 1),
                r"start\.task\.holder must be another robot for each held ball \(got \[1, 1\]",
            ),
        ],
    )
    def test_others_are_not(self, small, world, change, says):
        world = replace(world, start=change(world.start))
        with pytest.raises(ConfigError, match=says):
            starts_of(small, CLEANING, read_robot(), [world])


class TestRefusedRuns:
    @pytest.mark.parametrize(
        "values", [{"n_robots": 0}, {"seed": -1}, {"index": -1}, {"failed_fraction": 5.0}], ids=str
    )
    def test_worlds_out_of_range(self, values):
        ((name, value),) = values.items()
        with refused_setting(name, value):
            World(**{"genome": TYPE1, "n_robots": 5, **values})

    @pytest.mark.parametrize("worlds", [[], "", [3], 0, True], ids=str)
    def test_no_worlds(self, small, worlds):
        with refused_setting(
            "worlds", worlds, "a number above 0, a World for each, or a random key"
        ):
            Scenario(small, strategy=TYPE1, robots=5, worlds=worlds, steps=3)

    def test_more_robots_than_in_the_largest_world(self, small):
        worlds = [World(TYPE1, 5)]
        scenario = Scenario(small, strategy=TYPE1, robots=6, worlds=worlds, steps=3)
        with refused_setting("robots", 6, "that of the largest world, 5"):
            Run(scenario)

    @pytest.mark.parametrize("engine", ["mjx", 3, MujocoSettings], ids=str)
    def test_engines_that_are_no_settings(self, small, engine):
        with refused_setting("engine", engine, "settings of an engine, as MujocoSettings()"):
            Run(Scenario(small, strategy=TYPE1, robots=5, engine=engine, steps=3))

    def test_more_deliveries_than_balls(self, small):
        scenario = Scenario(small, strategy=TYPE1, robots=5, steps=3, goal=N_BALLS)
        assert Run(scenario).goal == N_BALLS
        with refused_setting("stop_at", N_BALLS + 1, "between 1 and the goal of Cleaning, 24"):
            Run(replace(scenario, goal=N_BALLS + 1))

    def test_strategies_without_an_axis_of_worlds(self, small):
        strategy = vector_strategies(small, read_robot(), [World(TYPE1, 5)] * 2)
        scenario = Scenario(small, strategy=strategy, robots=5, steps=3, strategy_per_world=True)
        says = r"array of shape \(2,\); .* that of the 1 worlds"
        with pytest.raises(UserError, match=says):
            Run(scenario)


def test_the_number_of_scouts_is_rounded(small):
    """It follows from the genome and the robots of each world."""
    shares_and_sizes = ((0.27, 10), (0.23, 10), (0.5, 7))
    worlds = [
        World(replace(TYPE1, fraction_scouts=share), n_robots)
        for share, n_robots in shares_and_sizes
    ]
    scenario = Scenario(small, strategy=TYPE1, robots=10, worlds=worlds, steps=1)
    run = Run(scenario, record_worlds=(0, 1, 2))
    n_scouts = run.start.swarm.memory.is_scout[0].sum(axis=1)
    assert n_scouts.tolist() == [3, 2, 4]
