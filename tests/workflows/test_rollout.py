"""Rollouts of a user's own strategy: results as arrays, keys of worlds, faults, errors."""

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

ROUNDING = 5e-5
"""Bound of what 32-bit floats round in 200 time steps, 16 mm from the middle [mm]."""
N_WORLDS = 3
KEYS = jax.random.split(jax.random.key(5528), N_WORLDS)
"""Keys of worlds whose robots come near no other one and no wall when they go straight ahead."""
N_FEW = 5
"""Number of robots that do not meet."""
NEVER = -1


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Straight(Strategy):
    """Robots that turn and walk the same in each step, in silence, and count their steps."""

    stride: jax.Array
    """Distance of a step [mm]."""
    turn: jax.Array = 0.0
    """Turn of a step [rad]."""
    breaks_at: jax.Array = NEVER
    """Number of the step, from 0, in which the command of robot 4 is not a number."""

    def init(self, n_robots, key):
        return jnp.zeros(n_robots, jnp.int32)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, seen, key):
        is_fourth = jnp.arange(len(memory)) == 4
        is_broken = is_fourth & (memory == self.breaks_at)
        turn = jnp.broadcast_to(self.turn, memory.shape)
        forward = jnp.where(is_broken, jnp.nan, self.stride)
        return memory + 1, Command(turn, forward)


def straight(stride=(0.0, 0.2, -0.4), turn=0.0, breaks_at=NEVER):
    """Return a strategy of each world, from values of each world or of all."""

    def of_worlds(values, dtype):
        return jnp.broadcast_to(jnp.asarray(values, dtype), N_WORLDS)

    return Straight(
        stride=of_worlds(stride, float),
        turn=of_worlds(turn, float),
        breaks_at=of_worlds(breaks_at, int),
    )


KEPT = (2, 0, 1)
"""Worlds whose poses are kept by `walk`."""


def walk(strategy, engine=None, steps=7):
    """Roll out a strategy of each world."""
    scenario = Scenario(
        TINY,
        strategy=strategy,
        strategy_per_world=True,
        robots=N_FEW,
        engine=engine or warp(),
        worlds=KEYS,
        steps=steps,
    )
    return rollout(scenario, every=5, poses_of=KEPT)


@pytest.fixture(scope="module")
def straight_on():
    return walk(straight())


class TestStraightOn:
    """Few robots that go straight ahead, where everything is known."""

    def test_each_world_has_its_strategy(self, straight_on):
        poses = straight_on.poses
        assert poses.shape == (N_WORLDS, 8, N_FEW, 3)
        steps = np.arange(8)[:, None, None]
        for row, stride in enumerate((-0.4, 0.0, 0.2)):
            start = poses[row, 0]
            ahead = np.stack([np.cos(start[:, 2]), np.sin(start[:, 2])], axis=-1)
            expected = start[:, :2] + steps * stride * ahead
            np.testing.assert_allclose(poses[row, ..., :2], expected, atol=ROUNDING)

    def test_worlds_begin_as_their_keys_say(self, straight_on):
        for row, world in enumerate(KEPT):
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
        for name in ("delivered", "picked", "collisions"):
            assert getattr(straight_on, name).tolist() == [0] * N_WORLDS
        assert straight_on.delivered_after.tolist() == [[0, 0]] * N_WORLDS
        assert straight_on.faults == []
        assert np.isnan(straight_on.mean_carriage_steps).all()
        assert not straight_on.is_finished.any()
        assert np.isnan(straight_on.finished_at).all()

    @pytest.mark.slow
    def test_mujoco_in_c_has_the_same_results(self, straight_on):
        on_cpu = walk(straight(), MujocoSettings(threads=1))
        assert isinstance(on_cpu, Rollout)
        for name in Rollout._fields:
            values = getattr(straight_on, name)
            values_on_cpu = getattr(on_cpu, name)
            if name == "poses":
                np.testing.assert_allclose(values_on_cpu, values, atol=ROUNDING)
            else:
                jax.tree.map(np.testing.assert_array_equal, values_on_cpu, values)
            dtype = getattr(values, "dtype", None)
            assert getattr(values_on_cpu, "dtype", None) == dtype


def test_a_command_that_is_not_a_number_ends_its_world_alone(straight_on):
    broken = walk(straight(breaks_at=(NEVER, 5, NEVER)))
    (fault,) = broken.faults
    assert fault.kind == FaultKind.COMMAND_NOT_FINITE
    assert (fault.world, fault.step, fault.robots) == (1, 6, (4,))

    row = KEPT.index(1)
    np.testing.assert_array_equal(broken.poses[:row], straight_on.poses[:row])
    np.testing.assert_array_equal(broken.poses[row, :6], straight_on.poses[row, :6])
    assert (broken.poses[row, 5:] == straight_on.poses[row, 5]).all()


