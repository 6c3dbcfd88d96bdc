"""Links between robots: worlds worked by hand, and crowds against a test of every pair."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
from mujoco.batch import Batch
from support.planar import placed
from support.sensing import (
    RADIUS,
    SHIFTED,
    all_links,
    crowd,
    links_by_rays,
    place,
    squares_in_the_way,
    thirds_in_the_way,
)

from iswarm_mj.config.static import SENDERS_IN_SIGHT
from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena, read_robot
from iswarm_mj.engines.mujoco.sight import Scene, sense
from iswarm_mj.engines.planar.batch_engine import read_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.geometry.obstacles import numbers
from iswarm_mj.geometry.robot import Mixed
from iswarm_mj.sensors.links import Links, find_links
from iswarm_mj.sensors.neighbours import find_neighbours
from iswarm_mj.utils.units import RD

OPTICS = OpticsConfig()
BLIND = OpticsConfig(line_of_sight=False)
ROBOT = read_robot()
LARGE = replace(ROBOT, half_edges=(3.0, 1.2, 0.5))
DARK = 45
"""Heading of a robot on the x axis that shines past those before and behind it [deg]."""


@cache
def arena(n_robots):
    """Return the paper's arena, compiled."""
    return compile_arena(SwarmConfig(), n_robots, np.zeros(0))


def scene_at(poses, optics=OPTICS):
    """Return geoms that rays meet in worlds with robots at (B, N, 3)."""
    model = arena(poses.shape[1])
    batch = Batch(model.model, len(poses), 1)
    batch.bind("qpos")[:, model.qpos] = poses
    batch.forward()
    return Scene(SwarmConfig(optics=optics), model, batch)


def by_geometry(poses, optics=OPTICS):
    """Return links with exact squares in the way."""
    return find_links(poses, ROBOT, optics, squares_in_the_way(poses))


def by_rays(poses, optics=OPTICS):
    """Return links by MuJoCo's rays."""
    everyone = np.ones(poses.shape[:2], bool)
    no_boxes = np.zeros((len(poses), 0, 3))
    return sense(scene_at(poses, optics), poses, no_boxes, everyone, everyone).links


def by_numba(poses, optics=OPTICS):
    """Return links of the planar engine for CPUs."""
    return links_of(PlanarEngine(SwarmConfig(optics=optics), arena(1), 1), poses)


def by_warp(poses, optics=OPTICS):
    """Return links of the planar engine for batches."""
    engine = read_engine(arena(1), SwarmConfig(optics=optics), jax.default_backend())
    return Links(*map(np.asarray, links_of(engine, poses)))


def links_of(engine, poses):
    """Return links that an engine finds in worlds with robots at (B, N, 3), which all emit."""
    emits = np.ones(poses.shape[:2], bool)
    return engine.sense(placed(engine, poses), emits, np.ones(len(poses), bool)).links


all_sights = pytest.mark.parametrize("sight", [by_geometry, by_rays, by_numba, by_warp])


def heard(links, world=0):
    """Return the sender and LED that each side of a world hears, by receiver and side."""
    pairs = {}
    for receiver, side in np.argwhere(links.valid[world]).tolist():
        sender = int(links.sender[world, receiver, side])
        pairs[receiver, side] = sender, int(links.led[world, receiver, side])
    return pairs


def assert_same(first, second):
    """Assert that two sets of links agree."""
    for name, values, expected in zip(Links._fields, first, second, strict=True):
        np.testing.assert_array_equal(values, expected, err_msg=name)


def facing_origin(degrees, distance):
    """Return the row of a robot at this bearing of the origin that looks back there."""
    angle = np.radians(degrees)
    return distance * np.cos(angle), distance * np.sin(angle), degrees + 180


@all_sights
def test_nearest_of_two_on_one_photodiode(sight):
    poses = place((0, 0, 0), facing_origin(-16, 7.3), facing_origin(26, 5.6))[None]
    links = sight(poses)
    assert heard(links)[0, 0] == (2, 0)
    assert links.true_distance[0, 0, 0] == pytest.approx(5.6)
    assert links.measured_bearing[0, 0, 0] == 0

    without_nearest = poses[:, :2]
    assert heard(sight(without_nearest))[0, 0] == (1, 0)


