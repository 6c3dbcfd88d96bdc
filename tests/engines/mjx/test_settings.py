"""Settings of MJX in the compiled engine: contact buffers, solver, order of worlds."""

from dataclasses import replace

import numpy as np
import pytest
from support.robots import around, robot_xml
from support.small import SMALL

from iswarm_mj.engines.mjx.arena import contact_capacity
from iswarm_mj.engines.mjx.settings import BATCH_CAPACITY, MjxSettings
from iswarm_mj.engines.settings import ModelSpec
from iswarm_mj.utils.units import RD

ARENA = replace(SMALL.arena, size=49.0, outline=((20.0, 10.0),), dust_area_size=1)
"""An arena of 20 x 10 rd."""


def test_capacity_by_hand():
    """A robot on each two cells."""
    assert contact_capacity(replace(SMALL, arena=ARENA), 100) == (141, 304)


def test_capacity_with_an_obstacle_and_a_box_by_hand():
    """An obstacle of 4 x 2 rd and a box of 2 x 1 rd."""
    obstacles = ((5, 2, 2, 1, 45),)
    boxes = ((-5, 0, 0.5, 1, 0, 1e-5, 0.1),)
    config = replace(SMALL, arena=replace(ARENA, obstacles=obstacles, boxes=boxes))
    areas_around = np.pi * (np.hypot([2, 0.5], 1) + 1) ** 2
    half_edges = 3 + 1.5

    capacity = contact_capacity(config, 100, factor=2.0)
    assert capacity.pairs == np.ceil(2 * (141 + 16 + areas_around.sum()))
    assert capacity.contacts == 2 * (304 + 16 + 8 * half_edges)

    pairs_of_bodies = 6
    pairs_with_obstacle = 4
    assert contact_capacity(config, 3).pairs == pairs_of_bodies + pairs_with_obstacle


def test_large_robots_and_settings_change_the_engine(tmp_path):
    path = tmp_path / "large.xml"
    half_edges = (2.5, 1.5)
    path.write_text(robot_xml(half_edges, around(half_edges, range(0, 360, 90))))
    settings = MjxSettings(solver_iterations=30, contact_capacity=0.5)
    engine = settings.compiled_engine(ModelSpec(SMALL, 3, 5, path, True), 2, "cpu")

    density = 5 / 15**2
    capacity_by_rule = 64 + 5 * (2.0 + 0.8 * density)
    squared_diameter = (5**2 + 3**2) / RD**2
    contacts = engine.arena.capacity.contacts
    assert contacts == np.ceil(0.5 * capacity_by_rule * squared_diameter)

    assert engine.arena.n_robots == 5
    assert int(engine.arena.model.opt.iterations) == 30
    assert engine.is_masked
    assert (engine.mapping("cpu"), engine.mapping("gpu")) == ("in turn", "vmap")


@pytest.mark.parametrize(("capacity", "expected"), [(1.0, BATCH_CAPACITY), (9.0, 9.0)])
def test_batches_have_more_room_by_default(capacity, expected):
    settings = MjxSettings(contact_capacity=capacity)
    assert settings.for_batches().contact_capacity == expected
