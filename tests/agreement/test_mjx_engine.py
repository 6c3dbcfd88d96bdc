"""Motion, contacts and sight in MJX against MuJoCo in C."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from iswarm_mj.config import ArenaConfig, OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena, read_robot
from iswarm_mj.engines.mjx.arena import Capacities, compile_mjx_arena, without_absent
from iswarm_mj.engines.mjx.contacts import box_box, plane_box
from iswarm_mj.engines.mjx.motion import TOO_MANY_CONTACTS, TOO_MANY_PAIRS, Bodies, Phase, advance, overlapping
from iswarm_mj.engines.mjx.sight import see
from iswarm_mj.engines.mujoco.engine import MujocoBatchEngine
from iswarm_mj.simulation import step as swarm
from iswarm_mj.simulation.initial import place_robots

ROBOT = read_robot()
N, WORLDS = 40, 20
SMALL = SwarmConfig(arena=ArenaConfig(size=10, dump_size=2, dust_area_size=1, dust_area_offset=3.5, n_dust=2))
HERE = np.ones(N, bool)


def crowds(n_worlds=WORLDS, seed=3):
    """Poses (B, N, 3) of robots that stand near and into each other and the walls, as float32 has them."""
    rng = np.random.default_rng(seed)
    poses = np.stack([place_robots(SMALL.arena, N, rng) for _ in range(n_worlds)])
    poses[..., :2] += rng.uniform(-0.5, 0.5, (n_worlds, N, 2))
    return poses.astype(np.float32)


def walks(poses, seed=4):
    """Velocities (B, N, 3): each robot ahead at full speed, and turning."""
    turn = np.random.default_rng(seed).uniform(-1, 1, poses.shape[:2])
    return np.stack([1.4 * np.cos(poses[..., 2]), 1.4 * np.sin(poses[..., 2]), turn], axis=-1).astype(np.float32)


def in_c(poses, config=SMALL):
    engine = MujocoBatchEngine(compile_arena(config, poses.shape[1], np.full(2, 2e-5)), len(poses), 2)
    engine.reset(poses.astype(float), np.zeros((len(poses), 2, 3)))
    return engine


def moved(arena, poses, velocity, n_substeps=10, model=None):
    def one(poses, velocity):
        rest = Bodies(poses, jnp.zeros_like(poses))
        return advance(arena, arena.model if model is None else model, rest, [Phase(n_substeps, lambda _: velocity)])

    return jax.jit(jax.vmap(one))(poses, velocity)


@pytest.fixture(scope="module")
def arena():
    return compile_mjx_arena(SMALL, N, "jax", WORLDS)


class TestMotion:
    @pytest.mark.parametrize("impl", ["jax", pytest.param("warp", marks=pytest.mark.slow)])
    def test_a_control_step_ends_where_mujoco_ends(self, impl):
        pytest.importorskip("warp") if impl == "warp" else None
        poses = crowds()
        velocity = walks(poses)
        bodies, motion = moved(compile_mjx_arena(SMALL, N, impl, WORLDS), poses, velocity)
        engine = in_c(poses)
        engine.advance(velocity.astype(float), 10, np.arange(WORLDS))
        off = np.abs(np.asarray(bodies.poses) - engine.poses())
        assert off[..., :2].max() < 0.02 and off[..., 2].max() < 0.02
        assert not np.asarray(motion.overflow).any()
        pairs = 0
        for world in range(WORLDS):
            touching = np.argwhere(np.asarray(overlapping(motion.before[world, 0], ROBOT))) @ [N, 1]
            np.testing.assert_array_equal(touching, np.unique(engine.contacts(world)))
            pairs += len(touching)
        assert pairs > 100

    def test_robots_that_are_absent_leave_no_trace(self, arena):
        poses, present = crowds(1)[0], HERE.copy()
        present[::2] = False
        velocity = walks(poses[None])[0]
        bodies, _ = moved(arena, poses[None], velocity[None], model=without_absent(arena.model, jnp.asarray(present)))
        engine = in_c(poses[None, present])
        engine.advance(velocity[None, present].astype(float), 10, np.arange(1))
        np.testing.assert_allclose(np.asarray(bodies.poses)[0, present], engine.poses()[0], atol=2e-3)

    def test_too_little_room_is_said(self):
        poses = crowds(2)
        poses[0] = np.column_stack([np.linspace(-12, 12, N), np.zeros(N), np.zeros(N)])  # a row of overlapping robots
        poses[1] = np.column_stack([3.0 * (np.arange(N) % 7) - 9, 3.0 * (np.arange(N) // 7) - 7, np.zeros(N)])
        still = np.zeros_like(poses)
        few_pairs = compile_mjx_arena(SMALL, N, "jax", 2, Capacities(pairs=20, contacts=400))
        assert np.asarray(moved(few_pairs, poses, still, 1)[1].overflow).tolist() == [TOO_MANY_PAIRS, 0]
        few_contacts = compile_mjx_arena(SMALL, N, "jax", 2, Capacities(pairs=400, contacts=20))
        assert np.asarray(moved(few_contacts, poses, still, 1)[1].overflow).tolist() == [TOO_MANY_CONTACTS, 0]


class TestContacts:
    def test_boxes_touch_where_mujoco_says(self):
        rng, count = np.random.default_rng(0), 0
        xml = """<mujoco><worldbody><geom type="box" size="1 1 .5"/>
            <body><freejoint/><geom type="box" size="1 1 .5"/></body></worldbody></mujoco>"""
        model = mujoco.MjModel.from_xml_string(xml)
        data, contact = mujoco.MjData(model), jax.jit(box_box)
        for _ in range(60):
            away, yaw = rng.uniform(-np.pi, np.pi, 2)
            distance = rng.uniform(1.6, 2.6)
            data.qpos[:] = [distance * np.cos(away), distance * np.sin(away), 0, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
            mujoco.mj_forward(model, data)
            boxes = [(data.geom_xpos[i], data.geom_xmat[i].reshape(3, 3), model.geom_size[i]) for i in range(2)]
            ours, points, normal = contact(*boxes)
            self.check(data.contact, ours, points, normal)
            count += data.ncon > 0
        assert count > 25

    def test_boxes_touch_at_one_height_only(self):
        """As all robots that a world does not have, which wait below each other."""
        size, upright, contact = np.array([1.0, 1.0, 0.5]), np.eye(3), jax.jit(box_box)
        for height, touches in ((0.0, True), (0.99, True), (1.01, False), (-1.01, False), (-1000.0, False)):
            boxes = [(np.array([0.1, 0.0, z]), upright, size) for z in (0.0, height)]
            assert (np.asarray(contact(*boxes)[0]) < 0).tolist() == [touches] * 4

    def test_boxes_touch_walls_where_mujoco_says(self):
        rng = np.random.default_rng(1)
        xml = """<mujoco><worldbody><geom type="plane" size="0 0 1" zaxis="1 0 0"/>
            <body><freejoint/><geom type="box" size="1 1 .5"/></body></worldbody></mujoco>"""
        model = mujoco.MjModel.from_xml_string(xml)
        data, contact = mujoco.MjData(model), jax.jit(plane_box)
        for _ in range(30):
            yaw = rng.uniform(-np.pi, np.pi)
            data.qpos[:] = [rng.uniform(0.6, 1.5), rng.uniform(-3, 3), 0, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
            mujoco.mj_forward(model, data)
            boxes = [(data.geom_xpos[i], data.geom_xmat[i].reshape(3, 3), model.geom_size[i]) for i in range(2)]
            ours, points, normal = contact(*boxes)
            self.check(data.contact, ours, points, normal)

    @staticmethod
    def check(theirs, distance, points, normal):
        touches = np.asarray(distance) < 0
        assert touches.sum() == len(theirs)
        if not len(theirs):
            return

        def ordered(distance, points):
            table = np.column_stack([distance, points])
            return table[np.lexsort(np.round(table, 4).T)]

        mine = ordered(np.asarray(distance)[touches], np.asarray(points)[touches])
        np.testing.assert_allclose(mine, ordered(theirs.dist, theirs.pos), atol=2e-5)
        np.testing.assert_allclose(np.tile(normal, (len(theirs), 1)), theirs.frame[:, :3], atol=1e-5)


class TestSight:
    @pytest.mark.parametrize("optics", [OpticsConfig(), OpticsConfig(mode="power"), OpticsConfig(line_of_sight=False)])
    def test_links_and_walls_are_those_of_mujoco(self, arena, optics):
        config = SwarmConfig(arena=SMALL.arena, optics=optics)
        poses = crowds()
        sends = np.random.default_rng(8).random(poses.shape[:2]) < 0.9
        links, walls = swarm.see(config, in_c(poses), poses.astype(float), sends)
        look = jax.jit(jax.vmap(lambda poses, sends: see(config, arena, poses, sends, HERE)))
        ours, our_walls = look(poses, sends)
        np.testing.assert_array_equal(links.valid, ours.valid)
        np.testing.assert_array_equal(links.sender, ours.sender)
        np.testing.assert_array_equal(links.led, ours.led)
        np.testing.assert_allclose(links.bearing, ours.bearing, atol=1e-5)
        np.testing.assert_allclose(links.distance, ours.distance, atol=1e-5)
        np.testing.assert_array_equal(walls, our_walls)
        assert links.valid.sum() > 1500 and walls.sum() > 300

    def test_who_is_absent_is_neither_heard_nor_in_the_way(self, arena):
        poses, present = crowds(1)[0], HERE.copy()
        present[::3] = False
        links, walls = jax.jit(lambda poses: see(SMALL, arena, poses, HERE, present))(poses)
        alone = poses[None, present].astype(float)
        theirs, their_walls = swarm.see(SMALL, in_c(alone), alone, np.ones(alone.shape[:2], bool))
        np.testing.assert_array_equal(np.asarray(links.valid)[present], theirs.valid[0])
        number = np.flatnonzero(present)[theirs.sender[0]]
        np.testing.assert_array_equal(np.where(theirs.valid[0], number, 0), np.asarray(links.sender)[present])
        np.testing.assert_array_equal(np.asarray(walls)[present], their_walls[0])
        assert not np.asarray(links.valid)[~present].any() and not np.asarray(walls)[~present].any()


def test_squares_overlap_as_by_hand():
    def both(x, y, degrees):
        poses = jnp.array([[0.0, 0.0, 0.0], [x, y, np.deg2rad(degrees)]])
        return np.asarray(overlapping(poses, ROBOT)).tolist()

    assert both(1.99, 1.99, 0) == [[False, True], [False, False]]
    assert not np.any(both(2.01, 0, 0)) and not np.any(both(0, -2.01, 0))
    assert np.any(both(2.40, 0, 45)) and not np.any(both(2.42, 0, 45))  # 1 + sqrt 2
    assert not np.any(both(2.15, 2.15, 45)) and np.any(both(1.6, 1.6, 45))  # a corner beside a corner
