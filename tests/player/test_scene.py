"""What is drawn is where robots and balls are, in millimetres."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from helpers_robots import two_kinds

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.palette import LOADED, rgb
from iswarm_mj.output.shapes import TRAIL_FRAMES, link_ends
from iswarm_mj.output.swarm_classes import BALL_CLASSES
from iswarm_mj.player import scene as arrays
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.player.scenario import Scenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.view import SwarmView

CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))


@pytest.fixture(scope="module")
def session():
    session = Session(Scenario(CONFIG, robots=20, seed=3, engine=PlanarSettings()))
    for _ in range(60):
        session.advance()
    return session


def last(session):
    before, after = [snapshot.frames for snapshot in session.snapshots][-2:]
    return session.scene, before, after


def test_robots_and_balls_are_where_the_engine_has_them(session):
    scene, before, after = last(session)
    shown = arrays.moment(scene, before, after, 1.0)
    _, state = session.run.arrays()
    np.testing.assert_allclose(shown.centre[:, :2], state.bodies.poses[0, :, :2], atol=1e-4)
    np.testing.assert_allclose(shown.yaw, state.bodies.poses[0, :, 2], atol=1e-5)
    np.testing.assert_allclose(shown.centre[:, 2], 0.5)
    balls = session.run.task_state
    lying = ~balls.is_held[0]
    np.testing.assert_allclose(shown.ball[lying, :2], balls.position[0][lying], atol=1e-3)
    colours = {label: colour for _, label, colour in BALL_CLASSES}
    expected = np.where(balls.is_held[0], 1, np.where(balls.is_delivered[0], 2, 0))
    np.testing.assert_array_equal(shown.ball_colour, np.array(list(colours.values()))[expected])


@pytest.fixture
def server():
    server = open_server(9300)
    yield server
    close_server(server)


def test_balls_are_drawn_as_large_as_they_are(session, server):
    view = SwarmView(server.scene, session.scene)
    np.testing.assert_allclose(view._balls.batched_scales, session.scene.ball_radius / 20e-6, rtol=0.2)
    assert np.corrcoef(view._balls.batched_scales, session.scene.ball_radius)[0, 1] > 0.9999


def test_robots_and_the_balls_that_they_carry_are_between_two_steps(session):
    """Balls that a robot holds before and after; a robot goes 1 mm at most."""
    n_moved = 0
    for one, other in itertools.pairwise(session.snapshots):
        shown = [arrays.moment(session.scene, one.frames, other.frames, share) for share in (0.0, 0.25, 1.0)]
        centres, (first, middle, end) = [moment.centre for moment in shown], [moment.ball for moment in shown]
        np.testing.assert_allclose(centres[1], 0.75 * centres[0] + 0.25 * centres[2], atol=1e-4)
        np.testing.assert_allclose(centres[0][:, :2], one.frames.pose[0, :, :2] * 1e3, atol=1e-4)
        held = (one.frames.ball_state[0] == 1) & (other.frames.ball_state[0] == 1)
        np.testing.assert_allclose(middle[held], 0.75 * first[held] + 0.25 * end[held], atol=1e-4)
        n_moved += (np.linalg.norm(end[held] - first[held], axis=-1) > 0.2).sum()
    assert n_moved > 10


def test_links_lead_from_receivers_to_senders_in_range(session):
    scene, before, after = last(session)
    centre = arrays.moment(scene, before, after, 1.0).centre
    ends = link_ends(after, centre[None])
    assert len(ends) == after.link_valid.sum() > 0
    for end in ends.reshape(-1, 3):
        assert np.isclose(centre, end).all(axis=1).any()
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() < (3.5 + 1.2) * 2 * np.sqrt(2)


def test_arrows_are_what_robots_remember_turned_to_the_arena(session):
    n_known = 0
    for snapshot in session.snapshots:
        shown = arrays.moment(session.scene, snapshot.frames, snapshot.frames, 1.0)
        found = arrays.arrows(session.scene, snapshot.frames, shown.centre)
        assert set(found) == {"dust", "dump"}
        for name, ends in found.items():
            memory = getattr(snapshot.record.swarm.memory, name)
            known = np.asarray(memory.known)[0, 0]
            (x, y), c, s = np.asarray(memory.vector)[0, 0][known].T, *(f(shown.yaw[known]) for f in (np.cos, np.sin))
            turned = np.stack([c * x - s * y, s * x + c * y], axis=-1)
            np.testing.assert_allclose((ends[:, 1] - ends[:, 0])[:, :2], turned, atol=1e-3)
            n_known += len(ends)
    assert n_known > 0


def test_colours_of_states_deaths_and_hops(session):
    scene, _, after = last(session)
    alive = np.ones(20, bool)
    alive[1] = False
    found = arrays.colours(scene, replace(after, is_alive=alive[None]), arrays.STATE)
    loaded = after.is_loaded[0] & ~after.has_priority[0] & alive
    assert (found[loaded] == rgb(LOADED)).all() and tuple(found[1]) == arrays.DEAD
    assert arrays.ways_to_colour(scene, after, np.ones(20)) == ["state", "hops to dust", "hops to dump", "energy"]
    hops = arrays.colours(scene, after, "hops to dust")
    unknown = ~after.memory["dust_known"][0]
    assert len(np.unique(hops[unknown], axis=0)) <= 1
    energy = arrays.colours(scene, after, "energy", np.arange(20.0))
    assert len(np.unique(energy, axis=0)) == 16  # of 0 to 15


def test_trails_end_at_loaded_robots(session):
    scene, _, after = last(session)
    past = [snapshot.frames for snapshot in session.snapshots]
    segments = arrays.trails(scene, past)
    length = min(len(past) - 1, TRAIL_FRAMES)
    assert len(segments) == length * after.is_loaded.sum()
    ends = arrays.moment(scene, after, after, 1.0).centre[after.is_loaded[0]]
    np.testing.assert_array_equal(segments.reshape(-1, length, 2, 3)[:, -1, 1], ends)


def test_hulls_are_drawn_with_their_sizes(tmp_path, server):
    session = Session(Scenario(CONFIG, robots=6, engine=PlanarSettings(), robot_file=two_kinds(tmp_path, 6)))
    session.advance()
    view = SwarmView(server.scene, session.scene)
    view.show([one.frames for one in session.snapshots], 1.0)
    hull, front = view.nodes["robots"], view.nodes["fronts"]
    for sizes in (hull.batched_scales, front.batched_scales):
        drawn = np.ptp(hull.vertices, axis=0) * sizes
        np.testing.assert_allclose(drawn[[1, 3]], [[2.0, 2.0, 1.0], [2.4, 1.6, 1.0]], atol=1e-6)
    w, _, _, z = hull.batched_wxyzs[1]
    yaw = session.snapshots[-1].frames.pose[0, 1, 2]
    np.testing.assert_allclose([w * w - z * z, 2 * w * z], [np.cos(yaw), np.sin(yaw)], atol=1e-5)
    assert front.vertices[:, 0].min() > 0.2 and front.vertices[:, 0].max() < 0.5  # ahead of the centre, on the hull
