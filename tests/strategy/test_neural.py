"""The learned strategy: its network by hand, what it perceives in any frame, its file, and its runs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_sensing import senses_nothing

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.declared import payload_of
from iswarm_mj.strategy.network import MOST_WEIGHTS, Shape, forward, load_weights, save_weights
from iswarm_mj.strategy.neural import INPUTS, SHAPE, SHIPPED, SIGNALS, WAYS, Neural, untrained
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

CONFIG = SwarmConfig(ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=4))
ROBOT = read_robot()


def strategy(**gains):
    """A strategy whose network returns these constants, by the names of ways, `speed` and signals."""
    constants = np.zeros((SHAPE.inputs + 1 + SHAPE.hidden, SHAPE.outputs), np.float32)
    for name, value in gains.items():
        constants[SHAPE.inputs, [*WAYS, "speed", *SIGNALS].index(name)] = value
    return untrained(CONFIG, ROBOT, np.concatenate([np.zeros((SHAPE.inputs + 1) * SHAPE.hidden), constants.ravel()]))


def does(policy, seen, memory=None, key=0):
    memory = policy.init(len(seen.at_dust), jax.random.key(1)) if memory is None else memory
    return policy.act(memory, seen, jax.random.key(key))


def sees(n=1, **changed):
    silence = {name: jnp.zeros((n, 4)) for name in SIGNALS}
    return senses_nothing(n)._replace(payload=silence, **changed)


class TestNetwork:
    def test_by_hand(self):
        """Two inputs, one hidden unit, two outputs: y = A x + a + c tanh(b x + b0), with the weights in that order."""
        shape = Shape(2, 1, 2)
        weights = jnp.array([0.5, -1.0, 0.25, 1, 10, 2, 20, 3, 30, 4, 40], jnp.float32)
        assert shape.n_weights == len(weights) == 11
        x = jnp.array([[1.0, 2.0], [0.0, 0.0]])
        hidden = np.tanh([0.5 - 2.0 + 0.25, 0.25])
        expected = np.array([[1 + 4 + 3, 10 + 40 + 30], [3, 30]]) + np.outer(hidden, [4, 40])
        np.testing.assert_allclose(forward(shape, weights, x), expected, rtol=1e-6)

    def test_weights_are_kept_in_a_file(self, tmp_path):
        weights = np.random.default_rng(0).normal(size=7).astype(np.float32)
        save_weights(tmp_path / "one.npz", weights)
        save_weights(tmp_path / "two.npz", weights)
        np.testing.assert_array_equal(load_weights(tmp_path / "one.npz"), weights)
        assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()

    def test_the_most_weights_fit_into_a_file(self, tmp_path):
        save_weights(tmp_path / "most.npz", np.zeros(MOST_WEIGHTS))
        assert len(load_weights(tmp_path / "most.npz")) == MOST_WEIGHTS

    @pytest.mark.parametrize(
        "content, sentence",
        [
            (None, "cannot be read .*give a file that `iswarm train` wrote"),
            (b"", "is no file of weights"),
            (b"PK\x03\x04 and no more", "is no file of weights"),
            ({"other": np.zeros(3, np.float32)}, "is no file of weights"),
            ({"weights": np.array([{}], object)}, "is no file of weights"),
            ({"weights": np.zeros(2**21, np.float32)}, "is no file of weights|cannot be read"),
            ({"weights": np.zeros((2, 2), np.float32)}, r"has weights float32\[2, 2\]"),
            ({"weights": np.zeros(3)}, r"has weights float64\[3\]"),
            ({"weights": np.array([np.nan], np.float32)}, "finite"),
        ],
    )
    def test_other_files_are_refused(self, tmp_path, content, sentence):
        path = tmp_path / "weights.npz"
        if isinstance(content, bytes):
            path.write_bytes(content)
        elif content is not None:
            np.savez_compressed(path, **content)
        with pytest.raises(UserError, match=sentence):
            load_weights(path)

    def test_weights_of_another_network(self, tmp_path):
        save_weights(tmp_path / "w.npz", np.zeros(SHAPE.n_weights - 1))
        with pytest.raises(UserError, match=f"but the network has {SHAPE.n_weights}"):
            Neural(tmp_path / "w.npz").for_world(CONFIG, ROBOT, 3)


class TestWays:
    def test_ahead_at_full_speed(self):
        _, command = does(strategy(ahead=1, speed=9), sees())
        assert command.turn[0] == 0 and command.forward[0] == pytest.approx(RD / 2)

    def test_towards_the_loudest_and_away_from_it(self):
        heard = jnp.array([[True, False, True, False]])
        around = {"is_heard": heard, "bearing": jnp.array([[0.4, 0, 2.0, 0]]), "distance": jnp.full((1, 4), RD)}
        seen = sees(**around)
        seen = seen._replace(payload=seen.payload | {"b": jnp.array([[0.25, 9, -0.5, 9]])})
        _, command = does(strategy(heard_b=1, speed=1), seen)
        aim = 0.25 * np.array([np.cos(0.4), np.sin(0.4)]) - 0.5 * np.array([np.cos(2.0), np.sin(2.0)])
        assert command.turn[0] == pytest.approx(np.arctan2(aim[1], aim[0]), abs=1e-5)

    def test_what_is_behind_takes_a_turn_first(self):
        """Turns end at 90 degrees; what is 120 degrees to the left is then 30 degrees off, the step its cosine."""
        angle = 2 * np.pi / 3
        ball = jnp.array([[np.cos(angle), np.sin(angle)]]) * 0.5
        _, command = does(strategy(ball=1, speed=1), sees(at_dust=jnp.array([True]), ball_vector=ball))
        assert command.turn[0] == pytest.approx(np.pi / 2)
        assert command.forward[0] == pytest.approx(RD / 2 * np.cos(np.pi / 6), rel=1e-5)

    def test_home_by_its_own_steps(self):
        """A robot that was on the dump and then walked a path knows the way back, whatever the path."""
        rng, policy = np.random.default_rng(3), strategy(home=1, speed=1)
        place, yaw, memory = np.zeros(2), 0.0, None
        for key in range(20):
            walker = strategy(ahead=1, random=rng.uniform(0, 0.9), speed=1)
            memory, command = does(walker, sees(on_dump=jnp.array([key == 0])), memory, key)
            yaw += float(command.turn[0])
            place += float(command.forward[0]) * np.array([np.cos(yaw), np.sin(yaw)])
        _, command = does(policy, sees(), memory)
        wanted = np.arctan2(*-place[::-1]) - yaw
        wanted = (wanted + np.pi) % (2 * np.pi) - np.pi
        assert command.turn[0] == pytest.approx(np.clip(wanted, -np.pi / 2, np.pi / 2), abs=1e-3)

    def test_untrained_robots_turn_away_from_walls_and_others(self):
        policy = untrained(CONFIG, ROBOT)
        wall = does(policy, sees(64, sees_wall=jnp.tile(jnp.array([True, False, False, False]), (64, 1))))[1]
        assert (abs(wall.turn) > np.pi / 4).all()
        free = does(policy, sees(64))[1]
        assert (abs(free.turn) <= np.pi / 6 + 1e-6).all() and (free.forward > 0).all()

    def test_a_mirrored_world_mirrors_what_robots_do(self):
        """Numbers that the network reads do not depend on left and right; only the random way would."""
        rng = np.random.default_rng(5)
        weights = rng.normal(0, 0.5, SHAPE.n_weights).astype(np.float32)
        rows = (SHAPE.inputs + 1) * SHAPE.hidden
        weights[rows:].reshape(-1, SHAPE.outputs)[:, WAYS.index("random")] = 0
        policy = untrained(CONFIG, ROBOT, weights)
        n, order = 16, np.array([0, 3, 2, 1])
        heard, wall = rng.random((2, n, 4)) < 0.4
        bearing = rng.uniform(-0.7, 0.7, (n, 4)) + np.array([0, 1, 2, -1]) * np.pi / 2
        distance = rng.uniform(2, 12, (n, 4))
        told, ball = rng.uniform(-1, 1, (3, n, 4)), rng.uniform(-1.4, 1.4, (n, 2))

        def world(sides, sign):
            return sees(
                n,
                is_heard=jnp.asarray(heard[:, sides]),
                bearing=jnp.asarray(sign * bearing[:, sides], jnp.float32),
                distance=jnp.asarray(distance[:, sides], jnp.float32),
                sees_wall=jnp.asarray(wall[:, sides]),
                at_dust=jnp.ones(n, bool),  # so that nothing is exactly behind
                ball_vector=jnp.asarray(ball * [1, sign], jnp.float32),
            )._replace(payload={name: jnp.asarray(told[i][:, sides]) for i, name in enumerate(SIGNALS)})

        memory, one = does(policy, world(np.arange(4), 1))
        mirrored, other = does(policy, world(order, -1))
        np.testing.assert_allclose(one.turn, -other.turn, atol=2e-5)
        np.testing.assert_allclose(one.forward, other.forward, atol=2e-5)
        np.testing.assert_allclose(memory["said"], mirrored["said"], atol=1e-6)
        assert np.abs(one.turn).max() > 0.5 and np.abs(memory["said"]).min() > 0


class TestSenses:
    def test_a_place_where_nothing_can_be_lifted_is_forgotten(self):
        policy = strategy()
        found = jnp.array([[0.0, 9.0], [0.0, 9.0]])
        memory, _ = does(policy, sees(2, at_dust=jnp.ones(2, bool), ball_vector=found))
        assert memory["food"].known.all()
        memory, _ = does(policy, sees(2, grasp_failed=jnp.array([True, False])), memory)
        np.testing.assert_array_equal(memory["food"].known, [False, True])

    def test_the_loudest_signal_keeps_its_sign(self):
        """Robots whose speed is what they hear walk backwards."""
        weights = np.array(strategy(ahead=1).weights)
        linear = weights[(SHAPE.inputs + 1) * SHAPE.hidden :].reshape(-1, SHAPE.outputs)
        linear[INPUTS.index("heard_a"), len(WAYS)] = 1.0
        seen = sees(is_heard=jnp.array([[True, True, False, True]]))
        for signals, loudest in (((0.5, -0.75, 9, 0), -0.75), ((0.5, 0.25, 9, 0), 0.5)):
            payload = seen.payload | {"a": jnp.array([signals])}
            _, command = does(untrained(CONFIG, ROBOT, weights), seen._replace(payload=payload))
            assert command.forward[0] == pytest.approx(loudest * RD / 2, rel=1e-5)


def test_messages_fit_robots_of_eight_sides():
    payload_of(untrained(CONFIG, ROBOT)).check_room(8)


def test_what_was_decided_is_said_in_the_next_step():
    memory, _ = does(strategy(a=0.5, c=-2), sees(2))
    said = strategy().say(memory, jnp.zeros(2, bool))
    assert [float(said[name][0]) for name in SIGNALS] == pytest.approx([np.tanh(0.5), 0, np.tanh(-2.0)])


def test_names_are_as_many_as_numbers():
    policy = untrained(CONFIG, ROBOT)
    numbers, ways = policy._perceived(policy.init(5, jax.random.key(0)), sees(5), jax.random.key(1))
    assert numbers.shape == (5, len(INPUTS)) and ways.shape == (5, len(WAYS), 2)


def test_the_shipped_weights_are_small_and_used():
    assert SHIPPED.stat().st_size < 2**20
    shipped = Neural().for_world(CONFIG, ROBOT, 3)
    np.testing.assert_array_equal(shipped.weights, load_weights(SHIPPED))
    begins = Neural().for_training(CONFIG, ROBOT, 3)
    np.testing.assert_array_equal(begins.weights, untrained(CONFIG, ROBOT).weights)
    assert (np.asarray(shipped.weights) != np.asarray(begins.weights)).mean() > 0.9


@pytest.mark.parametrize(
    "engine",
    [
        MujocoSettings(1),
        PlanarSettings(1),
        pytest.param(PlanarSettings(impl="warp", chunk=5), marks=pytest.mark.slow),
        pytest.param(MjxSettings(chunk=5), marks=pytest.mark.slow),
    ],
    ids=lambda engine: f"{type(engine).__name__}-{getattr(engine, 'impl', '')}",
)
def test_runs_on_every_engine(engine):
    run = Run(CONFIG, settings=RunSettings(6, 10), engine=engine, strategy=Neural())
    while not run.is_over:
        last = run.advance()
    run.raise_faults()
    said = last.swarm.memory["said"][-1, 0]
    assert np.abs(np.diff(last.poses[-1, 0, :, :2], axis=0)).max() > 0 and np.abs(said).max() > 0
    assert [name for name, _ in run.payload.fields] == list(SIGNALS)
