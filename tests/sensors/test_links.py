"""Who hears whom: hand-worked worlds, and crowds against a reference that tries every pair."""

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
ROBOT = read_robot()
BLIND = OpticsConfig(line_of_sight=False)


@cache
def arena(n_robots):
    return compile_arena(SwarmConfig(), n_robots, np.zeros(0))


def scene_at(poses, optics=OPTICS):
    """What rays meet in worlds with robots at (B, N, 3)."""
    model = arena(poses.shape[1])
    batch = Batch(model.model, len(poses), 1)
    batch.bind("qpos")[:, model.qpos] = poses
    batch.forward()
    return Scene(SwarmConfig(optics=optics), model, batch)


def by_geometry(poses, optics=OPTICS):
    return find_links(poses, ROBOT, optics, squares_in_the_way(poses))


def by_rays(poses, optics=OPTICS):
    everyone = np.ones(poses.shape[:2], bool)
    return sense(scene_at(poses, optics), poses, np.zeros((len(poses), 0, 3)), everyone, everyone).links


def by_numba(poses, optics=OPTICS):
    engine = PlanarEngine(SwarmConfig(optics=optics), arena(1), 1)
    return engine.sense(placed(engine, poses), np.ones(poses.shape[:2], bool), np.ones(len(poses), bool)).links


def by_warp(poses, optics=OPTICS):
    engine = read_engine(arena(1), SwarmConfig(optics=optics), jax.default_backend())
    links = engine.sense(placed(engine, poses), np.ones(poses.shape[:2], bool), np.ones(len(poses), bool)).links
    return Links(*map(np.asarray, links))


all_sights = pytest.mark.parametrize("sight", [by_geometry, by_rays, by_numba, by_warp])


def heard(links, world=0):
    """{(receiver, side): (sender, LED)} of a world."""
    receiver, side = np.nonzero(links.valid[world])
    sender, led = (a[world, receiver, side].tolist() for a in (links.sender, links.led))
    return dict(zip(zip(receiver.tolist(), side.tolist(), strict=True), zip(sender, led, strict=True), strict=True))


def same(one, other):
    """Assert that two sets of links agree."""
    for name, a, b in zip(Links._fields, one, other, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)


def facing(degrees, distance):
    """Row of a robot at this bearing from the origin that looks back there."""
    a = np.radians(degrees)
    return distance * np.cos(a), distance * np.sin(a), degrees + 180


DARK = 45  # heading of a robot on the x axis that shines past those before and behind it


@all_sights
def test_nearest_of_two_on_one_photodiode(sight):
    poses = place((0, 0, 0), facing(-16, 7.3), facing(26, 5.6))[None]
    links = sight(poses)
    assert heard(links)[0, 0] == (2, 0)
    assert links.true_distance[0, 0, 0] == pytest.approx(5.6) and links.measured_bearing[0, 0, 0] == 0
    assert heard(sight(poses[:, :2]))[0, 0] == (1, 0)


@all_sights
def test_a_robot_between_two_cuts_their_link(sight):
    poses = place((0, 0, 0), (8, 0, 180), (4, 0, DARK))[None]
    assert (0, 0) not in heard(sight(poses))
    assert (1, 0) not in heard(sight(poses))
    poses[0, 2, 1] = -5.0
    assert heard(sight(poses))[0, 0] == (1, 0)


@all_sights
def test_without_line_of_sight_nobody_is_in_the_way(sight):
    assert heard(sight(place((0, 0, 0), (8, 0, 180), (4, 0, DARK))[None], BLIND))[0, 0] == (1, 0)


@all_sights
@pytest.mark.parametrize(("heading", "cuts"), [(0, False), (45, True)])
def test_corners_count_between_the_inner_and_the_outer_circle(sight, heading, cuts):
    """A third robot 1.2 mm beside the path: its side leaves it open, its corner does not."""
    links = sight(place((0, 0, 0), (8, 0, 180), (4, 1.2, heading))[None], OpticsConfig(photodiode_aperture=30))
    assert ((0, 0) in heard(links)) is not cuts


@all_sights
@pytest.mark.parametrize(("aside", "hears"), [(0.0, False), (0.2, True)])
def test_a_robot_farther_away_than_the_sender_may_be_in_the_way(sight, aside, hears):
    """It stands flush with the side of a sender that is turned away by 44 degrees, and its corner hides that LED."""
    poses = place((0, 0, 0), (2.9, 0, 136), (2.08 + aside, 2.045 + aside, 46))[None]
    reach = 2.91  # of light, farther than to the sender
    assert np.linalg.norm(poses[0, 2, :2]) > reach
    links = sight(poses, OpticsConfig(led_beam_aperture=90, communication_radius=reach / RD, wall_range=0))
    assert (heard(links).get((0, 0)) == (1, 0)) is hears


