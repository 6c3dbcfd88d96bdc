"""The learned strategy: its network by hand, what it perceives in any frame, its file, and its runs."""

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
from iswarm_mj.strategy.beliefs import Belief
from iswarm_mj.strategy.declared import payload_of
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.strategy.network import Shape, forward, load_weights, save_weights
from iswarm_mj.strategy.neural import DIRECTIONS, N_WEIGHTS, SHIPPED, Neural, untrained
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy, payload_for
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD, mm_from_rd


class TestNetwork:
    def test_by_hand(self):
        """Two inputs, one hidden unit, two outputs: y = A x + a + c tanh(b x + b0), with the weights in that order."""
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


class TestWays:
    def test_ahead_at_full_speed_and_backwards(self):
        for speed, walked in ((9, RD / 2), (-0.5, -RD / 4)):
            _, command = does(strategy(ahead=1, speed=speed), sees())
            assert command.turn[0] == 0 and command.forward[0] == pytest.approx(walked)

    @pytest.mark.parametrize("largest", [90, 60])
    def test_what_is_behind_takes_a_turn_first(self, largest):
        """Of 120 degrees to the left; the step is the cosine of what is left of them."""
        memory = strategy().init(1, jax.random.key(1))
        place = 9 * np.float32([[np.cos(2 * np.pi / 3), np.sin(2 * np.pi / 3)]])
        memory = memory._replace(dump=Belief(place, np.zeros(1, np.float32), np.ones(1, bool)))
        config = replace(CONFIG, drive=DriveConfig(max_turn=largest))
        _, command = does(replace(strategy(dump=1, speed=1), config=config.static), sees(), memory)
        assert command.turn[0] == pytest.approx(np.radians(largest))
        assert command.forward[0] == pytest.approx(
            RD / 2 * np.cos(np.radians(120 - largest)),
            rel=1e-5,
        )

    def test_a_ball_that_can_be_had_comes_first(self):
        """The tip goes over it, whatever the network says; loaded robots leave it."""
        ball = np.float32([[0.0, 1.5]] * 2)
        seen = sees(
            2,
            at_dust=np.ones(2, bool),
            ball_vector=ball,
            is_loaded=np.array([False, True]),
        )
        _, command = does(strategy(ahead=1, speed=1), seen)
        np.testing.assert_allclose(command.turn, [np.pi / 2, 0], atol=1e-6)
        np.testing.assert_allclose(command.forward, [1.5 - ROBOT.probe_tip[0], RD / 2], rtol=1e-5)

    def test_untrained_robots_turn_away_from_walls(self):
        policy = untrained(CONFIG, ROBOT)
        wall = does(policy, sees(64, sees_wall=np.tile([True, False, False, False], (64, 1))))[1]
        assert (abs(wall.turn) > np.pi / 4).all()
        free = does(policy, sees(64))[1]
        assert (abs(free.turn) <= np.pi / 6 + 1e-6).all() and (free.forward > 0).all()

    def test_untrained_robots_go_where_they_need(self):
        """Dust to the left, the dump to the right; loaded ones tell so."""
        policy, n = untrained(CONFIG, ROBOT), 64
        left = Belief(
            np.tile(np.float32([0.0, 9.0]), (n, 1)),
            np.zeros(n, np.float32),
            np.ones(n, bool),
        )
        memory = policy.init(n, jax.random.key(0))._replace(
            dust=left,
            dump=left._replace(vector=-left.vector),
        )
        is_loaded = np.arange(n) < n // 2
        after, command = does(policy, sees(n, is_loaded=is_loaded), memory)
        np.testing.assert_array_equal(command.turn < 0, is_loaded)
        np.testing.assert_array_equal(after.flag, is_loaded)
        turn, stray = (
            np.asarray(command.turn),
            np.arcsin([0.5 / 2**0.5, 0.2 / 3]),
        )  # of the random way
        assert (abs(turn[~is_loaded] - np.pi / 4) <= stray[0] + 1e-5).all()
        assert (turn[is_loaded] <= stray[1] - np.pi / 2 + 1e-5).all()

    def test_untrained_robots_go_round_others_but_not_if_the_dump_is_ahead(self):
        """The neighbour ahead is close; loaded robots mind it less."""
        policy, n = untrained(CONFIG, ROBOT), 64
        ahead = Belief(
            np.tile(np.float32([9.0, 0.0]), (n, 1)),
            np.zeros(n, np.float32),
            np.ones(n, bool),
        )
        memory, is_loaded = (
            policy.init(n, jax.random.key(0))._replace(dump=ahead),
            np.arange(n) < n // 2,
        )
        seen = sees(n, is_loaded=is_loaded, is_heard=np.tile(np.arange(4) == 0, (n, 1)))
        command = does(
            policy,
            seen._replace(distance=np.full((n, 4), 0.35 * RD, np.float32)),
            memory,
        )[1]
        np.testing.assert_array_equal(abs(command.turn) < np.arcsin(0.2 / 2.2) + 1e-5, is_loaded)

    def test_robots_that_wait_stay_and_know_it(self):
        """Both vectors of the others change as they turn and walk."""
        policy = strategy(walls=1, speed=1)
        both = Belief(np.full((2, 2), 9.0, np.float32), np.zeros(2, np.float32), np.ones(2, bool))
        memory = policy.init(2, jax.random.key(0))._replace(dust=both, dump=both)
        wall = np.tile([False, True, False, False], (2, 1))
        after, command = does(
            policy,
            sees(2, sees_wall=wall, waits=np.array([True, False])),
            memory,
        )
        np.testing.assert_allclose(command.turn, [0, np.pi / 2], atol=1e-6)
        np.testing.assert_allclose(command.forward, [0, RD / 2], atol=1e-6)
        for place in (after.dust, after.dump):
            np.testing.assert_allclose(place.vector, [[9, 9], [9 - RD / 2, -9]], rtol=1e-5)

    def test_the_flag_is_sent_in_the_next_step(self):
        for wish in (0.5, 0.0, -0.5):
            memory, _ = does(strategy(flag=wish), sees(2))
            assert (np.asarray(strategy().say(memory, np.zeros(2, bool))["priority"]) == (wish > 0)).all()


