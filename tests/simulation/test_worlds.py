"""Worlds of one run: they may differ in size, and what does not fit is refused."""

import numpy as np
import pytest
from helpers_runs import N, poses_of, records, run_of

from iswarm_mj.simulation.initial import draw_start
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import MujocoSettings, RunSettings
from iswarm_mj.simulation.worlds import World, vector_strategies
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import ConfigError, UserError

TYPE1 = PRESETS["type1"]
CROWD = 100
"""Robots in the densest swarm, and the capacity of another one, which shares its program."""


class TestWorldsOfDifferentSize:
    SIZES = (12, N, 1)
    """Robots; a program for N is shared with the other tests."""

    def worlds(self):
        return [World(TYPE1, n, index=index) for index, n in enumerate(self.SIZES)]

    def test_each_is_as_if_alone(self, small):
        """Robots that a world lacks are in its model, out of the way: only contact forces round otherwise."""
        run = run_of(small, worlds=self.worlds(), steps=60)
        together = list(records(run))
        for world, n_robots in enumerate(self.SIZES):
            alone = run_of(small, worlds=self.worlds()[world : world + 1] * 3, n_robots=n_robots, steps=60, capacity=N)
            for one, many in zip(records(alone), together, strict=True):
                np.testing.assert_allclose(many.poses[world], one.poses[0], atol=1e-8 if n_robots == 12 else 0, rtol=0)
                np.testing.assert_array_equal(many.links.valid[world], one.links.valid[0])
                assert many.collisions[world] == one.collisions[0]
            assert run.measures(world) == alone.measures(0)
        assert run.measures(0).collisions > 0 and run.measures(0).picked > 0 and run.measures(2).collisions == 0

    def test_absent_robots_do_nothing(self, small):
        run = run_of(small, worlds=self.worlds(), steps=20)
        before = poses_of(run)
        for record in records(run):
            step = np.linalg.norm((record.poses - before)[..., :2], axis=-1)
            before = record.poses
            for world, n_robots in enumerate(self.SIZES):
                assert record.speed[world] == pytest.approx(step[world, :n_robots].mean())
                assert not record.poses[world, n_robots:].any()
                assert not record.links.valid[world, n_robots:].any()
                assert (record.links.sender[world][record.links.valid[world]] < n_robots).all()
                balls = record.swarm.balls
                assert (balls.holder[world][balls.is_held[world]] < n_robots).all()
                assert not record.has_priority[world, n_robots:].any()
            _, state = run.arrays()
            assert not state.touching[0, :, 12:].any() and not state.touching[2].any()


class TestWhatDoesNotFit:
    @pytest.mark.parametrize("field", ["poses", "is_alive"])
    def test_starts_of_other_sizes(self, small, field):
        start = draw_start(small, 5, 0, 0)
        start = start._replace(**{field: getattr(start, field)[:4]})
        with pytest.raises(ConfigError, match=rf"start\.{field} must be an array of shape \(5"):
            Run(small, TYPE1, RunSettings(5, 3), worlds=[World(TYPE1, 5, start=start)])

    def test_starts_with_other_balls(self, small):
        start = draw_start(small, 5, 0, 0)
        start = start._replace(balls=start.balls._replace(radius=start.balls.radius[:7]))
        with pytest.raises(ConfigError, match=r"start\.balls\.radius must be an array of 24 balls \(got \(7,\)\)"):
            Run(small, TYPE1, RunSettings(5, 3), worlds=[World(TYPE1, 5, start=start)])

    @pytest.mark.parametrize("values", [{"n_robots": 0}, {"seed": -1}, {"index": -1}, {"failed_fraction": 5.0}])
    def test_worlds(self, values):
        with pytest.raises(ConfigError, match=next(iter(values))):
            World(**{"genome": TYPE1, "n_robots": 5, **values})

    def test_a_run_of_more_robots_than_its_worlds(self, small):
        with pytest.raises(ConfigError, match=r"n_robots must be that of the largest world, 5 \(got 6\)"):
            Run(small, TYPE1, RunSettings(6, 3), worlds=[World(TYPE1, 5)])

    @pytest.mark.parametrize("engine", ["mjx", 3, MujocoSettings], ids=str)
    def test_engines(self, small, engine):
        with pytest.raises(ConfigError, match="engine must be MujocoSettings or PlanarSettings or MjxSettings"):
            Run(small, TYPE1, RunSettings(5, 3), engine)

    def test_more_deliveries_than_balls(self, small):
        with pytest.raises(ConfigError, match=r"stop_at must be between 1 and the number of balls, 24 \(got 25\)"):
            Run(small, TYPE1, RunSettings(5, 3, stop_at=25))

    def test_strategies_without_an_axis_of_worlds(self, small):
        strategy = vector_strategies(small, 0.9, [World(TYPE1, 5)] * 2)
        with pytest.raises(UserError, match=r"first axis of 1 worlds \(got shape \(2,\)\)"):
            Run(small, TYPE1, RunSettings(5, 3), strategy=strategy)

    def test_measures_of_a_world_that_is_not_there(self, small):
        run = Run(small, TYPE1, RunSettings(5, 3))
        for world in (-1, 1):
            with pytest.raises(IndexError, match="between 0 and 0"):
                run.measures(world)
