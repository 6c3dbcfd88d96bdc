"""Perception and beliefs of robots of the learned strategy."""

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

perceive_jit = jax.jit(untrained(CONFIG, ROBOT).perceive)
merge_jit = jax.jit(merge_beliefs, static_argnums=6)
confirm_jit = jax.jit(confirm_beliefs, static_argnums=3)
NOT_HEARD = [False, False, False, False]


class TestPerception:
    """Numbers and directions by hand, for three robots that differ in all of them."""

    REACH = 3.5 * RD
    """Range of light [mm]."""
    MEMORY = Memory(
        dust=Belief(
            vector=np.array([[3.0, 4.0], [0, 0], [0.1, 0]]),
            doubt=np.array([2.9, 0, 7.25]),
            known=np.array([True, False, True]),
        ),
        dump=Belief(
            vector=np.array([[0.0, -9.0], [6, 8], [0, 0]]),
            doubt=np.array([14.5, 1.45, 0]),
            known=np.array([True, True, False]),
        ),
        flag=np.array([True, False, False]),
        character=np.array([-0.5, 0.25, 0.75]),
    )
    DISTANCE_IN_REACH = np.array(
        [
            [0.1, 0.2, 0.5, 0.1],
            [0.8, 0.1, 0.1, 0.1],
            [0.1, 0.1, 0.1, 0.1],
        ],
    )
    OBSERVATION = sees(
        3,
        is_heard=np.array([[False, True, True, False], [True, False, False, False], NOT_HEARD]),
        distance=REACH * DISTANCE_IN_REACH,
        sees_wall=np.array([4 * [False], [False, True, False, False], 4 * [False]]),
        at_dust=np.array([True, False, False]),
        on_dump=np.array([False, True, False]),
        is_loaded=np.array([False, False, True]),
        grasp_failed=np.array([True, False, True]),
    )
    FLAGGED = np.array([[False, False, True, True], NOT_HEARD, NOT_HEARD])
    OBSERVATION = OBSERVATION._replace(payload=OBSERVATION.payload | {"priority": FLAGGED})

    def perceive(self):
        """Return numbers (N,) and directions (N, 2) by their names."""
        perception = perceive_jit(self.MEMORY, self.OBSERVATION, jax.random.key(1))
        numbers = dict(zip(INPUTS, perception.numbers.T, strict=True))
        directions = np.moveaxis(perception.directions, 1, 0)
        return numbers, dict(zip(DIRECTIONS, directions, strict=True))

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
        numbers, _ = self.perceive()
        assert list(numbers) == list(expected)
        for name, values in expected.items():
            np.testing.assert_allclose(numbers[name], values, atol=1e-6, err_msg=name)

    def test_directions(self):
        """Vectors longer than a step count as unit vectors; unknown and unheard ones as zero."""
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
        _, directions = self.perceive()
        assert set(directions) == {*expected, "random"}
        for name, vectors in expected.items():
            np.testing.assert_allclose(directions[name], vectors, atol=1e-6, err_msg=name)

    def test_random_directions_and_characters_are_spread_evenly(self):
        n_robots = 4000
        memory = untrained(CONFIG, ROBOT).init(n_robots, jax.random.key(0))
        perception = perceive_jit(memory, sees(n_robots), jax.random.key(1))
        x, y = perception.directions[:, DIRECTIONS.index("random")].T

        np.testing.assert_allclose(np.hypot(x, y), 1, rtol=1e-5)
        angles = np.arctan2(y, x)
        assert stats.kstest(angles, "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-3
        assert stats.kstest(memory.character, "uniform", (-1, 2)).pvalue > 1e-3


LOOKS_THE_SAME_WAY = np.full((2, 4), 2)
"""LED that a robot straight ahead shows if it looks the same way, for two robots."""


class TestBeliefs:
    @pytest.mark.parametrize(("place", "other_place"), [("dust", "dump"), ("dump", "dust")])
    def test_only_what_was_heard_is_believed(self, place, other_place):
        """Only the second robot hears something, on its last side."""
        sent = VectorMemory(
            vector=np.ones((2, 4, 2)),
            hop=np.ones((2, 4), np.int32),
            known=np.ones((2, 4), bool),
        )
        observation = sees(2, is_heard=np.array([NOT_HEARD, [False, False, False, True]]))
        observation = observation._replace(payload=observation.payload | {place: sent})
        memory, _ = does(strategy(), observation)
        assert getattr(memory, place).known.tolist() == [False, True]
        assert not getattr(memory, other_place).known.any()

    def test_vectors_to_dust_and_dump_are_trusted_by_their_own_numbers(self):
        policy = strategy()
        trust_in_dust = Trust(sharpness=0.0, own_advantage=0.0, ageing=-2.0)
        trust_in_dump = Trust(sharpness=0.0, own_advantage=0.0, ageing=0.5)
        trusts = np.float32([*trust_in_dust, *trust_in_dump])
        weights = np.concatenate([policy.weights[: SHAPE.n_weights], trusts])

        far = Belief(np.full((1, 2), 9.0), np.ones(1), np.ones(1, bool))
        memory = policy.init(1, jax.random.key(0))._replace(dust=far, dump=far)
        memory, _ = does(replace(policy, weights=weights), sees(), memory)
        np.testing.assert_allclose(memory.dust.doubt[0], 1 + np.exp(-2), rtol=1e-6)
        np.testing.assert_allclose(memory.dump.doubt[0], 1 + np.exp(0.5), rtol=1e-6)

    def test_messages_carry_the_rounded_doubt(self):
        belief = Belief(
            vector=np.ones((4, 2)),
            doubt=np.array([0.4, 2.6, MAX_DOUBT, 3.0]),
            known=np.array([True, True, True, False]),
        )
        message = belief.as_message()
        assert message.hop.tolist() == [0, 3, 14, 3]
        assert message.known.tolist() == [True, True, True, False]

    def test_the_largest_doubt_is_the_largest_that_a_message_carries(self):
        vector = dict(untrained(CONFIG, ROBOT).payload.fields)["dust"]
        assert float(np.round(MAX_DOUBT)) == vector.max_hop
        assert float(np.round(MAX_DOUBT + 0.01)) > vector.max_hop

    def test_places_are_confirmed_or_refuted(self):
        """Robot 0 is at the place, 1 within half a step of where it believes the place to be, 2 is
        farther away, and 3 knows nothing.
        """
        belief = Belief(
            vector=np.array([[5.0, 0], [0, 0.4], [0, -0.6], [0, 0]]),
            doubt=np.array([2.3, 2.3, 2.3, 0]),
            known=np.array([True, True, True, False]),
        )
        is_there = np.array([True, False, False, False])
        belief = confirm_jit(belief, is_there, np.tile([[1.0, 2.0]], (4, 1)), 1.0)
        np.testing.assert_allclose(belief.vector, [[1, 2], [0, 0], [0, -0.6], [0, 0]])
        np.testing.assert_allclose(belief.doubt, [0, 0, 2.3, 0])
        assert belief.known.tolist() == [True, False, True, False]

    @pytest.mark.parametrize("sharpness", [-1.0, 0.5, 5.0])
    def test_sharper_trust_gives_doubted_vectors_less_weight(self, sharpness):
        """Two vectors are heard, of doubts 10 and 12; only the difference of the doubts counts."""
        sent = VectorMemory(
            np.array([[[8.0, 0], [0, 0], [0, 0], [0, 0]]]),
            np.array([[9, 11, 0, 0]]),
            np.array([[True, True, False, False]]),
        )
        zero = np.zeros((1, 4))
        trust = Trust(sharpness, own_advantage=0.0, ageing=0.0)
        nothing = Belief.empty(1)
        belief = merge_jit(trust, nothing, sent, zero, zero, LOOKS_THE_SAME_WAY[:1], ROBOT.sides)

        share = 1 / (1 + np.exp(-2 * np.exp(sharpness)))
        np.testing.assert_allclose(belief.vector, [[8 * share, 0]], rtol=1e-5)
        np.testing.assert_allclose(belief.doubt, [10 * share + 12 * (1 - share)], rtol=1e-5)

    def test_a_place_where_nothing_can_be_lifted_is_forgotten(self):
        policy = strategy()
        ball_vector = np.array([[0.0, 9.0], [0.0, 9.0]])
        memory, _ = does(policy, sees(2, at_dust=np.ones(2, bool), ball_vector=ball_vector))
        assert memory.dust.known.all()
        memory, _ = does(policy, sees(2, grasp_failed=np.array([True, False])), memory)
        np.testing.assert_array_equal(memory.dust.known, [False, True])

    def test_vectors_are_corrected_after_a_walk_that_fell_short(self):
        policy = strategy(ahead=1, speed=1)
        memory, command = does(policy, sees(on_dump=np.array([True])))
        np.testing.assert_allclose(memory.dump.vector, [[-RD / 2, 0]], rtol=1e-5)
        memory = policy.correct_odometry(memory._replace(dust=memory.dump), command.forward / 2)
        np.testing.assert_allclose(memory.dust.vector, [[-RD / 4, 0]], rtol=1e-5)
        np.testing.assert_allclose(memory.dump.vector, [[-RD / 4, 0]], rtol=1e-5)

    def test_merged_by_hand(self):
        """The robot's own vector has a doubt of 1 and ages by e^-1; it hears two more.

        One of these came through two robots. With a sharpness of e^0 = 1 weights are exp(-doubt),
        and that of the own vector is e^0.5 times as large. The receiver hears with its front
        (bearing 0) and its left side (90 degrees). The senders show their front LED, so that their
        frames are turned by half a turn and by -90 degrees.
        """
        own_belief = Belief(np.array([[10.0, 0.0]]), np.array([1.0]), np.array([True]))
        sent = VectorMemory(
            np.array([[[-4.0, 1.0], [2.0, 0.0], [9.0, 9.0], [0.0, 0.0]]]),
            np.array([[0, 1, 0, 0]]),
            np.array([[True, True, False, False]]),
        )
        bearing = np.array([[0.0, np.pi / 2, np.pi, 0]])
        distance = np.array([[5.0, 3.0, 1, 1]])
        front_led = np.zeros((1, 4), np.int32)
        trust = Trust(sharpness=0.0, own_advantage=0.5, ageing=-1.0)
        belief = merge_jit(trust, own_belief, sent, bearing, distance, front_led, ROBOT.sides)

        vectors = np.array([[10, 0], [5 + 4, -1], [0, 3 - 2]])
        doubts = np.array([1 + np.exp(-1), 1, 2])
        weights = np.exp(-doubts) * [np.exp(0.5), 1, 1]
        weights /= weights.sum()
        np.testing.assert_allclose(belief.vector, [weights @ vectors], rtol=1e-5)
        np.testing.assert_allclose(belief.doubt, [weights @ doubts], rtol=1e-5)

    def test_rumours_die_out(self):
        """Two robots that only hear each other doubt more in each step, and forget in the end."""
        trust = Trust(sharpness=0.0, own_advantage=0.0, ageing=0.0)
        zero = np.zeros((2, 4))
        belief = Belief(np.full((2, 2), 30.0), np.zeros(2), np.ones(2, bool))
        doubts = []
        while belief.known.any():
            of_other_robot = [np.flip(part, 0)[:, None] for part in belief.as_message()]
            sent = VectorMemory(*(np.repeat(part, 4, axis=1) for part in of_other_robot))
            belief = merge_jit(trust, belief, sent, zero, zero, LOOKS_THE_SAME_WAY, ROBOT.sides)
            doubts.append(float(belief.doubt[0]))

        assert 5 < len(doubts) < 40
        assert (np.diff(doubts[:-1]) > 0).all()
        last_doubt = doubts[-2]  # that of forgotten vectors is 0
        assert MAX_DOUBT - 2 < last_doubt <= MAX_DOUBT
        assert not belief.vector.any()
        assert not belief.doubt.any()
