"""Light by every engine, of the paper's robots and of others, and against a reference that tries every pair."""

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

EDGE = 7.5 * 2 * np.sqrt(2)


@pytest.fixture(scope="module", params=ROBOTS)
def file(request, tmp_path_factory):
    """File of a robot, or of each kind; none for the paper's."""
    directory = tmp_path_factory.mktemp("robots")
    if request.param == "two kinds":
        return two_kinds(directory, crowds(4, 0.5)[1].shape[1])
    return None if request.param == "paper" else robot_file(directory, request.param)


def crowds(seed, density, n_worlds=2, scale=1.45):
    """Poses (B, N, 3) of robots that do not overlap, some at walls; all within the circle of a robot from a square."""
    rng = np.random.default_rng(seed)
    poses = np.stack([crowd(rng, density) for _ in range(n_worlds)])
    poses[..., :2] *= scale
    poses[..., :2] += [17.5, -14.0]
    return poses, np.abs(poses[..., :2]).max(axis=-1) < EDGE - 1


@pytest.mark.parametrize("density", [0.2, 0.6])
def test_links_are_those_of_the_reference(file, density):
    robot, (poses, _) = read_robot(file), crowds(3, density, 1)
    reaches = squares_in_the_way(poses, HALF)
    links = find_links(poses, robot, OpticsConfig(), reaches)
    sender, led, _ = all_links(poses[0], reaches, robot=robot)
    np.testing.assert_array_equal(np.where(links.valid, links.sender, -1)[0], sender)
    np.testing.assert_array_equal(np.where(links.valid, links.led, -1)[0], led)
    heard = links.measured_bearing[links.valid]
    np.testing.assert_allclose(heard, np.float32(robot.sides.bearings)[np.nonzero(links.valid)[2]])
    assert links.valid.sum() > 10


def senses(file, config, poses, inside, emits, in_mjx):
    """`LightReading` of each engine, of MJX where asked for, whose programs take long to compile."""
    n_worlds, n_robots = inside.shape
    arena, running = compile_arena(config, n_robots, np.zeros(0), robot_file=file), np.ones(n_worlds, bool)
    engines = {
        "mujoco": MujocoEngine(config, arena, n_worlds, 1, n_robots),
        "numba": PlanarEngine(config, arena, 1),
        "warp": read_engine(arena, config, jax.default_backend()),
    }
    sights = {name: e.sense(e.place(poses, inside), emits, running) for name, e in engines.items()}
    if not in_mjx:
        return sights
    mjx = MjxEngine(compile_mjx_arena(config, n_robots, "jax", 1, robot_file=file), config, is_masked=True)

    @jax.jit
    def sense(poses, inside, emits):
        return mjx.sense(mjx.place(poses, inside), emits, jnp.array(True))

    each = [sense(jnp.asarray(p, jnp.float32), i, e) for p, i, e in zip(poses, inside, emits, strict=True)]
    return sights | {"mjx": jax.tree.map(lambda *parts: np.stack(parts), *each)}


OPTICS = {
    "sector": OpticsConfig(),
    "blind": OpticsConfig(line_of_sight=False),
    "several": OpticsConfig(baud_rate=2000),
    "power": OpticsConfig(mode="power", baud_rate=2000),
}


@pytest.mark.parametrize(
    ("file", "optics", "in_mjx"),
    [
        *(("paper", optics, optics in ("sector", "power")) for optics in OPTICS),
        *(("four askew", optics, optics == "power") for optics in ("sector", "power")),
        *((robot, "power", robot != "five") for robot in ("five", "eight", "two kinds")),
    ],
    indirect=["file"],
)
def test_every_engine_senses_the_same(file, optics, in_mjx):
    """Some robots are absent, and neither send, nor receive, nor hide others; some are dark, others dim."""
    config = SwarmConfig(arena=SMALL.arena, optics=OPTICS[optics])
    poses, inside = crowds(4, 0.5)
    emits, present = np.random.default_rng(5).random((2, *inside.shape)) < 0.9
    inside &= present
    power = emits * np.random.default_rng(6).choice([0.3, 1.0], emits.shape)
    sights = senses(file, config, poses, inside, power, in_mjx)
    expected = sights.pop("mujoco")
    assert expected.links.valid.ndim == (4 if config.optics.baud_rate else 3)
    assert expected.links.valid.sum() > 30 and expected.sees_wall.sum() > 5
    for name, sight in sights.items():
        np.testing.assert_array_equal(sight.links.valid, expected.links.valid, err_msg=name)
        for field, values, wanted in zip(sight.links._fields, sight.links, expected.links, strict=True):
            values, wanted = np.asarray(values)[expected.links.valid], wanted[expected.links.valid]
            exact = name == "numba" or wanted.dtype != np.float32
            np.testing.assert_allclose(values, wanted, rtol=0, atol=0 if exact else 2e-5, err_msg=f"{name} {field}")
        np.testing.assert_array_equal(sight.sees_wall, expected.sees_wall, err_msg=name)