GOAL = 6
"""Delivered balls after which a world of the swarm is finished."""


def clean(keys, poses_of=(2, 0), steps=60):
    """Roll out the paper's strategy."""
    scenario = Scenario(
        TINY, robots=N, engine=PlanarSettings(1), worlds=keys, steps=steps, goal=GOAL
    )
    return rollout(scenario, every=25, poses_of=poses_of)


@pytest.fixture(scope="module")
def swarm():
    return clean(KEYS)


class TestSwarm:
    """The paper's strategy in three worlds."""

    def test_arrays_have_axes_of_worlds_and_steps(self, swarm):
        assert swarm.poses.shape == (2, 61, N, 3)
        assert swarm.delivered_after.shape == (N_WORLDS, 3)
        assert swarm.steps.tolist() == [25, 50, 60]

    def test_counts_fit_together(self, swarm):
        assert (np.diff(swarm.delivered_after, axis=1) >= 0).all()
        np.testing.assert_array_equal(swarm.delivered_after[:, -1], swarm.delivered)
        assert (swarm.delivered <= swarm.picked).all()
        assert swarm.picked.min() > 0 and swarm.collisions.min() > 0
        np.testing.assert_array_equal(swarm.metrics["picked"], swarm.picked)
        has_carriage = ~np.isnan(swarm.mean_carriage_steps)
        np.testing.assert_array_equal(has_carriage, swarm.delivered > 0)

    def test_worlds_are_finished_at_the_goal(self, swarm):
        np.testing.assert_array_equal(swarm.is_finished, swarm.delivered >= GOAL)
        assert swarm.is_finished.any()
        np.testing.assert_array_equal(np.isfinite(swarm.finished_at), swarm.is_finished)
        for world in np.flatnonzero(swarm.is_finished):
            is_after_end = swarm.steps >= swarm.finished_at[world]
            np.testing.assert_array_equal(swarm.delivered_after[world] >= GOAL, is_after_end)

    def test_progress_is_that_of_shorter_rollouts(self, swarm):
        shorter = clean(KEYS, steps=50)
        np.testing.assert_array_equal(swarm.delivered_after[:, 1], shorter.delivered)
        np.testing.assert_array_equal(swarm.delivered_after[:, :2], shorter.delivered_after)
        assert len(np.unique(swarm.delivered_after.sum(axis=0))) > 1

    def test_a_world_is_determined_by_its_key(self, swarm):
        reversed_worlds = clean(KEYS[::-1], poses_of=(0, 2))
        np.testing.assert_array_equal(swarm.poses, reversed_worlds.poses)
        for name in Rollout._fields:
            if name not in ("steps", "faults", "poses"):
                values = jax.tree.map(lambda array: array[::-1], getattr(reversed_worlds, name))
                jax.tree.map(np.testing.assert_array_equal, getattr(swarm, name), values)

    def test_worlds_differ(self, swarm):
        progress = {tuple(row) for row in swarm.delivered_after.tolist()}
        assert len(progress) > 1 or len(set(swarm.collisions)) > 1


class Counting(Eastward):
    """A task whose progress is the number of control steps, without end."""

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
    results = rollout(scenario, every=3)
    assert results.steps.tolist() == [3, 6, 7]
    assert results.delivered_after.tolist() == [[3, 6, 7]] * N_WORLDS


class TestErrors:
    FIELDS = {  # noqa: RUF012, which no test changes
        "strategy": Straight(jnp.float32(0.1)),
        "worlds": KEYS,
        "robots": 2,
        "engine": PlanarSettings(1),
        "steps": 1,
    }

    @pytest.mark.parametrize(
        ("field", "value", "message"),
        [
            ("worlds", KEYS.reshape(3, 1), r"worlds must be .* \(got .key<fry>\[3, 1\].\)"),
            (
                "worlds",
                [1, 2],
                "worlds must be a number above 0, a World for each, or a random key for each",
            ),
            ("engine", "planar", "engine must be .*got 'planar'"),
            (
                "strategy",
                Straight(lambda: 0.1),
                "holds a function where JAX expects an array",
            ),
        ],
    )
    def test_fields_of_the_scenario_are_named(self, field, value, message):
        with pytest.raises(UserError, match=message):
            rollout(Scenario(TINY, **self.FIELDS | {field: value}))

    @pytest.mark.parametrize(
        ("argument", "value", "message"),
        [
            ("every", 0, r"every must be .* \(got 0\)"),
            ("poses_of", (3,), r"poses_of must be .* \(got "),
            (
                "record",
                "notes.txt",
                r"record must be a name ending in \.rrd \(got 'notes\.txt'\)",
            ),
        ],
    )
    def test_arguments_are_named(self, argument, value, message):
        with pytest.raises(UserError, match=message):
            rollout(Scenario(TINY, **self.FIELDS), **{argument: value})
