"""Sight of the planar engine for batches, with 32-bit floats: link by link that of the engine for CPUs. Units: mm."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.planar import both_engines, placed, rounded, same_bits, with_robot
from support.sensing import crowd, place, squares_in_the_way
from support.small import SMALL

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.gpu.surroundings import near_places
from iswarm_mj.engines.planar.in_sight import search_radius
from iswarm_mj.engines.planar.reception import read_light
from iswarm_mj.sensors.links import find_links
from iswarm_mj.utils.units import RD

ROBOT = read_robot()


@cache
def engines(optics, robot=ROBOT):
    plain, batch = both_engines(SwarmConfig(arena=SMALL.arena, optics=optics))
    return with_robot(plain, robot, optics), replace(batch, light=read_light(robot, optics), robot=robot)


def seen(engine, poses, emits=None, present=None, running=None):
    """What robots at (B, N, 3) see; all present and emitting, in worlds that run, if not said otherwise."""
    emits = np.ones(poses.shape[:2], bool) if emits is None else emits
    running = np.ones(len(poses), bool) if running is None else running
    return engine.sense(placed(engine, rounded(poses), present), emits, running)


def bricks(rng, *densities):
    """Crowds (B, 81, 3) in the north-west of the arena; some touch, some see walls, some stand beyond them."""
    poses = np.stack([crowd(rng, density) for density in densities])
    poses[..., :2] += rng.uniform(-0.2, 0.2, poses[..., :2].shape) + np.array([-11, 13])
    return poses


def test_lists_have_room_for_all_robots_near_one():
    """Side by side without a gap, as many fit around a robot; beyond that the lists do not grow with the swarm."""
    _, engine = engines(OpticsConfig())
    within, kind = search_radius(engine.light, engine.plane), engine.kinds[0]
    places = np.arange(-20, 21)
    apart = np.hypot(2 * kind.half_x * places[:, None], 2 * kind.half_y * places)
    room = [near_places(1, n, within, [kind])["near"][1] for n in (50, 1000, 100_000)]
    assert room[0] == 49 and (apart <= within).sum() < room[1] == room[2] < 999


@pytest.mark.parametrize("mode", ["sector", "power"])
@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_of_equally_near_senders_the_first_is_heard(mode, order):
    """Two senders that mirror each other at the receiver's axis; their headings have no rounding."""
    rows, optics = [(0, 0, 0), (6, 2, 0), (6, -2, 0)], OpticsConfig(mode=mode)
    poses = place(rows[0], *(rows[k] for k in order))[None]
    found = [
        find_links(poses, ROBOT, optics, squares_in_the_way(poses)),
        *(seen(e, poses).links for e in engines(optics)),
    ]
    assert [links.sender[0, 0, 0] for links in found] == [1, 1, 1]


@pytest.mark.parametrize("which", [0, 1], ids=["numba", "warp"])
def test_robots_anywhere_are_seen(which):
    """Beyond the walls and after many turns, too; those whose pose is not a number see nothing and hide nothing."""
    turns = 1400 * np.pi
    rows = [(0, 0, turns), (6, 0, np.pi), (80, 0, -turns), (86, 0, np.pi + turns), (np.nan, 0, 0), (3, np.nan, 0)]
    poses = np.array([rows])
    links = seen(engines(OpticsConfig())[which], poses).links
    assert links.valid.sum() == 4 and not links.valid[0, 4:].any()
    np.testing.assert_array_equal(links.sender[0, :4, 0], [1, 0, 3, 2])


def test_repeats_and_companions_change_no_bit():
    rng, (_, engine) = np.random.default_rng(8), engines(OpticsConfig(mode="power"))
    poses = bricks(rng, 0.3, 0.5, 0.7)
    emits, present = rng.random((2, *poses.shape[:2])) < 0.8
    together = seen(engine, poses, emits, present)
    assert same_bits(together, seen(engine, poses, emits, present))
    halted = seen(engine, poses, emits, present, np.array([True, False, True]))
    assert not np.any(halted.links.valid[1]) and not np.any(halted.sees_wall[1])  # looking there takes time
    for world in range(3):
        alone = seen(engine, poses[[world]], emits[[world]], present[[world]])
        for mine, yours, third in zip(*(arrays_of(s) for s in (alone, together, halted)), strict=True):
            assert same_bits(mine[0], yours[world])
            assert world == 1 or same_bits(mine[0], third[world])


def arrays_of(sight):
    return (*sight.links, sight.sees_wall)


def test_a_led_inside_an_obstacle_sees_it():
    """As of a robot pressed into it; one whose axis a third robot crosses first sees none.

    Also where that robot is beyond the range of messages, and its corner alone within that of walls.
    """
    beside, between, corner = (0.0, 6.0, 0.0), (4.6, 0.0, 0.0), (8.36, 0.0, np.pi / 4)
    first = [(6.2, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.4, 0.0, 0.0), (0.4, 0.0, 0.0)]
    poses = np.stack([first, [beside, between, beside, corner, beside]], axis=1)
    optics = OpticsConfig(communication_radius=1.0, wall_range=2.0)
    box = (9 / RD, 0.0, 2 / RD, 2 / RD, 0.0)  # from 7 mm on
    arena = replace(SMALL.arena, obstacles=(box,), dust_area_size=2, dust_area_offset=5.5, n_dust=2)
    for engine in both_engines(replace(SMALL, arena=arena, optics=optics)):
        assert np.asarray(seen(engine, poses).sees_wall)[:, 0, 0].tolist() == [True, False, True, False, True]
