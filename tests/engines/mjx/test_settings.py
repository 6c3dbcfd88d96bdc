"""What MJX compiles of its settings: room for contacts, its solver, how it goes through worlds."""

from dataclasses import replace

import numpy as np
import pytest
from support.robots import around, robot_xml
from support.small import SMALL

from iswarm_mj.engines.mjx.arena import contact_capacity
from iswarm_mj.engines.mjx.settings import BATCH_CAPACITY, MjxSettings
from iswarm_mj.engines.settings import ModelSpec
from iswarm_mj.utils.units import RD


def test_room_for_contacts_by_hand():
    """A robot on each two of 20 x 10 cells; then with an obstacle of 4 x 2 rd and a box of 2 x 1 rd too."""
    arena = replace(SMALL.arena, size=49.0, outline=((20.0, 10.0),), dust_area_size=1)
    assert contact_capacity(replace(SMALL, arena=arena), 100) == (116, 254)
    solid = replace(arena, obstacles=((5, 2, 2, 1, 45),), boxes=((-5, 0, 0.5, 1, 0, 1e-5, 0.1),))
    areas = np.pi * (np.hypot([2, 0.5], 1) + 1) ** 2
    assert contact_capacity(replace(SMALL, arena=solid), 100, 2.0).pairs == np.ceil(2 * (116 + 16 + areas.sum()))
    assert contact_capacity(replace(SMALL, arena=solid), 100, 2.0).contacts == 2 * (254 + 16 + 8 * (3 + 1.5))
    assert contact_capacity(replace(SMALL, arena=solid), 3).pairs == 6 + 4  # all pairs that there are


def test_large_robots_and_settings_change_the_engine(tmp_path):
    path = tmp_path / "large.xml"
    path.write_text(robot_xml((2.5, 1.5), around((2.5, 1.5), range(0, 360, 90))))
    settings = MjxSettings(solver_iterations=30, contact_capacity=0.5)
    engine = settings.compiled_engine(ModelSpec(SMALL, 3, 5, path, True), 2, "cpu")
    by_rule = 64 + 5 * (0.7 + 2.4 * 5 / 15**2)
    assert engine.arena.capacity.contacts == np.ceil(0.5 * by_rule * (5**2 + 3**2) / RD**2)
    assert (engine.arena.n_robots, int(engine.arena.model.opt.iterations), engine.is_masked) == (5, 30, True)
    assert (engine.mapping("cpu"), engine.mapping("gpu")) == ("in turn", "vmap")


@pytest.mark.parametrize("given", [1.0, 9.0])
def test_batches_have_more_room_by_default(given):
    assert MjxSettings(contact_capacity=given).for_batches().contact_capacity == max(given, BATCH_CAPACITY)
