"""The learned strategy without one of its parts, and with more than robots can know."""

import jax
import jax.numpy as jnp
import neural_without
import numpy as np
import pytest
from helpers_sensing import senses_nothing, turned

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.believed import Belief

CONFIG = SwarmConfig(ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=6))
ROBOT = read_robot()
NAMES = ("NoMessages", "NoVectors", "NoFlag", "NoMemory", "KnowsAll")


def made(name):
    return getattr(neural_without, name)().for_world(CONFIG, ROBOT, 2)


def remembers(policy, n=2):
    both = Belief(jnp.full((n, 2), 9.0), jnp.ones(n), jnp.ones(n, bool))
    return policy.init(n, jax.random.key(0))._replace(dust=both, dump=both, flag=jnp.arange(n) == 1)


@pytest.mark.parametrize(
    ("name", "flag", "vectors"),
    [("NoMessages", False, False), ("NoVectors", True, False), ("NoFlag", False, True), ("NoMemory", True, True)],
)
def test_what_is_said(name, flag, vectors):
    said = made(name).say(remembers(made(name)), jnp.ones(2, bool))
    assert said["priority"].tolist() == [False, flag]
    for place in ("dust", "dump"):
        assert said[place].known.tolist() == [vectors, vectors]


@pytest.mark.parametrize("name", NAMES[:4])
def test_what_is_kept(name):
    """The number in which robots differ is kept by all, places that are neither sensed nor heard not without memory."""
    policy = made(name)
    before, seen = remembers(policy), senses_nothing(2)._replace(on_dump=jnp.array([False, True]))
    after, _ = policy.act(before, seen, jax.random.key(1))
    keeps = name != "NoMemory"
    assert after.dust.known.tolist() == [keeps, keeps] and after.dump.known.tolist() == [keeps, True]
    np.testing.assert_array_equal(after.character, before.character)


def test_all_is_known():
    """Vectors after the step lead to the dump, and to the ball that was nearest before it."""
    run = Run(
        CONFIG,
        settings=RunSettings(3, 12, seed=2),
        engine=PlanarSettings(1),
        strategy=neural_without.KnowsAll(),
        task=neural_without.Told(),
    )
    nearest, before = set(), None
    while not run.is_over:
        record = run.advance()
        poses, memory = record.poses[-1, 0], jax.tree.map(lambda a: np.asarray(a)[-1, 0], record.swarm.memory)
        task = jax.tree.map(lambda a: np.asarray(a)[-1, 0], record.swarm.task)
        assert memory.dust.known.all() and memory.dump.known.all() and not memory.dust.doubt.any()
        np.testing.assert_allclose(memory.dump.vector, turned(-poses[:, :2], -poses[:, 2]), atol=1e-3)
        if before is not None and task.is_lying.any():
            apart = np.linalg.norm(task.position[None] - before[:, None, :2], axis=2)
            at = np.where(task.is_lying, apart, np.inf).argmin(axis=1)
            nearest |= set(at)
            expected = turned(task.position[at] - poses[:, :2], -poses[:, 2])
            np.testing.assert_allclose(memory.dust.vector, expected, atol=1e-3)
        before = poses
    assert len(nearest) > 1