def test_robots_of_eight_sides(tmp_path):
    """The sender ahead shows LED 1, at 45 degrees, hence looks along 135 degrees; the wall is at 45 degrees."""
    robot = read_robot(robot_file(tmp_path, "eight"))
    for own in (untrained(CONFIG, robot), VectorStrategy(rules_of(TYPE1), 0, CONFIG.static, robot)):
        assert payload_of(own) == payload_for(mm_from_rd(CONFIG.strategy.message_range), 8)
        payload_of(own).check_room(8)
    policy, first = untrained(CONFIG, robot), np.arange(8)[None] == 0
    sent = remember(np.full((1, 8, 2), [10.0, 0.0]))
    seen = senses_nothing(1, sides=8)
    seen = seen._replace(
        is_heard=first,
        sees_wall=np.roll(first, 1),
        led=np.full((1, 8), 1),
        payload=seen.payload | {"dust": sent},
    )
    known = policy.update_beliefs(policy.init(1, jax.random.key(0)), seen)
    np.testing.assert_allclose(known.dust.vector, [[5 - 50**0.5, 50**0.5]], rtol=1e-5)
    _, ways = policy.perceive(known, seen, jax.random.key(0))
    np.testing.assert_allclose(ways[0, DIRECTIONS.index("walls")], [0.5**0.5] * 2, rtol=1e-5)


def test_the_shipped_weights_are_small_and_used():
    assert SHIPPED.stat().st_size < 2**20
    shipped = Neural().for_world(CONFIG, ROBOT, 3)
    np.testing.assert_array_equal(shipped.weights, load_weights(SHIPPED))
    begins = Neural().for_training(CONFIG, ROBOT, 3)
    np.testing.assert_array_equal(begins.weights, untrained(CONFIG, ROBOT).weights)
    assert (np.asarray(shipped.weights) != np.asarray(begins.weights)).mean() > 0.9
    np.testing.assert_array_equal(
        Neural(SHIPPED).for_training(CONFIG, ROBOT, 3).weights,
        shipped.weights,
    )


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