def test_rays_are_cast_only_where_circles_leave_it_open():
    def reaches(*pairs):
        assert not len(pairs[0])
        return np.zeros(0, bool)

    for y, hears in ((0.0, False), (0.99, False), (-5.0, True)):
        links = find_links(place((0, 0, 0), (8, 0, 180), (4, y, DARK))[None], ROBOT, OPTICS, reaches)
        assert ((0, 0) in heard(links)) is hears


LARGE = replace(ROBOT, half_edges=(3.0, 1.2, 0.5))


@pytest.mark.parametrize(
    "robot",
    [ROBOT, SHIFTED, Mixed((ROBOT, LARGE), (0, 2)), Mixed((LARGE, ROBOT), (0, 1))],
    ids=["", "askew", "by", "to"],
)
def test_circles_and_the_search_decide_as_rays_would(robot):
    """Of senders at the end of the range and a third robot, which may be large; so may the receiver."""
    edges = robot.each("half_edges", 3)[:, :2]
    poses = thirds_in_the_way(np.random.default_rng(3), 1500, RADIUS, np.hypot(*edges[2]))
    asked, exact = [], squares_in_the_way(poses, edges)

    def counted(*pairs):
        asked.append(len(pairs[0]))
        return exact(*pairs)

    given = robot, OpticsConfig(led_beam_aperture=90), counted, np.tile([True, True, False], (1500, 1))
    same(find_links(poses, *given), expected := links_by_rays(poses, *given))
    assert 500 < expected.valid[:, 0].sum() < 1400 and 0 < asked[0] < asked[1] / 2
    x, y, yaw = poses[:, 2:].T
    boxes = np.stack([x, y, np.cos(yaw), np.sin(yaw), *np.broadcast_to(edges[2, :, None, None], (2, *x.shape))], -1)
    hidden = find_links(
        poses[:, :2], robot, given[1], squares_in_the_way(poses[:, :2], edges[:2]), None, boxes.swapaxes(0, 1)
    )
    same(hidden, [values[:, :2] for values in expected])


@pytest.mark.parametrize("mode", ["sector", "power"])
def test_light_goes_from_the_leds_of_one_kind_to_the_photodiodes_of_another(mode):
    """As between robots of one kind that has these."""
    poses, optics = thirds_in_the_way(np.random.default_rng(4), 1500, 0.6 * RADIUS, 2**0.5), OpticsConfig(mode=mode)
    given = optics, squares_in_the_way(poses), np.tile([True, True, False], (1500, 1))
    mixed = find_links(poses, Mixed((ROBOT, SHIFTED), (0, 1)), *given)
    for receiver, (own, other) in enumerate([(ROBOT, SHIFTED), (SHIFTED, ROBOT)]):
        one = find_links(poses, replace(own, leds=other.leds), *given)
        same([values[:, receiver] for values in mixed], [values[:, receiver] for values in one])
        assert 500 < one.valid[:, receiver].sum() < 1400


@all_sights
def test_a_robot_alone_hears_nobody(sight):
    links = sight(np.zeros((1, 1, 3)))
    assert links.valid.shape == (1, 1, 4) and not links.valid.any()
    assert not sight(place((0, 0, 0), (RADIUS + 0.01, 0, 180))[None]).valid.any()
    assert sight(place((0, 0, 0), (RADIUS - 0.01, 0, 180))[None]).valid.sum() == 2


def test_rays_end_at_the_led():
    """In worlds in any order: to the sender's hull and short of it, past it, and through a third robot."""
    facing_each_other = place((0, 0, 0), (8, 0, 180), (4, 5, 0), (4, 9, 0))
    beside = place((0, 0, 0), (8, 0, 180), (4, 0, 0), (4, 9, 0))
    world, origin = np.array([1, 0, 0, 0, 1]), np.tile([1.0, 0.0], (5, 1))
    target = np.array([(7.0, 0.0), (7.0, 0.0), (6.9, 0.0), (9.5, 0.0), (2.9, 0.0)])
    receiver, sender = np.zeros(5, int), np.array([1, 1, 1, 2, 1])
    reached = scene_at(np.stack([facing_each_other, beside])).reaches(world, origin, target, receiver, sender)
    assert reached.tolist() == [False, True, True, False, True]


