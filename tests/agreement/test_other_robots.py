"""Light of the paper's robots and of others, by every engine.

Links are also compared with a reference that tries every pair. Units: mm.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.robots import HALF, ROBOTS, robot_file, two_kinds
from support.sensing import all_links, crowd, squares_in_the_way
from support.small import SMALL

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mjx.arena import compile_mjx_arena
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.batch_engine import read_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.sensors.links import find_links

WALL = 7.5 * 2 * np.sqrt(2)
"""Distance of the small arena's walls from its centre."""
OPTICS = {
    "sector": OpticsConfig(),
    "blind": OpticsConfig(line_of_sight=False),
    "several": OpticsConfig(baud_rate=2000),
    "power": OpticsConfig(mode="power", baud_rate=2000),
}


@pytest.fixture(scope="module", params=ROBOTS)
def file(request, tmp_path_factory):
    """Return the file of a robot, or those of two kinds; None for the paper's robot."""
    directory = tmp_path_factory.mktemp("robots")
    if request.param == "paper":
        return None
    if request.param == "two kinds":
        poses, _ = crowds(4, 0.5)
        return two_kinds(directory, poses.shape[1])
    return robot_file(directory, request.param)


def crowds(seed, density, n_worlds=2, scale=1.45):
    """Return poses (B, N, 3) of robots that do not overlap, and which of them are inside the walls.

    Some are at walls; all are within the circle of a robot from a square.
    """
    rng = np.random.default_rng(seed)
    poses = np.stack([crowd(rng, density) for _ in range(n_worlds)])
    poses[..., :2] *= scale
    poses[..., :2] += [17.5, -14.0]
    is_inside = np.abs(poses[..., :2]).max(axis=-1) < WALL - 1
    return poses, is_inside


@pytest.mark.parametrize("density", [0.2, 0.6])
def test_links_are_those_of_the_reference(file, density):
    robot = read_robot(file)
    poses, _ = crowds(3, density, 1)
    blocked = squares_in_the_way(poses, HALF)
    links = find_links(poses, robot, OpticsConfig(), blocked)
    sender, led, _ = all_links(poses[0], blocked, robot=robot)
    np.testing.assert_array_equal(np.where(links.valid, links.sender, -1)[0], sender)
    np.testing.assert_array_equal(np.where(links.valid, links.led, -1)[0], led)

    sides = np.nonzero(links.valid)[2]
    bearings = np.float32(robot.sides.bearings)[sides]
    np.testing.assert_allclose(links.measured_bearing[links.valid], bearings)
    assert links.valid.sum() > 10


def readings_of_engines(file, config, poses, is_present, power, with_mjx):
    """Return the `LightReading` of each engine, by its name.

    MJX is optional, since its programs take long to compile.
    """
    n_worlds, n_robots = is_present.shape
    arena = compile_arena(config, n_robots, np.zeros(0), robot_file=file)
    engines = {
        "mujoco": MujocoEngine(config, arena, n_worlds, 1, n_robots),
        "numba": PlanarEngine(config, arena, 1),
        "warp": read_engine(arena, config, jax.default_backend()),
    }

    readings = {}
    for name, engine in engines.items():
        bodies = engine.place(poses, is_present)
        readings[name] = engine.sense(bodies, power, np.ones(n_worlds, bool))
    if with_mjx:
        readings["mjx"] = reading_of_mjx(file, config, poses, is_present, power)
    return readings


def reading_of_mjx(file, config, poses, is_present, power):
    """Return the `LightReading` of MJX, whose engine acts on one world."""
    n_worlds, n_robots = is_present.shape
    arena = compile_mjx_arena(config, n_robots, "jax", 1, robot_file=file)
    engine = MjxEngine(arena, config, is_masked=True)

    @jax.jit
    def sense(poses, is_present, power):
        return engine.sense(engine.place(poses, is_present), power, jnp.array(True))

    single = jnp.asarray(poses, jnp.float32)
    worlds = [sense(single[k], is_present[k], power[k]) for k in range(n_worlds)]
    return jax.tree.map(lambda *parts: np.stack(parts), *worlds)


@pytest.mark.parametrize(
    ("file", "optics_name", "with_mjx"),
    [
        ("paper", "sector", True),
        ("paper", "blind", False),
        ("paper", "several", False),
        ("paper", "power", True),
        ("four askew", "sector", False),
        pytest.param("four askew", "power", True, marks=pytest.mark.slow),
        ("five", "power", False),
        pytest.param("eight", "power", True, marks=pytest.mark.slow),
        ("two kinds", "power", True),
    ],
    indirect=["file"],
)
def test_every_engine_senses_the_same(file, optics_name, with_mjx):
    """Some robots are absent, and neither send, receive nor hide others; some are dark or dim."""
    config = SwarmConfig(arena=SMALL.arena, optics=OPTICS[optics_name])
    poses, is_inside = crowds(4, 0.5)
    emits, is_drawn = np.random.default_rng(5).random((2, *is_inside.shape)) < 0.9
    is_present = is_inside & is_drawn
    power = emits * np.random.default_rng(6).choice([0.3, 1.0], emits.shape)

    readings = readings_of_engines(file, config, poses, is_present, power, with_mjx)

    expected = readings.pop("mujoco")
    valid = expected.links.valid
    assert valid.ndim == (4 if config.optics.baud_rate else 3)
    assert valid.sum() > 30
    assert expected.sees_wall.sum() > 5
    for name, reading in readings.items():
        np.testing.assert_array_equal(reading.links.valid, valid, err_msg=name)
        np.testing.assert_array_equal(reading.sees_wall, expected.sees_wall, err_msg=name)
        for field in reading.links._fields:
            values = np.asarray(getattr(reading.links, field))[valid]
            expected_values = getattr(expected.links, field)[valid]
            is_exact = name == "numba" or expected_values.dtype != np.float32
            limits = {"rtol": 0, "atol": 0 if is_exact else 2e-5}
            message = f"{name} {field}"
            np.testing.assert_allclose(values, expected_values, **limits, err_msg=message)