@all_sights
def test_a_robot_between_two_cuts_their_link(sight):
    poses = place((0, 0, 0), (8, 0, 180), (4, 0, DARK))[None]
    assert (0, 0) not in heard(sight(poses))
    assert (1, 0) not in heard(sight(poses))

    poses[0, 2, 1] = -5.0
    assert heard(sight(poses))[0, 0] == (1, 0)


@all_sights
def test_without_line_of_sight_nobody_is_in_the_way(sight):
    poses = place((0, 0, 0), (8, 0, 180), (4, 0, DARK))[None]
    assert heard(sight(poses, BLIND))[0, 0] == (1, 0)


@all_sights
@pytest.mark.parametrize(("heading", "cuts"), [(0, False), (45, True)])
def test_corners_count_between_the_inner_and_the_outer_circle(sight, heading, cuts):
    """A third robot 1.2 mm beside the path: its side leaves it open, its corner does not."""
    poses = place((0, 0, 0), (8, 0, 180), (4, 1.2, heading))[None]
    links = sight(poses, OpticsConfig(photodiode_aperture=30))
    assert ((0, 0) in heard(links)) is not cuts


@all_sights
@pytest.mark.parametrize(("aside", "hears"), [(0.0, False), (0.2, True)])
def test_a_robot_farther_away_than_the_sender_may_be_in_the_way(sight, aside, hears):
    """It stands flush with the side of a sender that is turned away by 44 degrees.

    Its corner hides that LED.
    """
    poses = place((0, 0, 0), (2.9, 0, 136), (2.08 + aside, 2.045 + aside, 46))[None]
    reach = 2.91  # of light, farther than to the sender
    assert np.linalg.norm(poses[0, 2, :2]) > reach

    optics = OpticsConfig(led_beam_aperture=90, communication_radius=reach / RD, wall_range=0)
    links = sight(poses, optics)
    assert (heard(links).get((0, 0)) == (1, 0)) is hears


@pytest.mark.parametrize(("y", "hears"), [(0.0, False), (0.99, False), (-5.0, True)])
def test_rays_are_cast_only_where_circles_leave_it_open(y, hears):
    def no_rays(*rays):
        assert not len(rays[0])
        return np.zeros(0, bool)

    poses = place((0, 0, 0), (8, 0, 180), (4, y, DARK))[None]
    links = find_links(poses, ROBOT, OPTICS, no_rays)
    assert ((0, 0) in heard(links)) is hears


@pytest.mark.parametrize(
    "robot",
    [ROBOT, SHIFTED, Mixed((ROBOT, LARGE), (0, 2)), Mixed((LARGE, ROBOT), (0, 1))],
    ids=["", "askew", "by", "to"],
)
def test_circles_and_the_search_decide_as_rays_would(robot):
    """Senders at the end of the range and a third robot, which may be large, as the receiver."""
    n_worlds = 1500
    half_edges = robot.each("half_edges", 3)[:, :2]
    size = np.hypot(*half_edges[2])
    poses = thirds_in_the_way(np.random.default_rng(3), n_worlds, RADIUS, size)
    exact = squares_in_the_way(poses, half_edges)
    n_asked = []

    def counted(*rays):
        n_asked.append(len(rays[0]))
        return exact(*rays)

    optics = OpticsConfig(led_beam_aperture=90)
    sends = np.tile([True, True, False], (n_worlds, 1))
    links = find_links(poses, robot, optics, counted, sends)
    expected = links_by_rays(poses, robot, optics, counted, sends)
    assert_same(links, expected)
    assert 500 < expected.valid[:, 0].sum() < 1400
    by_circles, by_all_rays = n_asked
    assert 0 < by_circles < by_all_rays / 2

    # A box in the third robot's place hides as much.
    x, y, yaw = poses[:, 2].T
    half_x, half_y = (np.full(n_worlds, half_edge) for half_edge in half_edges[2])
    boxes = np.stack([x, y, np.cos(yaw), np.sin(yaw), half_x, half_y], axis=-1)[:, None]
    pairs = poses[:, :2]
    no_robot_in_between = squares_in_the_way(pairs, half_edges[:2])
    hidden_by_box = find_links(pairs, robot, optics, no_robot_in_between, None, boxes)
    assert_same(hidden_by_box, [values[:, :2] for values in expected])


