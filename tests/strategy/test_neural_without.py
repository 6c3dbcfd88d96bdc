"""The learned strategy without one of its parts, and with more than robots can know."""

import jax
import jax.numpy as jnp
import neural_without
import numpy as np
import pytest
from helpers_neural import CONFIG, ROBOT
from helpers_sensing import senses_nothing, turned

from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.believed import Belief


@pytest.mark.parametrize(
    ("name", "flag", "vectors", "keeps"),
    [
        ("NoMessages", False, False, True),
        ("NoVectors", True, False, True),
        ("NoFlag", False, True, True),
        ("NoMemory", True, True, False),
    ],
)
def test_what_is_said_and_what_is_kept(name, flag, vectors, keeps):
    """The number in which robots differ is kept by all, places that are neither sensed nor heard not without memory."""
    policy = getattr(neural_without, name)().for_world(CONFIG, ROBOT, 2)
    both = Belief(np.full((2, 2), 9.0), np.ones(2), np.ones(2, bool))
    before = policy.init(2, jax.random.key(0))._replace(dust=both, dump=both, flag=np.arange(2) == 1)
    said = policy.say(before, jnp.ones(2, bool))
    assert said["priority"].tolist() == [False, flag]
    for place in ("dust", "dump"):
        assert said[place].known.tolist() == [vectors, vectors]
    after, _ = jax.jit(policy.act)(before, senses_nothing(2)._replace(on_dump=np.arange(2) == 1), jax.random.key(1))
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
    nearest, before = set(), run.start.poses[0, 0]
    while not run.is_over:
        record = run.advance()
        poses, memory = record.poses[-1, 0], jax.tree.map(lambda a: np.asarray(a)[-1, 0], record.swarm.memory)
        task = jax.tree.map(lambda a: np.asarray(a)[-1, 0], record.swarm.task)
        assert memory.dust.known.all() and memory.dump.known.all() and not memory.dust.doubt.any()
        np.testing.assert_allclose(memory.dump.vector, turned(-poses[:, :2], -poses[:, 2]), atol=1e-3)
        apart = np.linalg.norm(task.position[None] - before[:, None, :2], axis=2)
        at = np.where(task.is_lying, apart, np.inf).argmin(axis=1)
        nearest |= set(at)
        expected = turned(task.position[at] - poses[:, :2], -poses[:, 2])
        np.testing.assert_allclose(memory.dust.vector, expected, atol=1e-3)
        before = poses
    assert len(nearest) > 1
