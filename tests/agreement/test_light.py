"""Links between robots that touch or overlap, by every engine, against brute force in the plane.

Brute force tries every pair of robots, and every third one's square in between. Units: mm.
"""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.sensing import all_links, place, squares_in_the_way

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mjx.arena import compile_mjx_arena
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.batch_engine import read_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.units import RD

CONFIG = SwarmConfig()
N_ROBOTS = 283
"""Robots of a crowd; the paper's swarms have about as many."""
FAR_AWAY = (40, 40, 0)
"""Row of a robot that hears nobody."""
CORNER = np.sqrt(2)
"""Distance from a robot's centre to its corners."""
HALF_ARENA = CONFIG.arena.size / 2 * RD


@cache
def mujoco_engine(n_robots):
    """Return MuJoCo in C for one world."""
    arena = compile_arena(CONFIG, n_robots, np.zeros(0))
    return MujocoEngine(CONFIG, arena, 1, 1, n_robots)


@cache
def planar_engine():
    """Return the planar engine for CPUs."""
    return PlanarEngine(CONFIG, compile_arena(CONFIG, 1, np.zeros(0)), 1)


@cache
def batch_engine():
    """Return the planar engine for batches."""
    return read_engine(compile_arena(CONFIG, 1, np.zeros(0)), CONFIG, jax.default_backend())


def links_in_world(engine, poses):
    """Return the links of robots (N, 3) that all emit, in an engine of many worlds."""
    everyone = np.ones((1, len(poses)), bool)
    links = engine.sense(engine.place(poses[None], everyone), everyone, np.ones(1, bool)).links
    return jax.tree.map(lambda values: np.asarray(values)[0], links)


@cache
def mjx_sense(n_robots):
    """Return a compiled function of poses (N, 3) that returns the links of MJX."""
    engine = MjxEngine(compile_mjx_arena(CONFIG, n_robots, "jax", 1), CONFIG, is_masked=True)
    everyone = jnp.ones(n_robots, bool)

    @jax.jit
    def sense(poses):
        return engine.sense(engine.place(poses, everyone), everyone, jnp.array(True)).links

    return sense


LINKS = {
    "mujoco": lambda poses: links_in_world(mujoco_engine(len(poses)), poses),
    "numba": lambda poses: links_in_world(planar_engine(), poses),
    "warp": lambda poses: links_in_world(batch_engine(), poses),
    "mjx": lambda poses: mjx_sense(len(poses))(jnp.asarray(poses, jnp.float32)),
}
"""Links (N, S) of robots at (N, 3), by engine."""
all_engines = pytest.mark.parametrize("engine", LINKS)


def senders(links):
    """Return the sender that each side hears (N, S), -1 for none."""
    return np.where(links.valid, links.sender, -1)


def first_hears_second(engine, poses):
    """Return whether the first robot hears the second one in front of it."""
    return senders(LINKS[engine](poses))[0, 0] == 1


def assert_same_as_brute_force(engine, poses):
    """Assert that an engine finds the senders and LEDs of brute force; return their number."""
    sender, led, _ = all_links(poses, squares_in_the_way(poses[None]))
    links = LINKS[engine](poses)
    np.testing.assert_array_equal(senders(links), sender)
    np.testing.assert_array_equal(np.where(links.valid, links.led, -1), led)
    return (sender >= 0).sum()


@all_engines
def test_robots_hear_each_other_through_faces_that_touch(engine):
    """Photodiodes and LEDs are at one place, and no third robot is."""
    poses = place((-1, -1, 0), (1, -1, 0), (-1, 1, 0), (1, 1, 0))
    hears_nobody = -1
    expected = [
        [1, 2, hears_nobody, hears_nobody],
        [hears_nobody, 3, 0, hears_nobody],
        [3, hears_nobody, hears_nobody, 0],
        [hears_nobody, hears_nobody, 2, 1],
    ]
    assert senders(LINKS[engine](poses)).tolist() == expected
    assert assert_same_as_brute_force(engine, poses) == 8


@all_engines
@pytest.mark.parametrize(
    ("third", "hears"),
    [
        ((1, CORNER + 0.02, 45), True),
        ((1, CORNER - 0.02, 45), False),
        ((1, 1 + 0.02, 0), True),
        ((1, 1 - 0.02, 0), False),
    ],
)
def test_a_third_robot_may_cover_the_point_at_which_two_faces_touch(engine, third, hears):
    """The light's path is that point; the third robot's corner or side is beside it."""
    poses = place((0, 0, 0), (2, 0, 180), third, FAR_AWAY)
    assert first_hears_second(engine, poses) == hears


