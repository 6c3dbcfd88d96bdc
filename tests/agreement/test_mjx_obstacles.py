"""Obstacles in MJX: contacts and light as in MuJoCo in C, and full buffers are told."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_obstacles import BOXES, CONFIG, N, starts
from helpers_touching import pairs_of

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mjx.arena import ContactCapacity, compile_mjx_arena, contact_capacity
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mjx.sight import crossed, entries
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.sensors.occlusion import meets_boxes
from iswarm_mj.simulation.step import drive_phases
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.errors import FaultKind
from iswarm_mj.utils.obstacles import distances, numbers
from iswarm_mj.utils.units import RD

PRESENT, RUNNING = np.ones((3, N), bool), np.ones(3, bool)


def engine_with(capacity=None, impl="jax"):
    return MjxEngine(compile_mjx_arena(CONFIG, N, impl, 3, capacity), CONFIG, False)


@pytest.fixture(scope="module")
def in_c():
    return MujocoEngine(CONFIG, compile_arena(CONFIG, N, np.zeros(0)), 3, 1, N)


def moved(engine, poses, command):
    """Motion of three worlds at rest in a control step."""

    def one(engine, poses, command):
        phases = drive_phases(CONFIG.drive, command)
        return engine.move(engine.place(poses, jnp.ones(N, bool)), phases, jnp.bool_(True))

    made = jax.jit(jax.vmap(one, (None, 0, 0)))
    return jax.tree.map(np.asarray, made(engine, jnp.asarray(poses, jnp.float32), jax.tree.map(jnp.float32, command)))


class TestEntries:
    def test_by_hand(self):
        boxes = jnp.asarray(numbers([(3.0, 0.0, 1.0, 2.0, 0.0), (0.0, 6.0, 1.0, 1.0, 45.0)]), jnp.float32)
        origin = jnp.zeros((6, 2))
        way = jnp.array([[4.0, 0], [1.0, 0], [-4.0, 0], [0, 6.0], [4.0, 4.2], [0.0, 0.0]])
        expected = [0.5, np.inf, np.inf, (6 - np.sqrt(2)) / 6, np.inf, np.inf]
        found = entries(origin.at[4].set(jnp.array([-1.0, 0])), way, boxes).min(axis=-1)
        np.testing.assert_allclose(found, expected, rtol=1e-6)
        assert entries(jnp.array([3.5, 1.0]), jnp.array([9.0, 0.0]), boxes).min() == 0  # from inside

    def test_as_on_the_host(self):
        """Straight ways at random, and some along the axes of boxes."""
        rng, boxes = np.random.default_rng(0), numbers(BOXES, RD)
        origin, way = rng.uniform(-15, 15, (2, 4000, 2))
        way[:400, 0], way[400:800, 1] = 0, 0
        given = jnp.asarray(origin, jnp.float32), jnp.asarray(way, jnp.float32), jnp.asarray(boxes)
        found = np.asarray(entries(*given)).min(axis=-1)
        np.testing.assert_array_equal(crossed(*given).any(axis=-1), np.isfinite(found))
        expected = [meets_boxes(*a, *b, boxes) for a, b in zip(origin, way, strict=True)]
        np.testing.assert_array_equal(np.isfinite(found), expected)
        ends = origin + np.where(np.isfinite(found), found, 0)[:, None] * way
        assert distances(ends[np.isfinite(found)], boxes).max() < 1e-4 and np.mean(expected) > 0.2


def test_room_for_obstacles():
    """As much as without them, and more for each; of pairs no more than there are."""
    free = contact_capacity(replace(CONFIG, arena=replace(CONFIG.arena, obstacles=())), N)
    room = contact_capacity(CONFIG, N)
    assert free.pairs < room.pairs and free.contacts + 4 * 8 <= room.contacts
    assert contact_capacity(CONFIG, N, 100.0).pairs == N * (N - 1) // 2 + 4 * N


@pytest.mark.slow
@pytest.mark.parametrize("impl", ["jax", "warp"])
def test_steps_agree(in_c, impl):
    """After each of six control steps, begun at the same places, robots that touch obstacles, but no other robots, are
    within 0.02 mm of C's; of all, also of those that jam, 99 %, and the others within 0.1 mm."""
    pytest.importorskip("warp") if impl == "warp" else None
    rng, poses, engine = np.random.default_rng(1), starts(1), engine_with(contact_capacity(CONFIG, N, 4.0), impl)
    boxes, n_touched, every = numbers(BOXES, RD), 0, []
    for _ in range(6):
        command = Command(rng.uniform(-0.3, 0.3, (3, N)), np.full((3, N), 1.4))
        there = in_c.move(in_c.place(poses.copy(), PRESENT), drive_phases(CONFIG.drive, command), RUNNING)
        here, theirs = moved(engine, poses, command), in_c.poses(there.bodies)
        assert not here.fault.any() and not there.fault.any()
        pairs = pairs_of(there.touching) | pairs_of(here.touching)
        is_alone = ~(pairs.any(axis=1) | pairs.any(axis=2))
        away = distances(theirs[..., :2].reshape(-1, 2), boxes).reshape(3, N)
        assert distances(here.bodies.poses[..., :2].reshape(-1, 2), boxes).min() > 0.8  # half a robot is 1 mm
        off = np.abs(here.bodies.poses - theirs)
        assert off[is_alone].max() < 0.02
        every.append(off[..., :2].max(axis=-1))
        n_touched += (away[is_alone] < 1.2).sum()
        poses = theirs
    assert n_touched > 10
    assert np.mean(np.array(every) < 0.02) > 0.99 and np.max(every) < 0.1


@pytest.mark.slow
def test_light_agrees(in_c):
    """Links, and which LED sees a wall or an obstacle."""
    engine = engine_with()
    all_ = jnp.ones(N, bool)
    look = jax.jit(jax.vmap(lambda p: engine.sense(engine.place(p, all_), all_, jnp.bool_(True))))
    n_seen, n_links, different = 0, 0, 0
    for seed in range(6):
        poses = starts(10 + seed) + np.random.default_rng(seed).uniform(-0.05, 0.05, (3, N, 3))  # no ties
        poses = poses.astype(np.float32)
        mine = jax.tree.map(np.asarray, look(poses))
        yours = in_c.sense(in_c.place(poses.astype(float), PRESENT), PRESENT, RUNNING)
        different += (mine.links.valid != yours.links.valid).sum() + (mine.sees_wall != yours.sees_wall).sum()
        both = mine.links.valid & yours.links.valid
        different += (mine.links.sender[both] != yours.links.sender[both]).sum()
        inside = np.abs(poses[..., :2]).max(axis=-1) < (7.5 - 1.5) * RD - 2.0
        n_seen, n_links = n_seen + mine.sees_wall[inside].sum(), n_links + both.sum()
    assert n_seen > 30 and n_links > 500 and different == 0


@pytest.mark.slow
def test_full_buffers_are_told():
    """Room for fewer pairs than there are near obstacles, in a crowd without contacts of robots."""
    room = contact_capacity(CONFIG, N)
    engine = engine_with(ContactCapacity(8, room.contacts))
    found = moved(engine, starts(1), Command(np.zeros((3, N)), np.zeros((3, N))))
    assert (found.fault & FaultKind.TOO_MANY_PAIRS).all()