@pytest.mark.parametrize("mode", ["sector", "power"])
def test_light_goes_from_the_leds_of_one_kind_to_the_photodiodes_of_another(mode):
    """It does as between robots of one kind that has these LEDs and photodiodes."""
    n_worlds = 1500
    poses = thirds_in_the_way(np.random.default_rng(4), n_worlds, 0.6 * RADIUS, 2**0.5)
    optics = OpticsConfig(mode=mode)
    reaches = squares_in_the_way(poses)
    sends = np.tile([True, True, False], (n_worlds, 1))
    mixed = find_links(poses, Mixed((ROBOT, SHIFTED), (0, 1)), optics, reaches, sends)

    for receiver, (kind, other_kind) in enumerate([(ROBOT, SHIFTED), (SHIFTED, ROBOT)]):
        robot = replace(kind, leds=other_kind.leds)
        links = find_links(poses, robot, optics, reaches, sends)
        links_of_receiver = [values[:, receiver] for values in links]
        assert_same([values[:, receiver] for values in mixed], links_of_receiver)
        assert 500 < links.valid[:, receiver].sum() < 1400


@all_sights
def test_a_robot_alone_hears_nobody(sight):
    links = sight(np.zeros((1, 1, 3)))
    assert links.valid.shape == (1, 1, 4)
    assert not links.valid.any()


@all_sights
def test_the_range_ends_at_the_radius(sight):
    beyond = place((0, 0, 0), (RADIUS + 0.01, 0, 180))[None]
    within = place((0, 0, 0), (RADIUS - 0.01, 0, 180))[None]
    assert not sight(beyond).valid.any()
    assert sight(within).valid.sum() == 2


def test_rays_end_at_the_led():
    """Rays go to the sender's hull, short of it, past it, and through a third robot.

    Worlds are in any order.
    """
    third_aside = place((0, 0, 0), (8, 0, 180), (4, 5, 0), (4, 9, 0))
    third_between = place((0, 0, 0), (8, 0, 180), (4, 0, 0), (4, 9, 0))
    reached = scene_at(np.stack([third_aside, third_between])).reaches(
        world=np.array([1, 0, 0, 0, 1]),
        origin=np.tile([1.0, 0.0], (5, 1)),
        target=np.array([(7.0, 0.0), (7.0, 0.0), (6.9, 0.0), (9.5, 0.0), (2.9, 0.0)]),
        receiver=np.zeros(5, int),
        sender=np.array([1, 1, 1, 2, 1]),
    )
    assert reached.tolist() == [False, True, True, False, True]


@pytest.mark.parametrize(("density", "edge"), [(0.2, 9), (0.5, 9), (0.8, 12)])
def test_crowds_link_as_if_every_pair_was_decided_by_a_ray(density, edge):
    poses = crowd(np.random.default_rng([edge, int(10 * density)]), density, edge)[:81]
    scene = scene_at(poses[None])
    n_asked = []

    def counted(*rays):
        n_asked.append(len(rays[0]))
        return scene.reaches(*rays)

    links = find_links(poses[None], ROBOT, OPTICS, counted)
    valid = links.valid[0]
    for reaches in (scene.reaches, squares_in_the_way(poses[None])):
        sender, led, passed_over = all_links(poses, reaches)
        np.testing.assert_array_equal(np.where(valid, links.sender[0], -1), sender)
        np.testing.assert_array_equal(np.where(valid, links.led[0], -1), led)
    assert valid.sum() > 80
    assert passed_over > 0
    assert sum(n_asked) > 0


