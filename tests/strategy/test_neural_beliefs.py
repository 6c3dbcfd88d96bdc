"""What robots of the learned strategy read, and how they believe what they hear."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy import stats
from support.neural import CONFIG, ROBOT, does, sees, strategy

from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.beliefs import MAX_DOUBT, Belief, Trust, confirm_beliefs, merge_beliefs
from iswarm_mj.strategy.neural import DIRECTIONS, INPUTS, SHAPE, Memory, untrained
from iswarm_mj.utils.units import RD

perceived_here = jax.jit(untrained(CONFIG, ROBOT).perceive)
merged_here, confirmed_here = jax.jit(merge_beliefs, static_argnums=6), jax.jit(confirm_beliefs, static_argnums=3)


class TestReads:
    """Three robots: numbers and ways that differ from each other, by hand."""

    REACH = 3.5 * RD
    MEMORY = Memory(
        dust=Belief(np.array([[3.0, 4.0], [0, 0], [0.1, 0]]), np.array([2.9, 0, 7.25]), np.array([True, False, True])),
        dump=Belief(np.array([[0.0, -9.0], [6, 8], [0, 0]]), np.array([14.5, 1.45, 0]), np.array([True, True, False])),
        flag=np.array([True, False, False]),
        character=np.array([-0.5, 0.25, 0.75]),
    )
    SEEN = sees(
        3,
        is_heard=np.array([[False, True, True, False], [True, False, False, False], 4 * [False]]),
        distance=REACH * np.array([[0.1, 0.2, 0.5, 0.1], [0.8, 0.1, 0.1, 0.1], 4 * [0.1]]),
        sees_wall=np.array([4 * [False], [False, True, False, False], 4 * [False]]),
        at_dust=np.array([True, False, False]),
        on_dump=np.array([False, True, False]),
        is_loaded=np.array([False, False, True]),
        grasp_failed=np.array([True, False, True]),
    )
    SEEN = SEEN._replace(payload=SEEN.payload | {"priority": np.arange(12).reshape(3, 4) // 2 == 1})

    def read(self):
        numbers, ways = perceived_here(self.MEMORY, self.SEEN, jax.random.key(1))
        return dict(zip(INPUTS, numbers.T, strict=True)), dict(zip(DIRECTIONS, np.moveaxis(ways, 1, 0), strict=True))

    def test_numbers(self):
        expected = {
            "near": [0.8, 0.2, 0],
            "near_ahead": [0, 0.2, 0],
            "flagged_near": [0.5, 0, 0],
            "wall": [0, 1, 0],
            "at_dust": [1, 0, 0],
            "on_dump": [0, 1, 0],
            "is_loaded": [0, 0, 1],
            "grasp_failed": [1, 0, 1],
            "dust_is_known": [1, 0, 1],
            "dust_is_near": [1 / (1 + 5 / self.REACH), 0, 1 / (1 + 0.1 / self.REACH)],
            "dust_is_doubted": [0.2, 0, 0.5],
            "dump_is_known": [1, 1, 0],
            "dump_is_near": [1 / (1 + 9 / self.REACH), 1 / (1 + 10 / self.REACH), 0],
            "dump_is_doubted": [1, 0.1, 0],
            "character": [-0.5, 0.25, 0.75],
            "says": [1, 0, 0],
        }
        found, _ = self.read()
        assert list(found) == list(expected)
        for name, values in expected.items():
            np.testing.assert_allclose(found[name], values, atol=1e-6, err_msg=name)

    def test_ways(self):
        """Vectors shorter than a step count by their length; what is not known and what is not heard count nothing."""
        expected = {
            "ahead": [[1, 0], [1, 0], [1, 0]],
            "neighbours": [[-0.5, 0.8], [0.2, 0], [0, 0]],
            "close": [[0, 0.6], [0, 0], [0, 0]],
            "right_of_close": [[0.6, 0], [0, 0], [0, 0]],
            "flagged": [[-0.5, 0], [0, 0], [0, 0]],
            "walls": [[0, 0], [0, 1], [0, 0]],
            "dust": [[0.6, 0.8], [0, 0], [0.1 / (RD / 2), 0]],
            "dump": [[0, -1], [0.6, 0.8], [0, 0]],
            "right_of_dump": [[-1, 0], [0.8, -0.6], [0, 0]],
        }
        _, found = self.read()
        assert set(found) == {*expected, "random"}
        for name, vectors in expected.items():
            np.testing.assert_allclose(found[name], vectors, atol=1e-6, err_msg=name)

    def test_random_ways_and_characters_are_spread_evenly(self):
        policy, n = untrained(CONFIG, ROBOT), 4000
        memory = policy.init(n, jax.random.key(0))
        ways = perceived_here(memory, sees(n), jax.random.key(1))[1][:, DIRECTIONS.index("random")]
        angles = np.arctan2(ways[:, 1], ways[:, 0])
        np.testing.assert_allclose(np.hypot(*ways.T), 1, rtol=1e-5)
        assert stats.kstest(angles, "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-3
        assert stats.kstest(memory.character, "uniform", (-1, 2)).pvalue > 1e-3


class TestBeliefs:
    @pytest.mark.parametrize("place", ["dust", "dump"])
    def test_only_what_was_heard_is_believed(self, place):
        here = VectorMemory(np.ones((2, 4, 2)), np.ones((2, 4), np.int32), np.ones((2, 4), bool))
        seen = sees(2, is_heard=np.arange(8).reshape(2, 4) == 7)
        memory, _ = does(strategy(), seen._replace(payload=seen.payload | {place: here}))
        other = {"dust": "dump", "dump": "dust"}[place]
        assert getattr(memory, place).known.tolist() == [False, True] and not getattr(memory, other).known.any()

    def test_vectors_to_dust_and_dump_are_trusted_by_their_own_numbers(self):
        policy = strategy()
        weights = np.concatenate([policy.weights[: SHAPE.n_weights], np.float32([0.0, 0, -2, 0, 0, 0.5])])
        far = Belief(np.full((1, 2), 9.0), np.ones(1), np.ones(1, bool))
        memory = policy.init(1, jax.random.key(0))._replace(dust=far, dump=far)
        memory, _ = does(replace(policy, weights=weights), sees(), memory)
        np.testing.assert_allclose([memory.dust.doubt[0], memory.dump.doubt[0]], 1 + np.exp([-2, 0.5]), rtol=1e-6)

    def test_what_is_told_is_rounded(self):
        doubt = np.array([0.4, 2.6, MAX_DOUBT, 3.0])
        told = Belief(np.ones((4, 2)), doubt, np.array([True, True, True, False])).as_message()
        assert told.hop.tolist() == [0, 3, 14, 3] and told.known.tolist() == [True, True, True, False]
        sent = dict(untrained(CONFIG, ROBOT).payload.fields)["dust"]
        assert float(np.round(MAX_DOUBT)) == sent.max_hop < float(np.round(MAX_DOUBT + 0.01))

    def test_confirmed_and_refuted(self):
        """At the place; within half a step of where it was to be; beyond; where nothing is known."""
        own = Belief(np.array([[5.0, 0], [0, 0.4], [0, -0.6], [0, 0]]), np.array([2.3, 2.3, 2.3, 0]), np.arange(4) < 3)
        found = confirmed_here(own, np.arange(4) == 0, np.tile(np.array([[1.0, 2.0]]), (4, 1)), 1.0)
        np.testing.assert_allclose(found.vector, [[1, 2], [0, 0], [0, -0.6], [0, 0]])
        np.testing.assert_allclose(found.doubt, [0, 0, 2.3, 0])
        assert found.known.tolist() == [True, False, True, False]

    def test_the_sharper_the_less_the_doubted_count(self):
        """Of heard doubts 10 and 12; in the end none, however much all are doubted."""
        sent = VectorMemory(
            np.array([[[8.0, 0], [0, 0], [0, 0], [0, 0]]]),
            np.array([[9, 11, 0, 0]]),
            np.array([[True, True, False, False]]),
        )
        zero, led = np.zeros((1, 4)), np.full((1, 4), 2)
        for sharpness in (-1.0, 0.5, 5.0):
            trust, own = Trust(sharpness, 0.0, 0.0), Belief.empty(1)
            found = merged_here(trust, own, sent, zero, zero, led, ROBOT.sides)
            share = 1 / (1 + np.exp(-2 * np.exp(sharpness)))
            np.testing.assert_allclose(found.vector, [[8 * share, 0]], rtol=1e-5)
            np.testing.assert_allclose(found.doubt, [10 * share + 12 * (1 - share)], rtol=1e-5)

    def test_a_place_where_nothing_can_be_lifted_is_forgotten(self):
        policy = strategy()
        found = np.array([[0.0, 9.0], [0.0, 9.0]])
        memory, _ = does(policy, sees(2, at_dust=np.ones(2, bool), ball_vector=found))
        assert memory.dust.known.all()
        memory, _ = does(policy, sees(2, grasp_failed=np.array([True, False])), memory)
        np.testing.assert_array_equal(memory.dust.known, [False, True])

    def test_a_walk_that_fell_short_is_taken_back(self):
        policy = strategy(ahead=1, speed=1)
        memory, command = does(policy, sees(on_dump=np.array([True])))
        np.testing.assert_allclose(memory.dump.vector, [[-RD / 2, 0]], rtol=1e-5)
        memory = policy.correct_odometry(memory._replace(dust=memory.dump), command.forward / 2)
        np.testing.assert_allclose([memory.dust.vector, memory.dump.vector], [[[-RD / 4, 0]]] * 2, rtol=1e-5)

    def test_merged_by_hand(self):
        """An own vector of doubt 1 that ages by e^-1, and two heard ones, of which one came through two robots.

        Sharpness e^0 = 1: weights exp(-doubt), the own times e^0.5. The receiver hears with its front (bearing 0) and
        its left side (90 degrees); the senders show their front LED, so that their frames are turned by half a turn
        and by -90 degrees.
        """
        own = Belief(np.array([[10.0, 0.0]]), np.array([1.0]), np.array([True]))
        sent = VectorMemory(
            np.array([[[-4.0, 1.0], [2.0, 0.0], [9.0, 9.0], [0.0, 0.0]]]),
            np.array([[0, 1, 0, 0]]),
            np.array([[True, True, False, False]]),
        )
        bearing, distance = np.array([[0.0, np.pi / 2, np.pi, 0]]), np.array([[5.0, 3.0, 1, 1]])
        found = merged_here(
            Trust(0.0, 0.5, -1.0), own, sent, bearing, distance, np.zeros((1, 4), np.int32), ROBOT.sides
        )
        vectors = np.array([[10, 0], [5 + 4, -1], [0, 3 - 2]])
        doubts = np.array([1 + np.exp(-1), 1, 2])
        weights = np.exp(-doubts) * [np.exp(0.5), 1, 1]
        weights /= weights.sum()
        np.testing.assert_allclose(found.vector, [weights @ vectors], rtol=1e-5)
        np.testing.assert_allclose(found.doubt, [weights @ doubts], rtol=1e-5)

    def test_rumours_die_out(self):
        """Nobody confirms: robots that only hear each other doubt more from step to step, and forget in the end."""
        belief, doubts = Belief(np.full((2, 2), 30.0), np.zeros(2), np.ones(2, bool)), []
        zero, led = np.zeros((2, 4)), np.full((2, 4), 2)  # of a robot ahead that looks the same way
        while belief.known.any():
            sent = VectorMemory(*(np.repeat(np.flip(part, 0)[:, None], 4, axis=1) for part in belief.as_message()))
            belief = merged_here(Trust(0.0, 0.0, 0.0), belief, sent, zero, zero, led, ROBOT.sides)
            doubts.append(float(belief.doubt[0]))
        assert 5 < len(doubts) < 40 and (np.diff(doubts[:-1]) > 0).all() and MAX_DOUBT - 2 < doubts[-2] <= MAX_DOUBT
        assert not belief.vector.any() and not belief.doubt.any()
