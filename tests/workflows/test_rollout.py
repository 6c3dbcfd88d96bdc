"""Rollouts of one's own strategy: what the arrays say, which worlds meet, what faults do, and what is refused."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.mjx import TINY, N, compilations, warp
from support.tasks import Eastward

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.layout import draw_radii, place_robots
from iswarm_mj.utils.errors import FaultKind, UserError
from iswarm_mj.workflows.rollout import Rollout, rollout

KEYS = jax.random.split(jax.random.key(8), 3)
N_FEW = 5
"""Robots that do not meet in what follows."""
NEVER = -1


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Straight(Strategy):
    """Ahead by `stride` [mm] in each step, after a turn by `turn` [rad], in silence; remembers the number of steps."""

    stride: jax.Array
    turn: jax.Array = 0.0
    breaks_at: jax.Array = NEVER
    """Number of the step, from 0, in which robot 4 is asked for no number."""

    def init(self, n_robots, key):
        return jnp.zeros(n_robots, jnp.int32)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, seen, key):
        is_broken = (jnp.arange(len(memory)) == 4) & (memory == self.breaks_at)
        return memory + 1, Command(
            jnp.broadcast_to(self.turn, memory.shape), jnp.where(is_broken, jnp.nan, self.stride)
        )


def straight(stride=(0.0, 0.2, -0.4), turn=0.0, breaks_at=NEVER):
    each = (jnp.broadcast_to(jnp.asarray(a, t), 3) for a, t in ((stride, float), (turn, float), (breaks_at, int)))
    return Straight(*each)


def walk(strategy, engine=None, steps=7):
    """Poses of worlds 2, 0, 1."""
    scenario = Scenario(
        TINY,
        strategy=strategy,
        strategy_per_world=True,
        robots=N_FEW,
        engine=engine or warp(),
        worlds=KEYS,
        steps=steps,
    )
    return rollout(scenario, every=5, poses_of=(2, 0, 1))


@pytest.fixture(scope="module")
def straight_on():
    return walk(straight())


class TestStraightOn:
    """Few robots that go straight ahead, where all is known."""

    def test_each_world_has_its_strategy(self, straight_on):
        poses = straight_on.poses
        assert poses.shape == (3, 8, N_FEW, 3)
        for row, stride in enumerate((-0.4, 0.0, 0.2)):
            start = poses[row, 0]
            ahead = np.stack([np.cos(start[:, 2]), np.sin(start[:, 2])], axis=-1)
            expected = start[:, :2] + np.arange(8)[:, None, None] * stride * ahead
            np.testing.assert_allclose(poses[row, ..., :2], expected, atol=2e-5)

    def test_worlds_begin_as_their_keys_say(self, straight_on):
        for row, world in enumerate((2, 0, 1)):
            rng = np.random.default_rng(np.asarray(jax.random.key_data(KEYS[world])))
            draw_radii(TINY.arena, rng)
            start = place_robots(TINY.arena, N_FEW, rng)
            np.testing.assert_array_equal(straight_on.poses[row, 0], start.astype(np.float32))

    def test_other_values_need_no_compilation(self, straight_on):
        with compilations() as names:
            walk(straight(stride=0.1), steps=4)
        assert names == []

    def test_nothing_is_picked_or_hit(self, straight_on):
        assert straight_on.steps.tolist() == [5, 7]
        for counts in (straight_on.delivered, straight_on.picked, straight_on.collisions, straight_on.finished_at):
            assert counts.tolist() == [0, 0, 0]
        assert straight_on.delivered_after.tolist() == [[0, 0]] * 3 and straight_on.faults == []
        assert np.isnan(straight_on.mean_carriage_steps).all() and not straight_on.is_finished.any()

    def test_mujoco_in_c_comes_to_the_same(self, straight_on):
        theirs = walk(straight(), MujocoSettings(threads=1))
        assert isinstance(theirs, Rollout)
        np.testing.assert_allclose(theirs.poses, straight_on.poses, atol=2e-5)
        for mine, yours in zip(straight_on._replace(poses=None), theirs._replace(poses=None), strict=True):
            jax.tree.map(np.testing.assert_array_equal, mine, yours)
            assert getattr(mine, "dtype", None) == getattr(yours, "dtype", None)
        assert theirs.poses.dtype == straight_on.poses.dtype


def test_a_command_that_is_no_number_ends_its_world_alone(straight_on):
    sound, found = straight_on, walk(straight(breaks_at=(NEVER, 5, NEVER)))
    (fault,) = found.faults
    assert (fault.kind, fault.world, fault.step, fault.robots) == (FaultKind.COMMAND_NOT_FINITE, 1, 6, (4,))
    np.testing.assert_array_equal(found.poses[:2], sound.poses[:2])  # of worlds 2 and 0
    np.testing.assert_array_equal(found.poses[2, :6], sound.poses[2, :6])
    assert (found.poses[2, 5:] == sound.poses[2, 5]).all()


def papers(keys, poses_of=(2, 0), **own):
    fields = {"robots": N, "engine": PlanarSettings(1), "worlds": keys, "steps": 60, "goal": 6}
    return rollout(Scenario(TINY, **fields | own), every=25, poses_of=poses_of)


@pytest.fixture(scope="module")
def swarm():
    return papers(KEYS)


class TestSwarm:
    """The paper's strategy in three worlds."""

    def test_counts_fit_together(self, swarm):
        assert swarm.poses.shape == (2, 61, N, 3) and swarm.delivered_after.shape == (3, 3)
        assert swarm.steps.tolist() == [25, 50, 60]
        assert (np.diff(swarm.delivered_after, axis=1) >= 0).all()
        np.testing.assert_array_equal(swarm.delivered_after[:, -1], swarm.delivered)
        assert (swarm.delivered <= swarm.picked).all() and swarm.picked.min() > 0 and swarm.collisions.min() > 0
        np.testing.assert_array_equal(swarm.is_finished, swarm.delivered >= 6)
        assert swarm.is_finished.any()
        for world in np.flatnonzero(swarm.is_finished):
            late = swarm.steps >= swarm.finished_at[world]
            np.testing.assert_array_equal(swarm.delivered_after[world] >= 6, late)
        np.testing.assert_array_equal(np.isnan(swarm.mean_carriage_steps), swarm.delivered == 0)

    def test_progress_is_that_of_shorter_rollouts(self, swarm):
        shorter = papers(KEYS, steps=50)
        np.testing.assert_array_equal(swarm.delivered_after[:, 1], shorter.delivered)
        np.testing.assert_array_equal(swarm.delivered_after[:, :2], shorter.delivered_after)
        assert len(np.unique(swarm.delivered_after.sum(axis=0))) > 1

    def test_a_world_is_its_key(self, swarm):
        again = papers(KEYS[::-1], poses_of=(0, 2))
        for name, mine, its in zip(Rollout._fields, swarm, again, strict=True):
            if name not in ("steps", "faults"):
                its = its if name == "poses" else jax.tree.map(lambda a: a[::-1], its)
                jax.tree.map(np.testing.assert_array_equal, mine, its)
        np.testing.assert_array_equal(swarm.metrics["picked"], swarm.picked)
        assert len(set(map(tuple, swarm.delivered_after.tolist()))) > 1 or len(set(swarm.collisions)) > 1