@pytest.mark.parametrize(("density", "edge"), [(0.2, 9), (0.5, 9), (0.8, 12)])
def test_crowds_link_as_if_every_pair_was_decided_by_a_ray(density, edge):
    poses = crowd(np.random.default_rng([edge, int(10 * density)]), density, edge)[:81]
    scene = scene_at(poses[None])

    asked = []

    def counted(*pairs):
        asked.append(len(pairs[0]))
        return scene.reaches(*pairs)

    links = find_links(poses[None], ROBOT, OPTICS, counted)
    for reaches in (scene.reaches, squares_in_the_way(poses[None])):
        sender, led, passed_over = all_links(poses, reaches)
        np.testing.assert_array_equal(np.where(links.valid[0], links.sender[0], -1), sender)
        np.testing.assert_array_equal(np.where(links.valid[0], links.led[0], -1), led)
    assert links.valid.sum() > 80 and passed_over > 0 and sum(asked) > 0


@pytest.mark.parametrize("mode", ["sector", "power"])
@pytest.mark.parametrize("density", [0.2, 0.5])
def test_each_next_sender_is_the_one_that_is_heard_if_nearer_ones_are_dark(density, mode):
    """The robot with index w looks around in world w; there, what it has heard so far is switched off."""
    poses = crowd(np.random.default_rng(12), density, edge=7)
    poses = np.broadcast_to(poses, (len(poses), *poses.shape))
    optics = OpticsConfig(mode=mode, baud_rate=2000)
    several = find_links(poses, ROBOT, optics, squares_in_the_way(poses))
    one, sends = np.arange(len(poses)), np.ones(poses.shape[:2], bool)
    for rank in range(SENDERS_IN_SIGHT):
        nearest = find_links(poses, ROBOT, OpticsConfig(mode=mode), squares_in_the_way(poses), sends)
        same([values[one, one, :, rank] for values in several], [values[one, one] for values in nearest])
        world, side = np.nonzero(nearest.valid[one, one])
        sends[world, nearest.sender[world, world, side]] = False
    assert (several.valid[one, one].sum(axis=(0, 1))[:3] > [60, 20, 0]).all()


def test_worlds_do_not_hear_each_other():
    optics = OpticsConfig(mode="power")
    rng = np.random.default_rng(9)
    poses = np.stack([crowd(rng, density, edge=5) for density in (0.8, 0.3, 0.5)])
    together = by_rays(poses, optics)
    assert together.valid.any(axis=(1, 2)).all()
    for world in range(3):
        alone = by_rays(poses[world][None], optics)
        for name, a, b in zip(alone._fields, alone, together, strict=True):
            np.testing.assert_array_equal(a[0], b[world], err_msg=name)


def test_a_box_hides_robots_of_its_own_world_alone():
    poses = np.repeat(place((0, 0, 0), (8, 0, 180))[None], 2, axis=0)
    boxes = numbers([(4.0, 5.0, 0.6, 0.6, 0.0), (4.0, 0.0, 0.6, 0.6, 0.0)])[:, None]
    links = find_links(poses, ROBOT, OPTICS, squares_in_the_way(poses), boxes=boxes)
    assert links.valid[:, 0, 0].tolist() == links.valid[:, 1, 0].tolist() == [True, False]


def test_who_shines_brightest_is_heard_not_who_is_nearest():
    poses = place((0, 0, 0), facing(20, 6.0), facing(-20, 6.2))[None]
    poses[0, 1, 2] += np.radians(40)
    optics = OpticsConfig(mode="power")
    links = by_geometry(poses, optics)
    assert heard(links)[0, 0] == (2, 0) and links.true_distance[0, 0, 0] == pytest.approx(6.2)
    poses[0, 1, 2] -= np.radians(40)
    assert heard(by_geometry(poses, optics))[0, 0] == (1, 0)


def test_neighbours_are_all_pairs_within_the_radius_by_robot():
    rng = np.random.default_rng(11)
    xy, radius = rng.uniform(0, 20, (2, 30, 2)), 6.0
    around = find_neighbours(xy, radius)
    offset = xy[:, None] - xy[:, :, None]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    world, i, j = np.nonzero((distance <= radius) & ~np.eye(30, dtype=bool))
    np.testing.assert_array_equal(around.robot, world * 30 + i)
    order = np.lexsort((around.other, around.robot))
    np.testing.assert_array_equal(around.other[order], world * 30 + j)
    np.testing.assert_allclose(np.stack([around.dx, around.dy], -1)[order], offset[world, i, j])
    np.testing.assert_allclose(around.distance[order], distance[world, i, j])
    np.testing.assert_array_equal(around.robot[around.reverse], around.other)
    np.testing.assert_array_equal(around.other[around.reverse], around.robot)
    counts = np.bincount(around.robot, minlength=60)
    np.testing.assert_array_equal(np.diff(around.first), counts)
    assert counts.sum() > 0
