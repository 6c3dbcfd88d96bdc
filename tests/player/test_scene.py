"""The view draws robots and balls where they are, in millimetres."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.page import node_of
from support.robots import two_kinds
from support.swarm_recording import make_frames, make_scene

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output import shapes
from iswarm_mj.output.message_columns import payload_json
from iswarm_mj.output.palette import LOADED, rgb
from iswarm_mj.output.shapes import TRAIL_FRAMES, link_ends
from iswarm_mj.output.swarm_classes import BALL_CLASSES, DEAD
from iswarm_mj.player import scene as arrays
from iswarm_mj.player.inspection import describe_robot
from iswarm_mj.player.page import close_server, open_server
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.view import SwarmView, aim
from iswarm_mj.sensors.fields import Integer
from iswarm_mj.sensors.messages import Message, Payload
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.utils.units import RD

CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))


N_STEPS = 66
"""Control steps after which some messages are heard and others damaged, and some balls held."""


@pytest.fixture(scope="module")
def session():
    session = Session(PageScenario(CONFIG, robots=20, seed=3, engine=PlanarSettings()))
    for _ in range(N_STEPS):
        session.advance()
    return session


def last(session):
    """Return the scene of a session, and its frames before and after the latest step."""
    before, after = [snapshot.frames for snapshot in session.snapshots][-2:]
    return session.scene, before, after


def test_robots_and_balls_are_where_the_engine_has_them(session):
    scene, before, after = last(session)
    drawn = arrays.moment(scene, before, after, 1.0)
    _, state = session.run.arrays()
    poses = state.bodies.poses[0]
    np.testing.assert_allclose(drawn.centre[:, :2], poses[:, :2], atol=1e-4)
    np.testing.assert_allclose(drawn.yaw, poses[:, 2], atol=1e-5)
    np.testing.assert_allclose(drawn.centre[:, 2], 0.5)

    balls = session.run.task_state
    is_free = ~balls.is_held[0]
    assert 0 < is_free.sum() < len(is_free)
    np.testing.assert_allclose(drawn.ball[is_free, :2], balls.position[0][is_free], atol=1e-3)
    lift = np.where(is_free, 0.0, 1.2)  # a held ball is drawn on top of its robot
    height = 1e3 * after.ball_position[0, :, 2] + lift
    np.testing.assert_allclose(drawn.ball[:, 2], height, atol=1e-5)

    lying, held, delivered = [colour for _, _, colour in BALL_CLASSES]
    expected = np.full((len(is_free), 3), lying)
    expected[balls.is_delivered[0]] = delivered
    expected[balls.is_held[0]] = held
    np.testing.assert_array_equal(drawn.ball_colour, expected)


@pytest.fixture
def server():
    server = open_server(9300)
    yield server
    close_server(server)


def test_lines_lead_to_senders_that_are_heard_or_damaged(session, server):
    scene, before, after = last(session)
    view = SwarmView(server.scene, scene)
    view.show([before, after], 1.0)
    ends = link_ends(after, shapes.centres(scene, after.pose))
    is_heard = after.link_heard[after.link_valid]
    assert 0 < is_heard.sum() != (~is_heard).sum() > 0
    np.testing.assert_allclose(node_of(server, "/swarm/heard").points, ends[is_heard], atol=1e-5)
    np.testing.assert_allclose(node_of(server, "/swarm/damaged").points, ends[~is_heard], atol=1e-5)


def test_no_lines_lead_to_dead_robots(session, server):
    scene, before, after = last(session)
    is_alive = np.ones(after.is_alive.shape, bool)
    receiver = np.nonzero(after.link_valid)[1][0]
    is_alive[0, receiver] = False
    n_links_of_receiver = after.link_valid[0, receiver].sum()

    view = SwarmView(server.scene, scene)
    view.show([before, replace(after, is_alive=is_alive)], 1.0)
    lines = [node_of(server, f"/swarm/{name}").points for name in ("heard", "damaged")]
    assert sum(map(len, lines)) == after.link_valid.sum() - n_links_of_receiver


def test_boxes_are_turned_where_they_are_pushed_and_obstacles_where_they_are_planned(server):
    scene = make_scene(4, 2)
    frames = make_frames(scene, 2)
    view = SwarmView(server.scene, scene)
    view.show([frames[:1], frames[1:]], 0.25)
    view.draw_planned([(4.0, -4.0, 0.8, 0.5, 30.0)])

    pose_in_m = 0.75 * frames.box_pose[0, 0] + 0.25 * frames.box_pose[1, 0]
    boxes = node_of(server, "/swarm/boxes")
    assert_lies(boxes, pose=[1e3, 1e3, 1] * pose_in_m, half_sizes=[2, 1, 1])
    planned_pose = [4 * RD, -4 * RD, np.pi / 6]
    planned = node_of(server, "/swarm/planned")
    assert_lies(planned, pose=planned_pose, half_sizes=[0.8 * RD, 0.5 * RD, 1])


def assert_lies(node, *, pose, half_sizes):
    """Check that the only instance of a node has a pose x, y [mm], yaw [rad], and half sizes
    [mm]."""
    x, y, yaw = pose
    turn = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    np.testing.assert_allclose(node.batched_positions, [[x, y, 0.5]], rtol=1e-5)
    np.testing.assert_allclose(node.batched_wxyzs, [turn], atol=1e-6)
    np.testing.assert_allclose(node.batched_scales, [half_sizes], rtol=1e-5)


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
    """Robot 2 hears robot 1 at its front, and a damaged message of robot 3 at its right."""
    payload = Payload({"count": Integer(bits=4)})
    scene = make_scene(4, 2)._replace(is_scout=np.arange(4) == 2, payload=payload_json(payload))
    counts = {"count": np.array([3, 5, 7, 9])}

    pose = np.zeros((4, 3))
    pose[2] = [1e-3, -2e-3, -np.pi / 2]
    command = np.zeros((4, 2))
    command[2] = [np.pi / 6, 1.5e-4]

    link_valid = np.zeros((4, 4), bool)
    link_valid[2, [0, 3]] = True
    link_sender = np.zeros((4, 4), int)
    link_sender[2] = [1, 0, 0, 3]
    link_heard = np.zeros((4, 4), bool)
    link_heard[2, 0] = True

    changed = {
        "message": np.asarray(payload.pack(Message(np.zeros(4, int), counts), 4)),
        "pose": pose,
        "is_loaded": np.arange(4) > 1,
        "command": command,
        "link_valid": link_valid,
        "link_sender": link_sender,
        "link_heard": link_heard,
        "link_distance": np.arange(16).reshape(4, 4) * 5e-4,
    }
    one_frame = {name: values[None] for name, values in changed.items()}
    frames = replace(make_frames(scene, 1), **one_frame)
    memory = {"age": np.arange(4.0)[None, None], "is_odd": np.arange(4)[None, None] % 2 > 0}
    assert describe_robot(scene, frames, memory, 2).splitlines() == [
        "**Scout 2**, loaded",
        "",
        "At 1.0, -2.0 mm, heading 270°. It turned by 30° and walked 0.15 mm.",
        *("", "| remembers | |", "|:--|:--|", "| age | 2 |", "| is_odd | no |"),
        *("", "| says | |", "|:--|:--|", "| count | 7 |"),
        *("", "| hears | robot | distance [mm] | message |", "|:--|:--|:--|:--|"),
        *("| front | 1 | 4.0 | count 5 |", "| right | 3 | 5.5 | damaged |"),
    ]


def test_balls_are_drawn_as_large_as_they_are(session, server):
    SwarmView(server.scene, session.scene)
    scales = node_of(server, "/swarm/balls").batched_scales
    radii = session.scene.ball_radius
    np.testing.assert_allclose(scales, radii / 20e-6, rtol=0.2)
    assert np.corrcoef(scales, radii)[0, 1] > 0.9999


def test_the_dump_is_drawn_as_large_as_it_becomes(server):
    session = Session(PageScenario(CONFIG, robots=20, engine=PlanarSettings()))
    session.advance()
    view = SwarmView(server.scene, session.scene)
    session.set("arena.dump_size", 3.0)
    session.set("arena.dump_size", 4.0)
    view.follow(session.scene)
    dump = node_of(server, "/swarm/dump/0")
    np.testing.assert_allclose(dump.dimensions[:2], 4.0 * RD, rtol=1e-6)


def test_robots_and_the_balls_that_they_carry_are_between_two_steps(session):
    """Balls that a robot holds before and after; a robot goes 1 mm at most."""
    n_moved = 0
    for snapshot, next_snapshot in itertools.pairwise(session.snapshots):
        before, after = snapshot.frames, next_snapshot.frames
        start, middle, end = [
            arrays.moment(session.scene, before, after, share) for share in (0.0, 0.25, 1.0)
        ]
        mean_centre = 0.75 * start.centre + 0.25 * end.centre
        np.testing.assert_allclose(middle.centre, mean_centre, atol=1e-4)
        np.testing.assert_allclose(start.centre[:, :2], before.pose[0, :, :2] * 1e3, atol=1e-4)

        is_held = (before.ball_state[0] == 1) & (after.ball_state[0] == 1)
        mean_ball = 0.75 * start.ball + 0.25 * end.ball
        np.testing.assert_allclose(middle.ball[is_held], mean_ball[is_held], atol=1e-4)
        distance = np.linalg.norm(end.ball - start.ball, axis=-1)
        n_moved += (is_held & (distance > 0.2)).sum()
    assert n_moved > 10


def test_arrows_are_what_robots_remember_turned_to_the_arena(session):
    n_known = 0
    for snapshot in session.snapshots:
        drawn = arrays.moment(session.scene, snapshot.frames, snapshot.frames, 1.0)
        arrows = arrays.arrows(session.scene, snapshot.frames, drawn.centre)
        assert set(arrows) == {"dust", "dump"}
        for name, ends in arrows.items():
            memory = getattr(snapshot.record.swarm.memory, name)
            is_known = np.asarray(memory.known)[0, 0]
            x, y = np.asarray(memory.vector)[0, 0][is_known].T
            cos, sin = np.cos(drawn.yaw[is_known]), np.sin(drawn.yaw[is_known])
            turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
            direction = ends[:, 1] - ends[:, 0]
            np.testing.assert_allclose(direction[:, :2], turned, atol=1e-3)
            n_known += len(ends)
    assert n_known > 0


VIOLET, GREY, TEAL, LIME = (68, 1, 84), (170, 170, 170), (33, 145, 140), (253, 231, 37)
"""Colours of 0 hops, of none, of 8 and of 15."""


def test_colours_of_states_and_deaths(session):
    scene, _, after = last(session)
    is_alive = np.ones(20, bool)
    is_alive[1] = False
    colours = arrays.colours(scene, replace(after, is_alive=is_alive[None]), arrays.STATE)
    is_loaded = after.is_loaded[0] & ~after.has_priority[0] & is_alive
    assert (colours[is_loaded] == rgb(LOADED)).all()
    assert tuple(colours[1]) == DEAD.colour


def test_colours_of_hops_and_energy(session):
    scene, _, after = last(session)
    ways = arrays.ways_to_colour(scene, after, np.ones(20))
    assert ways == ["state", "hops to dust", "hops to dump", "energy"]

    numbers = np.arange(20)[None]
    memory = after.memory | {"dust_hop": numbers % 16, "dust_known": numbers != 1}
    hops = arrays.colours(scene, replace(after, memory=memory), "hops to dust")
    assert [tuple(colour) for colour in hops[[0, 1, 8, 15]].tolist()] == [VIOLET, GREY, TEAL, LIME]

    energy = arrays.colours(scene, after, "energy", np.arange(7.0, 27.0))
    assert len(np.unique(energy, axis=0)) == 16
    assert [tuple(colour) for colour in energy[[0, 19]].tolist()] == [VIOLET, LIME]


def test_the_legend_explains_the_colours_and_the_dead(session):
    is_alive = np.arange(20) != 1
    by_hops = dict(arrays.legend(session.scene, "hops to dust", (), is_alive))
    robots = dict(by_hops["Robots"])
    assert robots["unknown"] == GREY
    assert robots["0 hops"] == VIOLET
    assert robots["15 hops or more"] == LIME
    assert robots["dead"] == DEAD.colour

    by_energy = dict(arrays.legend(session.scene, "energy", (), np.ones(20, bool)))
    assert [*dict(by_energy["Robots"])] == ["least of all robots", "", "most of all robots"]


def test_the_legend_explains_what_is_drawn_and_lies_on_the_floor(session):
    drawn = ("links", "trails", "dump")
    legend = dict(arrays.legend(session.scene, arrays.STATE, drawn, np.ones(20, bool)))
    assert "empty, sends priority" in dict(legend["Robots"])
    assert [label for label, _ in legend["Balls, drawn enlarged"]] == [
        "on the floor",
        "held",
        "delivered",
    ]
    assert [label for label, _ in legend["Lines"]] == [
        "link, heard",
        "link, damaged message",
        "trail",
        "remembers dump",
    ]
    assert [label for label, _ in legend["Floor"]] == ["dump", "dust area"]


def test_the_legend_leaves_out_what_a_swarm_does_not_have():
    """Beeclust neither sends priority nor carries balls, and its task has a bright spot."""
    task = Aggregation(spot_radius=4.0, spot_offset=7.0)
    scenario = PageScenario(
        CONFIG, task=task, strategy=Beeclust(), robots=20, engine=PlanarSettings()
    )
    scene = Session(scenario).scene
    legend = arrays.legend(scene, arrays.STATE, ("trails",), np.ones(20, bool))
    assert [(heading, [label for label, _ in entries]) for heading, entries in legend] == [
        ("Robots", ["empty"]),
        ("Floor", ["bright", "dim"]),
    ]


def test_trails_end_at_loaded_robots(session):
    scene, _, after = last(session)
    past = [snapshot.frames for snapshot in session.snapshots]
    segments = arrays.trails(scene, past)
    length = min(len(past) - 1, TRAIL_FRAMES)
    assert len(segments) == length * after.is_loaded.sum()
    ends = arrays.moment(scene, after, after, 1.0).centre[after.is_loaded[0]]
    np.testing.assert_array_equal(segments.reshape(-1, length, 2, 3)[:, -1, 1], ends)


def test_hulls_are_drawn_with_their_sizes(tmp_path, server):
    session = Session(
        PageScenario(CONFIG, engine=PlanarSettings(), robot_file=two_kinds(tmp_path, 6))
    )
    session.advance()
    view = SwarmView(server.scene, session.scene)
    view.show([snapshot.frames for snapshot in session.snapshots], 1.0)
    hull = view.nodes["robots"]
    front = view.nodes["fronts"]
    for scales in (hull.batched_scales, front.batched_scales):
        sizes = np.ptp(hull.vertices, axis=0) * scales
        np.testing.assert_allclose(sizes[[1, 3]], [[2.0, 2.0, 1.0], [2.4, 1.6, 1.0]], atol=1e-6)

    # The quaternion turns by the yaw.
    w, _, _, z = hull.batched_wxyzs[1]
    yaw = session.snapshots[-1].frames.pose[0, 1, 2]
    np.testing.assert_allclose([w * w - z * z, 2 * w * z], [np.cos(yaw), np.sin(yaw)], atol=1e-5)

    # The front lies ahead of the centre, on the hull.
    assert front.vertices[:, 0].min() > 0.2
    assert front.vertices[:, 0].max() < 0.5


def test_the_robot_remembers_and_says_lengths_in_millimetres(session):
    scene, _, after = last(session)
    memory = session.snapshots[-1].record.swarm.memory
    knows = np.flatnonzero(after.memory["dust_known"][0])
    robot = int(knows[0])
    ahead, left = after.memory["dust_vector"][0, robot] * 1e3
    text = describe_robot(scene, after, memory, robot)
    assert f"| dust.vector | {ahead or 0:.4g}, {left or 0:.4g} mm |" in text
    assert "-0 " not in text
