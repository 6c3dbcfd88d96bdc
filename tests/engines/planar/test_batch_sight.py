"""Sight of the planar engine for batches, with 32-bit floats, against that for CPUs. Units: mm."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.planar import both_engines, placed, rounded, same_bits, with_robot
from support.sensing import crowd, place, squares_in_the_way
from support.small import SMALL

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.gpu.surroundings import near_shapes
from iswarm_mj.engines.planar.in_sight import search_radius
from iswarm_mj.engines.planar.reception import read_light
from iswarm_mj.sensors.links import find_links
from iswarm_mj.utils.units import RD

ROBOT = read_robot()


@cache
def engines(optics, robot=ROBOT):
    """Return the engine for CPUs and that for batches, with these optics."""
    plain, batch = both_engines(SwarmConfig(arena=SMALL.arena, optics=optics))
    light = read_light(robot, optics)
    return with_robot(plain, robot, optics), replace(batch, light=light, robot=robot)


def sense(engine, poses, emits=None, present=None, running=None):
    """Return the light that robots at (B, N, 3) receive.

    By default all are present and emit light, in worlds that run.
    """
    emits = np.ones(poses.shape[:2], bool) if emits is None else emits
    running = np.ones(len(poses), bool) if running is None else running
    return engine.sense(placed(engine, rounded(poses), present), emits, running)


def arrays_of(reading):
    return (*reading.links, reading.sees_wall)


def crowds(rng, *densities):
    """Return crowds (B, 81, 3) in the north-west of the arena.

    Some robots touch, some see walls, some stand beyond them.
    """
    poses = np.stack([crowd(rng, density) for density in densities])
    poses[..., :2] += rng.uniform(-0.2, 0.2, poses[..., :2].shape) + np.array([-11, 13])
    return poses


def test_lists_have_room_for_all_robots_near_one():
    """These are as many as fit around a robot side by side, whatever the size of the swarm."""
    _, engine = engines(OpticsConfig())
    within = search_radius(engine.light, engine.plane)
    kind = engine.kinds[0]
    cells = np.arange(-20, 21)
    distances = np.hypot(2 * kind.half_x * cells[:, None], 2 * kind.half_y * cells)
    n_within = (distances <= within).sum()

    def room(n_robots):
        return near_shapes(1, n_robots, within, [kind])["near"][1]

    assert room(50) == 49
    assert n_within < room(1000) == room(100_000) < 999


@pytest.mark.parametrize("mode", ["sector", "power"])
@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
def test_of_equally_near_senders_the_first_is_heard(mode, order):
    """Two senders mirror each other at the receiver's axis; their headings are exact."""
    rows = [(0, 0, 0), (6, 2, 0), (6, -2, 0)]
    optics = OpticsConfig(mode=mode)
    poses = place(rows[0], *(rows[k] for k in order))[None]
    readings = [sense(engine, poses).links for engine in engines(optics)]
    readings.append(find_links(poses, ROBOT, optics, squares_in_the_way(poses)))
    assert [links.sender[0, 0, 0] for links in readings] == [1, 1, 1]


@pytest.mark.parametrize("engine_index", [0, 1], ids=["numba", "warp"])
def test_robots_anywhere_are_seen(engine_index):
    """Beyond the walls and after many turns, too.

    Those whose pose is not a number see nothing and hide nothing.
    """
    turns = 1400 * np.pi
    in_arena = [(0, 0, turns), (6, 0, np.pi)]
    beyond_walls = [(80, 0, -turns), (86, 0, np.pi + turns)]
    nowhere = [(np.nan, 0, 0), (3, np.nan, 0)]
    poses = np.array([[*in_arena, *beyond_walls, *nowhere]])
    links = sense(engines(OpticsConfig())[engine_index], poses).links
    assert links.valid.sum() == 4
    assert not links.valid[0, 4:].any()
    np.testing.assert_array_equal(links.sender[0, :4, 0], [1, 0, 3, 2])


class TestBits:
    @pytest.fixture(scope="class")
    @classmethod
    def scene(cls):
        """Return the engine for batches, poses, and which robots emit light and are present."""
        rng = np.random.default_rng(8)
        _, engine = engines(OpticsConfig(mode="power"))
        poses = crowds(rng, 0.3, 0.5, 0.7)
        emits, present = rng.random((2, *poses.shape[:2])) < 0.8
        return engine, poses, emits, present

    def test_repeats_change_no_bit(self, scene):
        assert same_bits(sense(*scene), sense(*scene))

    def test_the_other_worlds_of_a_batch_change_no_bit(self, scene):
        engine, poses, emits, present = scene
        together = sense(*scene)
        for world in range(3):
            alone = sense(engine, poses[[world]], emits[[world]], present[[world]])
            for of_world, of_batch in zip(arrays_of(alone), arrays_of(together), strict=True):
                assert same_bits(of_world[0], of_batch[world])

    def test_a_world_that_does_not_run_sees_nothing_and_changes_no_other(self, scene):
        """It would take time to look there."""
        together = sense(*scene)
        halted = sense(*scene, np.array([True, False, True]))
        assert not np.any(halted.links.valid[1])
        assert not np.any(halted.sees_wall[1])
        for all_run, two_run in zip(arrays_of(together), arrays_of(halted), strict=True):
            assert same_bits(all_run[0], two_run[0])
            assert same_bits(all_run[2], two_run[2])


class TestLedInAnObstacle:
    """A robot pressed into an obstacle sees it, unless a third robot is in the way."""

    OBSTACLE = (9 / RD, 0.0, 2 / RD, 2 / RD, 0.0)
    """It begins at 7 mm."""
    FREE = (6.2, 0.0, 0.0)
    PRESSED = (2.0, 0.0, 0.0)
    BEYOND_MESSAGES = (0.4, 0.0, 0.0)
    """Place beyond the range of messages from the obstacle."""
    ASIDE = (0.0, 6.0, 0.0)
    IN_BETWEEN = (4.6, 0.0, 0.0)
    CORNER_IN_RANGE = (8.36, 0.0, np.pi / 4)
    """Place of a robot of which one corner is within the range of walls."""

    @pytest.mark.parametrize(
        ("first", "third", "sees"),
        [
            (FREE, ASIDE, True),
            (PRESSED, IN_BETWEEN, False),
            (PRESSED, ASIDE, True),
            (BEYOND_MESSAGES, CORNER_IN_RANGE, False),
            (BEYOND_MESSAGES, ASIDE, True),
        ],
    )
    def test_it_sees_the_obstacle(self, first, third, sees):
        for engine in self.engines():
            reading = sense(engine, np.array([[first, third]]))
            assert bool(reading.sees_wall[0, 0, 0]) == sees

    @classmethod
    @cache
    def engines(cls):
        arena = replace(
            SMALL.arena,
            obstacles=(cls.OBSTACLE,),
            dust_area_size=2,
            dust_area_offset=5.5,
            n_dust=2,
        )
        optics = OpticsConfig(communication_radius=1.0, wall_range=2.0)
        return both_engines(replace(SMALL, arena=arena, optics=optics))