class Counting(Eastward):
    """Progress is the number of control steps, without end."""

    def goal(self, config, n_robots):
        return None

    def progress(self, state):
        return state["steps"]


def test_progress_is_counted_after_the_step():
    scenario = Scenario(
        TINY,
        strategy=Straight(jnp.float32(0.0)),
        task=Counting(),
        robots=N_FEW,
        engine=PlanarSettings(1),
        worlds=KEYS,
        steps=7,
    )
    found = rollout(scenario, every=3)
    assert found.steps.tolist() == [3, 6, 7] and found.delivered_after.tolist() == [[3, 6, 7]] * 3


@pytest.mark.parametrize(
    "given, words",
    [
        ({"worlds": KEYS.reshape(3, 1)}, r"worlds must be .* \(got .key<fry>\[3, 1\].\)"),
        ({"worlds": [1, 2]}, r"worlds must be a number above 0, a World for each, or a random key for each"),
        ({"every": 0}, r"every must be .* \(got 0\)"),
        ({"poses_of": (3,)}, r"poses_of must be .* \(got "),
        ({"record": "notes.txt"}, r"record must be a name ending in \.rrd \(got 'notes\.txt'\)"),
        ({"engine": "planar"}, "engine must be .*got 'planar'"),
        ({"strategy": Straight(lambda: 0.1)}, "holds a function where JAX expects an array"),
    ],
)
def test_what_does_not_fit(given, words):
    fields = {"strategy": Straight(jnp.float32(0.1)), "worlds": KEYS, "robots": 2, "steps": 1} | given
    options = {name: fields.pop(name) for name in ("every", "poses_of", "record") if name in fields}
    with pytest.raises(UserError, match=words):
        rollout(Scenario(TINY, engine=fields.pop("engine", PlanarSettings(1)), **fields), **options)
