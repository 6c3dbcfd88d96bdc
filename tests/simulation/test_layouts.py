"""How a run begins: cells, robots, balls, works of adhesion."""

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


def generator(seed=0):
    return np.random.default_rng(seed)


def test_free_cells_of_the_paper():
    """49^2 cells less the 5^2 of the dump."""
    cells = layout.free_cells(PAPER)
    assert len(cells) == 2376
    assert len(np.unique(cells.round(6), axis=0)) == 2376
    assert np.abs(cells).max() == pytest.approx(24 * RD)
    assert np.abs(cells).max(axis=1).min() == pytest.approx(3 * RD)


@pytest.mark.parametrize("density, n_robots", [(0.118, 280), (0.132, 314), (0.05, 119), (1.0, 2376), (1e-9, 1)])
def test_number_of_robots(density, n_robots):
    assert layout.robots_for(PAPER, density) == n_robots


@pytest.mark.parametrize("density", [0.0, -0.1, 1.01, np.nan, np.inf])
def test_density_has_limits(density):
    with pytest.raises(UserError, match=r"density must be above 0 and at most 1 \(got"):
        layout.robots_for(PAPER, density)


@pytest.mark.parametrize("n_robots", [0, -3, 2377])
def test_there_is_room_for_so_many(n_robots):
    """Fewer robots are the remedy only where there are too many."""
    remedy = "; use fewer robots or a larger `arena.size`" if n_robots > 2376 else ""
    with pytest.raises(UserError, match=rf"n_robots must be between 1 and 2376 .*\(got {n_robots}\){remedy}$"):
        layout.place_robots(PAPER, n_robots, generator())


@pytest.mark.parametrize("arena", [PAPER, ArenaConfig(size=10.7, dump_size=2.2, dust_area_size=2, dust_area_offset=4)])
def test_robots_start_apart_outside_the_dump(arena):
    n_robots = len(layout.free_cells(arena))
    poses = layout.place_robots(arena, n_robots, generator())
    gap = np.abs(poses[:, None, :2] - poses[None, :, :2]).max(axis=-1) + 1e9 * np.eye(n_robots)
    assert gap.min() == pytest.approx(RD)
    assert [poses[:, 2].min(), poses[:, 2].max()] == pytest.approx([-np.pi, np.pi], abs=0.2 if n_robots > 1000 else 0.5)
    assert np.abs(poses[:, :2]).max(axis=1).min() > arena.dump_size / 2 * RD
    assert np.abs(poses[:, :2]).max() + RD / 2 <= arena.size / 2 * RD + 1e-9


@pytest.mark.parametrize("task", [CLEANING, Foraging(sources=3)])
def test_balls_of_a_seed_are_alike_in_all_worlds(task):
    """Their radii, between the limits, and their works of adhesion: half as large again at 45 % RH as at 10 %."""
    arena = ArenaConfig(size=30, n_dust=301, dust_area_size=4, dust_area_offset=8, ball_radius_min=1.4e-5)
    config = SwarmConfig(arena, gripper=GripperConfig(relative_humidity=45.0, work_tool_object=2e-3))
    starts = [start_of(config, 3, seed, world, task=task) for seed, world in ((1, 0), (1, 1), (2, 0))]
    one, two, other = (start.task if task is CLEANING else start.task.items for start in starts)
    np.testing.assert_array_equal(one.radius, two.radius)
    assert (one.radius != other.radius).all() and (one.position != two.position).all()
    assert [one.radius.min(), one.radius.max()] == pytest.approx([1.4e-5, 2.5e-5], rel=0.02)
    assert one.work_tool_object == pytest.approx(3e-3) and one.work_object_substrate == pytest.approx(1.5 * 14.7e-3)
    if task is CLEANING:
        west, east = one.position[:150] / RD, one.position[150:] / RD
        for area, middle in ((west, -8), (east, 8)):
            np.testing.assert_allclose(area.min(axis=0), [middle - 2, -2], atol=0.1)
            np.testing.assert_allclose(area.max(axis=0), [middle + 2, 2], atol=0.1)
