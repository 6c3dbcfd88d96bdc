"""What is drawn is where robots and balls are, in millimetres."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.robots import two_kinds
from support.swarm_recording import make_frames, make_scene

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output import shapes
from iswarm_mj.output.message_columns import payload_json
from iswarm_mj.output.palette import LOADED, rgb
from iswarm_mj.output.shapes import TRAIL_FRAMES, link_ends
from iswarm_mj.output.swarm_classes import BALL_CLASSES
from iswarm_mj.player import scene as arrays
from iswarm_mj.player.inspection import describe_robot
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.view import SwarmView, aim
from iswarm_mj.sensors.fields import Integer
from iswarm_mj.sensors.messages import Message, Payload
from iswarm_mj.utils.units import RD

CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))


@pytest.fixture(scope="module")
def session():
    session = Session(PageScenario(CONFIG, robots=20, seed=3, engine=PlanarSettings()))
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
    above = np.where(lying, 0.0, 1.2)  # on top of its robot
    np.testing.assert_allclose(shown.ball[:, 2], 1e3 * after.ball_position[0, :, 2] + above, atol=1e-5)
    assert 0 < lying.sum() < len(lying)
    colours = {label: colour for _, label, colour in BALL_CLASSES}
    expected = np.where(balls.is_held[0], 1, np.where(balls.is_delivered[0], 2, 0))
    np.testing.assert_array_equal(shown.ball_colour, np.array(list(colours.values()))[expected])


@pytest.fixture
def server():
    server = open_server(9300)
    yield server
    close_server(server)


def test_lines_lead_to_senders_that_are_heard_or_damaged(session, server):
    scene, before, after = last(session)
    view = SwarmView(server.scene, scene)
    view.show([before, after], 1.0)
    ends, heard = link_ends(after, shapes.centres(scene, after.pose)), after.link_heard[after.link_valid]
    assert 0 < heard.sum() != (~heard).sum() > 0
    for name, which in (("heard", heard), ("damaged", ~heard)):
        np.testing.assert_allclose(view._lines[name].points, ends[which], atol=1e-5)


def test_boxes_are_turned_where_they_are_pushed_and_obstacles_where_they_are_wished(server):
    scene = make_scene(4, 2)
    frames, view = make_frames(scene, 2), SwarmView(server.scene, scene)
    view.show([frames[:1], frames[1:]], 0.25)
    view.wish([(4.0, -4.0, 0.8, 0.5, 30.0)])
    pose = [1e3, 1e3, 1] * (0.75 * frames.box_pose[0, 0] + 0.25 * frames.box_pose[1, 0])
    wished = np.array([4 * RD, -4 * RD, np.pi / 6]), [0.8 * RD, 0.5 * RD, 1]
    for node, (x, y, yaw), sizes in ((view._boxes, pose, [2, 1, 1]), (view._wished, *wished)):
        np.testing.assert_allclose(node.batched_positions, [[x, y, 0.5]], rtol=1e-5)
        np.testing.assert_allclose(node.batched_wxyzs, [[np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]], atol=1e-6)
        np.testing.assert_allclose(node.batched_scales, [sizes], rtol=1e-5)


@pytest.mark.parametrize("aspect", [0.5, 2.0])
def test_a_camera_sees_all_of_the_arena_and_little_more(aspect):
    camera, scene = SimpleNamespace(), make_scene(4, 2)
    aim(camera, scene, aspect)
    corners = np.column_stack([shapes.outline(scene), np.zeros(4)]) - camera.position
    ahead = np.array(camera.look_at) - camera.position
    up = np.cross([1, 0, 0], ahead)
    places = np.stack([corners[:, 0] / aspect, corners @ up / np.linalg.norm(up)], axis=1)
    places /= (corners @ ahead / np.linalg.norm(ahead))[:, None] * np.tan(camera.fov / 2)
    assert 0.9 < np.abs(places).max() < 1


def test_what_a_robot_knows_hears_and_says():
    payload = Payload({"count": Integer(bits=4)})
    scene = make_scene(4, 2)._replace(is_scout=np.arange(4) == 2, payload=payload_json(payload))
    own = {"message": np.asarray(payload.pack(Message(np.zeros(4, int), {"count": np.array([3, 5, 7, 9])}), 4))}
    own |= {
        "pose": np.array([[0, 0, 0]] * 2 + [[1e-3, -2e-3, -np.pi / 2]] + [[0, 0, 0]]),
        "is_loaded": np.arange(4) > 1,
    }
    own |= {"command": np.array([[0, 0]] * 2 + [[np.pi / 6, 1.5e-4]] + [[0, 0]])}
    links = {name: np.zeros((4, 4), int) for name in ("valid", "sender", "heard", "distance")}
    links["valid"][2, [0, 3]], links["sender"][2], links["heard"][2, 0] = 1, (1, 0, 0, 3), 1
    links |= {"valid": links["valid"] > 0, "heard": links["heard"] > 0, "distance": np.arange(16).reshape(4, 4) * 5e-4}
    own |= {f"link_{name}": values for name, values in links.items()}
    frames = replace(make_frames(scene, 1), **{name: values[None] for name, values in own.items()})
    memory = {"age": np.arange(4.0)[None, None], "is_odd": np.arange(4)[None, None] % 2 > 0}
    assert describe_robot(scene, frames, memory, 2).splitlines() == [
        "**Scout 2**, loaded",
        "At 1.0, -2.0 mm, heading 270°. It turned by 30° and walked 0.15 mm.",
        *("", "| remembers | |", "|---|---|", "| age | 2 |", "| is_odd | no |"),
        *("", "| says | |", "|---|---|", "| count | 7 |"),
        *("", "| hears | robot | at [mm] | |", "|---|---|---|---|"),
        *("| front | 1 | 4.0 | count 5 |", "| right | 3 | 5.5 | damaged |"),
    ]


def test_balls_are_drawn_as_large_as_they_are(session, server):
    view = SwarmView(server.scene, session.scene)
    np.testing.assert_allclose(view._balls.batched_scales, session.scene.ball_radius / 20e-6, rtol=0.2)
    assert np.corrcoef(view._balls.batched_scales, session.scene.ball_radius)[0, 1] > 0.9999


def test_the_dump_is_drawn_as_large_as_it_becomes(server):
    session = Session(PageScenario(CONFIG, robots=20, engine=PlanarSettings()))
    session.advance()
    view = SwarmView(server.scene, session.scene)
    session.set("arena.dump_size", 3.0)
    session.set("arena.dump_size", 4.0)
    view.follow(session.scene)
    (dump,) = [node for name, node in server.scene._handle_from_node_name.items() if name.endswith("/dump/0")]
    np.testing.assert_allclose(dump.dimensions[:2], 4.0 * RD, rtol=1e-6)


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
    known = {"dust_hop": np.arange(20)[None] % 16, "dust_known": np.arange(20)[None] != 1}
    hops = arrays.colours(scene, replace(after, memory=after.memory | known), "hops to dust")
    grades = [(68, 1, 84), (170, 170, 170), (33, 145, 140), (253, 231, 37)]
    assert [tuple(colour) for colour in hops[[0, 1, 8, 15]].tolist()] == grades
    energy = arrays.colours(scene, after, "energy", np.arange(7.0, 27.0))
    assert len(np.unique(energy, axis=0)) == 16 and energy[[0, 19]].tolist() == hops[[0, 15]].tolist()
    legend = arrays.legend(scene, "energy", alive)
    told = dict(zip(("none", "0 or least", "15 or most"), (grades[place] for place in (1, 0, 3)), strict=True))
    assert dict(legend).items() >= {**told, "dead": arrays.DEAD}.items()


def test_trails_end_at_loaded_robots(session):
    scene, _, after = last(session)
    past = [snapshot.frames for snapshot in session.snapshots]
    segments = arrays.trails(scene, past)
    length = min(len(past) - 1, TRAIL_FRAMES)
    assert len(segments) == length * after.is_loaded.sum()
    ends = arrays.moment(scene, after, after, 1.0).centre[after.is_loaded[0]]
    np.testing.assert_array_equal(segments.reshape(-1, length, 2, 3)[:, -1, 1], ends)


def test_hulls_are_drawn_with_their_sizes(tmp_path, server):
    session = Session(PageScenario(CONFIG, engine=PlanarSettings(), robot_file=two_kinds(tmp_path, 6)))
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
