"""How a run begins: cells, robots, balls, works of adhesion."""

import numpy as np
import pytest

from iswarm_mj.config import ArenaConfig
from iswarm_mj.tasks import layout
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
    assert np.abs(poses[:, :2]).max(axis=1).min() > arena.dump_size / 2 * RD
    assert np.abs(poses[:, :2]).max() + RD / 2 <= arena.size / 2 * RD + 1e-9