@all_engines
def test_a_robot_that_covers_photodiodes_and_led_hides_the_led(engine):
    """Its corner is in the gap between two robots, so that light begins and ends inside it."""
    apart = place((0, 0, 0), (2.02, 0, 180), (1.01, 0.05 + CORNER, 45), FAR_AWAY)
    between = place((0, 0, 0), (2.02, 0, 180), (1.01, -0.05 + CORNER, 45), FAR_AWAY)
    assert first_hears_second(engine, apart)
    assert not first_hears_second(engine, between)


@all_engines
def test_a_robot_that_covers_an_led_behind_the_sender_s_own_corner_hides_it(engine):
    """Light meets the sender's own body first, which does not hide its LED."""
    pair = [(0, 0, 0), (1.86, -1.21, 176.5)]
    alone = place(*pair, (-40, 40, 0), FAR_AWAY)
    covered = place(*pair, (0.02, -1.79, 3.4), FAR_AWAY)
    assert first_hears_second(engine, alone)
    assert not first_hears_second(engine, covered)


@all_engines
def test_a_sender_inside_its_receiver_may_be_hidden(engine):
    """The third robot is at the photodiodes, which are farther away than the sender's centre."""
    pair = [(0, 0, 0), (0.3, -0.4, 335)]
    alone = place(*pair, (-40, 40, 0), FAR_AWAY)
    hidden = place(*pair, (-0.6, -2.07, 195), FAR_AWAY)
    right_side = 3
    assert senders(LINKS[engine](alone))[0, right_side] == 1
    assert senders(LINKS[engine](hidden))[0, right_side] != 1


def scattered(rng, half_width, n_robots=N_ROBOTS):
    """Return robots anywhere in a square around the centre; they overlap."""
    poses = np.empty((n_robots, 3))
    poses[:, :2] = rng.uniform(-half_width, half_width, (n_robots, 2))
    poses[:, 2] = rng.uniform(-np.pi, np.pi, n_robots)
    return poses


def at_walls(rng):
    """Return scattered robots of which half are at two walls, some pressed into them."""
    poses = scattered(rng, HALF_ARENA - 1)
    is_at_wall = rng.random(N_ROBOTS) < 0.5
    distance = rng.uniform(0.6, 5, is_at_wall.sum())
    side = np.sign(poses[is_at_wall, 0])
    poses[is_at_wall, 0] = side * (HALF_ARENA - distance)
    return poses


def lattice(rng, spacing, spread):
    """Return robots in rows and columns, turned by quarters and by a normal error [rad]."""
    edge = 17
    row = (np.arange(edge) - edge // 2) * spacing
    x, y = np.meshgrid(row, row)
    quarters = rng.integers(0, 4, edge**2) * (np.pi / 2)
    yaw = quarters + spread * rng.normal(size=edge**2)
    return np.column_stack([x.ravel(), y.ravel(), yaw])[:N_ROBOTS]


def lattices(rng):
    """Yield lattices of all spacings and spreads."""
    for spacing in (2.0, 2.1, RD):
        for spread in (0.0, 0.0, 0.01, 0.1, 0.3):
            yield lattice(rng, spacing, spread)


def recorded():
    """Yield states of a sparse and of a dense swarm, every fifth control step."""
    for density in (0.118, 0.3):
        scenario = Scenario(
            CONFIG,
            robots=robots_for(CONFIG.arena, density),
            steps=50,
            engine=PlanarSettings(threads=1),
        )
        run = Run(scenario, record_worlds=())
        for step in range(1, scenario.steps + 1):
            run.advance()
            if step % 5 == 0:
                yield np.asarray(run.arrays()[1].bodies.poses[0], float)


SCENES = {
    "sparse": lambda rng: (scattered(rng, HALF_ARENA - 1.5) for _ in range(20)),
    "dense": lambda rng: (scattered(rng, 12 * RD) for _ in range(20)),
    "heaps": lambda rng: (scattered(rng, 7 * RD) for _ in range(10)),
    "walls": lambda rng: (at_walls(rng) for _ in range(15)),
    "lattices": lattices,
    "recorded": lambda rng: recorded(),
}
"""A hundred scenes, by kind."""


@all_engines
def test_a_heap_hears_as_by_brute_force(engine):
    poses = scattered(np.random.default_rng(9), 4 * RD, n_robots=80)
    assert assert_same_as_brute_force(engine, poses) > 100


@pytest.mark.slow
@pytest.mark.parametrize("kind", SCENES)
def test_a_hundred_crowds_hear_as_by_brute_force(kind):
    n_links = 0
    for poses in SCENES[kind](np.random.default_rng(12)):
        for engine in ("mujoco", "numba"):
            n_links += assert_same_as_brute_force(engine, poses)
    assert n_links > 1000