@pytest.mark.parametrize("mode", ["sector", "power"])
@pytest.mark.parametrize("density", [0.2, 0.5])
def test_each_next_sender_is_the_one_that_is_heard_if_nearer_ones_are_dark(density, mode):
    """Robot w looks around in world w, where the senders that it has heard are switched off."""
    poses = crowd(np.random.default_rng(12), density, edge=7)
    n_robots = len(poses)
    poses = np.broadcast_to(poses, (n_robots, n_robots, 3))
    reaches = squares_in_the_way(poses)
    all_ranks = find_links(poses, ROBOT, OpticsConfig(mode=mode, baud_rate=2000), reaches)

    robot = np.arange(n_robots)
    sends = np.ones(poses.shape[:2], bool)
    for rank in range(SENDERS_IN_SIGHT):
        nearest = find_links(poses, ROBOT, OpticsConfig(mode=mode), reaches, sends)
        of_rank = [values[robot, robot, :, rank] for values in all_ranks]
        assert_same(of_rank, [values[robot, robot] for values in nearest])

        world, side = np.nonzero(nearest.valid[robot, robot])
        sends[world, nearest.sender[world, world, side]] = False
    n_heard = all_ranks.valid[robot, robot].sum(axis=(0, 1))
    assert (n_heard[:3] > [60, 20, 0]).all()


def test_worlds_do_not_hear_each_other():
    optics = OpticsConfig(mode="power")
    rng = np.random.default_rng(9)
    poses = np.stack([crowd(rng, density, edge=5) for density in (0.8, 0.3, 0.5)])
    together = by_rays(poses, optics)
    assert together.valid.any(axis=(1, 2)).all()
    for world in range(3):
        alone = by_rays(poses[world][None], optics)
        assert_same([values[0] for values in alone], [values[world] for values in together])


def test_a_box_hides_robots_of_its_own_world_alone():
    poses = np.repeat(place((0, 0, 0), (8, 0, 180))[None], 2, axis=0)
    aside = (4.0, 5.0, 0.6, 0.6, 0.0)
    between = (4.0, 0.0, 0.6, 0.6, 0.0)
    boxes = numbers([aside, between])[:, None]
    links = find_links(poses, ROBOT, OPTICS, squares_in_the_way(poses), boxes=boxes)
    assert links.valid[:, 0, 0].tolist() == links.valid[:, 1, 0].tolist() == [True, False]


def test_who_shines_brightest_is_heard_not_who_is_nearest():
    optics = OpticsConfig(mode="power")
    poses = place((0, 0, 0), facing_origin(20, 6.0), facing_origin(-20, 6.2))[None]
    poses[0, 1, 2] += np.radians(40)
    links = by_geometry(poses, optics)
    assert heard(links)[0, 0] == (2, 0)
    assert links.true_distance[0, 0, 0] == pytest.approx(6.2)

    poses[0, 1, 2] -= np.radians(40)
    assert heard(by_geometry(poses, optics))[0, 0] == (1, 0)


def test_neighbours_are_all_pairs_within_the_radius_by_robot():
    n_worlds = 2
    n_robots = 30
    radius = 6.0
    xy = np.random.default_rng(11).uniform(0, 20, (n_worlds, n_robots, 2))
    around = find_neighbours(xy, radius)

    offset = xy[:, None] - xy[:, :, None]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    is_pair = (distance <= radius) & ~np.eye(n_robots, dtype=bool)
    world, first, second = np.nonzero(is_pair)
    np.testing.assert_array_equal(around.robot, world * n_robots + first)

    order = np.lexsort((around.other, around.robot))
    np.testing.assert_array_equal(around.other[order], world * n_robots + second)
    found_offset = np.stack([around.dx, around.dy], -1)[order]
    np.testing.assert_allclose(found_offset, offset[world, first, second])
    np.testing.assert_allclose(around.distance[order], distance[world, first, second])

    np.testing.assert_array_equal(around.robot[around.reverse], around.other)
    np.testing.assert_array_equal(around.other[around.reverse], around.robot)
    counts = np.bincount(around.robot, minlength=n_worlds * n_robots)
    np.testing.assert_array_equal(np.diff(around.first), counts)
    assert counts.sum() > 0
