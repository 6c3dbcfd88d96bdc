"""The learned strategy: its network by hand, its motion, its files of weights, and its runs."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.neural import CONFIG, ROBOT, does, sees, strategy
from support.robots import robot_file
from support.sensing import remember, senses_nothing

from iswarm_mj.config.swarm import DriveConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.attributes import payload_of
from iswarm_mj.strategy.beliefs import Belief
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.strategy.network import Shape, forward, load_weights, save_weights
from iswarm_mj.strategy.neural import DIRECTIONS, N_WEIGHTS, SHIPPED, Neural, untrained
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy, payload_for
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD, mm_from_rd


class TestNetwork:
    def test_by_hand(self):
        """Two inputs, one hidden unit, two outputs: y = A x + a + c tanh(b x + b0).

        The weights are b, b0, then rows of A, a and c.
        """
        shape = Shape(2, 1, 2)
        weights = np.float32([0.5, -1.0, 0.25, 1, 10, 2, 20, 3, 30, 4, 40])
        assert shape.n_weights == len(weights) == 11
        x = np.float32([[1.0, 2.0], [0.0, 0.0]])
        hidden = np.tanh([0.5 - 2.0 + 0.25, 0.25])
        expected = np.array([[1 + 4 + 3, 10 + 40 + 30], [3, 30]]) + np.outer(hidden, [4, 40])
        np.testing.assert_allclose(forward(shape, weights, x), expected, rtol=1e-6)

    def test_weights_are_kept_in_a_file(self, tmp_path):
        weights = np.random.default_rng(0).normal(size=7).astype(np.float32)
        save_weights(tmp_path / "one.npz", weights)
        save_weights(tmp_path / "two.npz", weights)
        np.testing.assert_array_equal(load_weights(tmp_path / "one.npz"), weights)
        assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()

    @pytest.mark.parametrize(
        "content, sentence",
        [
            (None, "cannot be read .*give a file that `iswarm train` wrote"),
            (b"", "is no file of weights"),
            ({"other": np.zeros(3, np.float32)}, "is no file of weights"),
            ({"weights": np.zeros(2**21, np.float32)}, "is no file of weights|cannot be read"),
            ({"weights": np.zeros((2, 2), np.float32)}, r"has weights float32\[2, 2\]"),
            ({"weights": np.zeros(2)}, r"has weights float64\[2\]"),
            ({"weights": np.array([1, np.nan], np.float32)}, "finite"),
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

    @pytest.mark.parametrize("more", [-1, 1])
    def test_weights_of_another_network(self, tmp_path, more):
        save_weights(tmp_path / "w.npz", np.zeros(N_WEIGHTS + more))
        with pytest.raises(UserError, match=f"but {N_WEIGHTS} are wanted"):
            Neural(tmp_path / "w.npz").for_world(CONFIG, ROBOT, 3)


N_ROBOTS = 64
WALL_AHEAD = [True, False, False, False]
WALL_LEFT = [False, True, False, False]


def known_place(vectors):
    """Return beliefs without doubt in places at these vectors (N, 2)."""
    vectors = np.asarray(vectors, np.float32)
    n_robots = len(vectors)
    return Belief(vectors, np.zeros(n_robots, np.float32), np.ones(n_robots, bool))


class TestDirections:
    """Commands of robots whose network weighs directions in a simple way."""

    @pytest.mark.parametrize(
        ("speed", "forward"),
        [
            (9, RD / 2),
            (-0.5, -RD / 4),
        ],
    )
    def test_ahead_at_full_speed_and_backwards(self, speed, forward):
        _, command = does(strategy(ahead=1, speed=speed), sees())
        assert command.turn[0] == 0
        assert command.forward[0] == pytest.approx(forward)

    @pytest.mark.parametrize("max_turn", [90, 60])
    def test_robots_turn_before_they_walk_back(self, max_turn):
        """The dump is 120 degrees to the left; the step shrinks by the cosine of what is left."""
        to_dump = np.radians(120)
        dump = known_place([[9 * np.cos(to_dump), 9 * np.sin(to_dump)]])
        memory = strategy().init(1, jax.random.key(1))._replace(dump=dump)
        config = replace(CONFIG, drive=DriveConfig(max_turn=max_turn))
        policy = replace(strategy(dump=1, speed=1), config=config.static)
        _, command = does(policy, sees(), memory)

        left = np.radians(120 - max_turn)
        assert command.turn[0] == pytest.approx(np.radians(max_turn))
        assert command.forward[0] == pytest.approx(RD / 2 * np.cos(left), rel=1e-5)

    def test_a_ball_within_reach_comes_first(self):
        """The tip goes over it, whatever the network returns; loaded robots leave it."""
        observation = sees(
            2,
            at_dust=np.ones(2, bool),
            ball_vector=np.float32([[0.0, 1.5], [0.0, 1.5]]),
            is_loaded=np.array([False, True]),
        )
        _, command = does(strategy(ahead=1, speed=1), observation)
        to_ball = 1.5 - ROBOT.probe_tip[0]
        np.testing.assert_allclose(command.turn, [np.pi / 2, 0], atol=1e-6)
        np.testing.assert_allclose(command.forward, [to_ball, RD / 2], rtol=1e-5)

    def test_robots_that_wait_stand_and_their_vectors_stay(self):
        """The vectors of the other robot change as it turns away from the wall and walks."""
        policy = strategy(walls=1, speed=1)
        place = known_place([[9, 9], [9, 9]])
        memory = policy.init(2, jax.random.key(0))._replace(dust=place, dump=place)
        observation = sees(
            2,
            sees_wall=np.array([WALL_LEFT, WALL_LEFT]),
            waits=np.array([True, False]),
        )
        after, command = does(policy, observation, memory)
        np.testing.assert_allclose(command.turn, [0, np.pi / 2], atol=1e-6)
        np.testing.assert_allclose(command.forward, [0, RD / 2], atol=1e-6)
        moved = [[9, 9], [9 - RD / 2, -9]]
        np.testing.assert_allclose(after.dust.vector, moved, rtol=1e-5)
        np.testing.assert_allclose(after.dump.vector, moved, rtol=1e-5)

    @pytest.mark.parametrize("output", [0.5, 0.0, -0.5])
    def test_the_flag_is_sent_in_the_next_step(self, output):
        memory, _ = does(strategy(flag=output), sees(2))
        message = strategy().say(memory, np.zeros(2, bool))
        assert (np.asarray(message["priority"]) == (output > 0)).all()


class TestUntrained:
    """Robots with the weights from which training starts."""

    POLICY = untrained(CONFIG, ROBOT)
    IS_LOADED = np.arange(N_ROBOTS) < N_ROBOTS // 2

    def memory(self, **places):
        """Return memories of robots that know these places."""
        return self.POLICY.init(N_ROBOTS, jax.random.key(0))._replace(**places)

    def test_they_turn_away_from_walls(self):
        _, command = does(self.POLICY, sees(N_ROBOTS, sees_wall=np.tile(WALL_AHEAD, (N_ROBOTS, 1))))
        assert (abs(command.turn) > np.pi / 4).all()

    def test_they_walk_nearly_straight_on_otherwise(self):
        _, command = does(self.POLICY, sees(N_ROBOTS))
        assert (abs(command.turn) <= np.pi / 6 + 1e-6).all()
        assert (command.forward > 0).all()

    def test_they_go_where_they_need_and_flag_that_they_are_loaded(self):
        """Dust is left, the dump right; the random direction leads a little astray."""
        left = np.tile([0.0, 9.0], (N_ROBOTS, 1))
        memory = self.memory(dust=known_place(left), dump=known_place(-left))
        after, command = does(self.POLICY, sees(N_ROBOTS, is_loaded=self.IS_LOADED), memory)
        np.testing.assert_array_equal(command.turn < 0, self.IS_LOADED)
        np.testing.assert_array_equal(after.flag, self.IS_LOADED)

        # Empty robots also like to go ahead, which with dust to the left makes 45 degrees.
        turn = np.asarray(command.turn)
        astray_if_empty = np.arcsin(0.5 / 2**0.5)
        astray_if_loaded = np.arcsin(0.2 / 3)
        assert (abs(turn[~self.IS_LOADED] - np.pi / 4) <= astray_if_empty + 1e-5).all()
        assert (turn[self.IS_LOADED] <= astray_if_loaded - np.pi / 2 + 1e-5).all()

    def test_they_go_round_others_but_not_when_loaded_with_the_dump_ahead(self):
        """A neighbour is close ahead; loaded robots mind it less."""
        memory = self.memory(dump=known_place(np.tile([9.0, 0.0], (N_ROBOTS, 1))))
        observation = sees(
            N_ROBOTS,
            is_loaded=self.IS_LOADED,
            is_heard=np.tile(np.arange(4) == 0, (N_ROBOTS, 1)),
            distance=np.full((N_ROBOTS, 4), 0.35 * RD, np.float32),
        )
        _, command = does(self.POLICY, observation, memory)
        goes_straight_on = abs(command.turn) < np.arcsin(0.2 / 2.2) + 1e-5
        np.testing.assert_array_equal(goes_straight_on, self.IS_LOADED)


def test_messages_of_robots_of_eight_sides_have_room(tmp_path):
    robot = read_robot(robot_file(tmp_path, "eight"))
    of_paper = VectorStrategy(rules_of(TYPE1), 0, CONFIG.static, robot)
    for policy in (untrained(CONFIG, robot), of_paper):
        payload = payload_of(policy)
        assert payload == payload_for(mm_from_rd(CONFIG.strategy.message_range), 8)
        payload.check_room(8)


def test_robots_of_eight_sides_hear_and_see_in_their_directions(tmp_path):
    """The sender ahead shows LED 1, at 45 degrees, hence looks along 135 degrees.

    The wall is at 45 degrees.
    """
    policy = untrained(CONFIG, read_robot(robot_file(tmp_path, "eight")))
    is_front = np.arange(8)[None] == 0
    observation = senses_nothing(1, sides=8)
    observation = observation._replace(
        is_heard=is_front,
        sees_wall=np.roll(is_front, 1),
        led=np.full((1, 8), 1),
        payload=observation.payload | {"dust": remember(np.full((1, 8, 2), [10.0, 0.0]))},
    )
    memory = policy.update_beliefs(policy.init(1, jax.random.key(0)), observation)
    np.testing.assert_allclose(memory.dust.vector, [[5 - 50**0.5, 50**0.5]], rtol=1e-5)

    perception = policy.perceive(memory, observation, jax.random.key(0))
    to_wall = perception.directions[0, DIRECTIONS.index("walls")]
    np.testing.assert_allclose(to_wall, [0.5**0.5, 0.5**0.5], rtol=1e-5)


def test_the_shipped_weights_are_small_and_trained():
    assert SHIPPED.stat().st_size < 2**20
    shipped = Neural().for_world(CONFIG, ROBOT, 3).weights
    np.testing.assert_array_equal(shipped, load_weights(SHIPPED))
    share_changed = (np.asarray(shipped) != np.asarray(untrained(CONFIG, ROBOT).weights)).mean()
    assert share_changed > 0.9


def test_training_starts_untrained_or_with_the_weights_of_a_file():
    by_default = Neural().for_training(CONFIG, ROBOT, 3).weights
    np.testing.assert_array_equal(by_default, untrained(CONFIG, ROBOT).weights)
    of_file = Neural(SHIPPED).for_training(CONFIG, ROBOT, 3).weights
    np.testing.assert_array_equal(of_file, load_weights(SHIPPED))


@pytest.mark.parametrize(
    "engine",
    [
        PlanarSettings(1),
        pytest.param(PlanarSettings(impl="warp", chunk=5), marks=pytest.mark.slow),
        pytest.param(MjxSettings(chunk=5), marks=pytest.mark.slow),
    ],
    ids=lambda engine: f"{type(engine).__name__}-{getattr(engine, 'impl', '')}",
)
def test_runs_on_every_engine(engine):
    run = Run(Scenario(CONFIG, strategy=Neural(), robots=6, engine=engine, steps=10))
    while not run.is_over:
        last = run.advance()
    run.raise_faults()
    assert np.abs(np.diff(last.poses[-1, 0, :, :2], axis=0)).max() > 0
    assert [name for name, _ in run.payload.fields] == ["priority", "dust", "dump"]
