"""Layouts: free cells of the arena, numbers of robots, and balls of a seed."""

import numpy as np
import pytest
from support.worlds import start_of

from iswarm_mj.config.swarm import ArenaConfig, GripperConfig, SwarmConfig
from iswarm_mj.tasks import layout
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.foraging import Foraging
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

PAPER = ArenaConfig()
N_CELLS = 2376
"""Free cells of the paper's arena: 49^2 less the 5^2 of the dump."""


class TestCells:
    def test_free_cells_of_the_paper(self):
        cells = layout.free_cells(PAPER)
        assert len(cells) == N_CELLS == 49**2 - 5**2
        assert len(np.unique(cells.round(6), axis=0)) == N_CELLS

        distance = np.abs(cells).max(axis=1)
        assert distance.max() == pytest.approx(24 * RD)
        assert distance.min() == pytest.approx(3 * RD)

    @pytest.mark.parametrize(
        ("density", "n_robots"),
        [(0.118, 280), (0.132, 314), (0.05, 119), (1.0, N_CELLS), (1e-9, 1)],
    )
    def test_density_is_the_share_of_cells_with_robots(self, density, n_robots):
        assert layout.robots_for(PAPER, density) == n_robots

    def test_the_dump_has_cells_of_its_own(self):
        cells = layout.free_cells(PAPER, with_dump=True)
        assert len(cells) == 49**2
        assert layout.robots_for(PAPER, 0.4, with_dump=True) == 960

    @pytest.mark.parametrize("density", [0.0, -0.1, 1.01, np.nan, np.inf])
    def test_density_has_limits(self, density):
        with pytest.raises(UserError, match=r"density must be above 0 and at most 1 \(got"):
            layout.robots_for(PAPER, density)

    @pytest.mark.parametrize("n_robots", [0, -3, N_CELLS + 1])
    def test_there_is_one_robot_a_cell(self, n_robots):
        """Fewer robots are the remedy only where there are too many."""
        remedy = ""
        if n_robots > N_CELLS:
            remedy = "; use fewer robots or a larger `arena.size`"
        says = rf"n_robots must be between 1 and {N_CELLS} .*\(got {n_robots}\){remedy}$"
        with pytest.raises(UserError, match=says):
            layout.place_robots(PAPER, n_robots, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("arena", "yaw_tolerance"),
    [
        pytest.param(PAPER, 0.2, id="paper"),
        pytest.param(
            ArenaConfig(size=10.7, dump_size=2.2, dust_area_size=2, dust_area_offset=4),
            0.5,
            id="fractions of cells",
        ),
    ],
)
def test_robots_start_apart_outside_the_dump(arena, yaw_tolerance):
    """There are as many as fit in, and they look in all directions."""
    n_robots = len(layout.free_cells(arena))
    poses = layout.place_robots(arena, n_robots, np.random.default_rng(0))
    xy = poses[:, :2]
    yaw = poses[:, 2]

    gap = np.abs(xy[:, None] - xy[None]).max(axis=-1)
    of_others = gap[~np.eye(n_robots, dtype=bool)]
    assert of_others.min() == pytest.approx(RD)

    distance = np.abs(xy).max(axis=1)
    assert distance.min() > arena.dump_size / 2 * RD
    assert distance.max() + RD / 2 <= arena.size / 2 * RD + 1e-9
    assert [yaw.min(), yaw.max()] == pytest.approx([-np.pi, np.pi], abs=yaw_tolerance)


class TestBalls:
    """Balls of worlds (seed, number) with three robots, at 45 % RH and with radii from 14 um."""

    N_DUST = 301
    HUMIDITY_FACTOR = 1.5
    """Works of adhesion at 45 % RH, relative to those at 10 % RH."""

    def balls_of(self, task, seed, world):
        """Return the balls of a world."""
        arena = ArenaConfig(
            size=30,
            n_dust=self.N_DUST,
            dust_area_size=4,
            dust_area_offset=8,
            ball_radius_min=1.4e-5,
        )
        gripper = GripperConfig(relative_humidity=45.0, work_tool_object=2e-3)
        start = start_of(SwarmConfig(arena, gripper=gripper), 3, seed, world, task=task)
        return start.task if task is CLEANING else start.task.items

    @pytest.mark.parametrize("task", [CLEANING, Foraging(sources=3)], ids=["cleaning", "foraging"])
    def test_worlds_of_a_seed_share_radii_but_not_places(self, task):
        balls = self.balls_of(task, seed=1, world=0)
        other_world = self.balls_of(task, seed=1, world=1)
        other_seed = self.balls_of(task, seed=2, world=0)
        np.testing.assert_array_equal(balls.radius, other_world.radius)
        assert (balls.position != other_world.position).all()
        assert (balls.radius != other_seed.radius).all()

    @pytest.mark.parametrize("task", [CLEANING, Foraging(sources=3)], ids=["cleaning", "foraging"])
    def test_radii_and_works_of_adhesion_are_those_of_the_settings(self, task):
        balls = self.balls_of(task, seed=1, world=0)
        radii = [balls.radius.min(), balls.radius.max()]
        assert radii == pytest.approx([1.4e-5, 2.5e-5], rel=0.02)
        assert balls.work_tool_object == pytest.approx(self.HUMIDITY_FACTOR * 2e-3)
        work_object_substrate = self.HUMIDITY_FACTOR * 14.7e-3
        assert balls.work_object_substrate == pytest.approx(work_object_substrate)

    def test_dust_lies_in_two_areas(self):
        """One is to the west of the dump, one to the east."""
        position = self.balls_of(CLEANING, seed=1, world=0).position / RD
        west = position[:150]
        east = position[150:]
        for area, middle in ((west, -8), (east, 8)):
            np.testing.assert_allclose(area.min(axis=0), [middle - 2, -2], atol=0.1)
            np.testing.assert_allclose(area.max(axis=0), [middle + 2, 2], atol=0.1)
