"""One exchange of messages: what arrives, how often, and how exactly the distance is measured."""

import dataclasses

import jax
import numpy as np
import pytest
from support.sensing import remember

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.sensors.channel import exchange
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.sensors.fields import Integer
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.messages import Message, Payload
from iswarm_mj.strategy.vector_strategy import payload_for

MAX_RANGE = 138.6
PAYLOAD = payload_for(MAX_RANGE)
CLEAN = OpticsConfig(error_distance_measure=0.0, error_in_communication=0.0, p_communication_break=0.0)
exchange_here, pack_here, unpack_here = (
    jax.jit(exchange, static_argnums=1),
    jax.jit(PAYLOAD.pack),
    jax.jit(PAYLOAD.unpack),
)
N = 25_000  # robots, so 1e5 messages


def clean_but(**errors):
    return OpticsConfig(
        **{"error_distance_measure": 0.0, "error_in_communication": 0.0, "p_communication_break": 0.0} | errors
    )


def contents(n, seed=0):
    """What n robots say."""
    rng = np.random.default_rng(seed)

    def memory():
        return remember(rng.uniform(-90, 90, (n, 2)), rng.integers(0, 17, n), rng.random(n) < 0.8)

    return {"priority": rng.random(n) < 0.5, "dust": memory(), "dump": memory()}


def wires(n, seed=0):
    """Random sender, LED, validity and distance for each side of n robots."""
    rng = np.random.default_rng([seed, 1])
    shape = (n, 4)
    return rng.integers(0, n, shape), rng.integers(0, 4, shape), rng.random(shape) < 0.7, rng.uniform(2, 9.9, shape)


def send(optics, content, wiring, seed=0):
    sender, led, valid, distance = wiring
    links = Links(sender, valid, led, measured_bearing=np.zeros_like(distance), true_distance=np.float32(distance))
    noise = conditions_of(SwarmConfig(optics=optics))
    return exchange_here(noise, PAYLOAD, content, links, jax.random.key(seed))


def test_without_noise_everything_arrives_as_packed():
    content, (sender, led, valid, distance) = contents(50), wires(50)
    message, arrived, measured, bits = send(CLEAN, content, (sender, led, valid, distance))
    np.testing.assert_array_equal(arrived, valid)
    np.testing.assert_allclose(measured, distance, rtol=1e-6)
    spoken = Message(led, jax.tree.map(lambda a: a[sender], content))
    expected, _ = unpack_here(pack_here(spoken))
    jax.tree.map(np.testing.assert_array_equal, message, expected)
    np.testing.assert_array_equal(bits[sender, led], pack_here(spoken))
    np.testing.assert_array_equal(message.led, led)
    np.testing.assert_array_equal(message.payload["priority"], content["priority"][sender])


def lost(optics, seed=1):
    """Share of the messages that do not arrive, of 1e5."""
    everyone = (np.zeros((N, 4), int), np.zeros((N, 4), int), np.ones((N, 4), bool), np.full((N, 4), 5.0))
    _, arrived, *_ = send(optics, contents(2), everyone, seed)
    return 1 - np.asarray(arrived).mean()


def close(share, expected):
    return abs(share - expected) < 4.5 * np.sqrt(expected * (1 - expected) / (4 * N))


def test_one_link_in_ten_breaks():
    assert close(lost(clean_but(p_communication_break=0.1)), 0.1)
    assert lost(clean_but(p_communication_break=1.0)) == 1
    assert lost(CLEAN) == 0


def test_one_message_in_ten_is_damaged_and_found_out():
    assert close(lost(clean_but(error_in_communication=0.1)), 0.1)


def test_breaks_depend_neither_on_the_number_of_wrong_bits_nor_on_their_places():
    """Of 1e5 messages whose checks nobody looks at, most with two wrong bits, as many break of each kind."""
    noise = clean_but(p_communication_break=0.2, error_in_communication=0.9, independent_bit_errors=True)
    conditions = conditions_of(SwarmConfig(optics=dataclasses.replace(noise, parity_check=False)))
    zeros, shape = np.zeros((N, 4), np.int32), (N, 4)
    links = Links(zeros, np.ones(shape, bool), zeros, *np.full((2, *shape), 5.0, np.float32))
    payload = Payload({"word": Integer(29)})
    got = exchange_here(conditions, payload, {"word": np.zeros(N, np.int32)}, links, jax.random.key(5))
    wrong = (np.asarray(got.message.payload["word"]) << 2 | np.asarray(got.message.led)).ravel()
    arrives, count = np.asarray(got.is_heard).ravel(), np.bitwise_count(wrong)
    lowest = np.log2(np.where(wrong, wrong & -wrong, 1)).astype(int)
    apart = np.log2(np.where(wrong, wrong, 1)).astype(int) - lowest
    near = np.minimum(apart, 32 - apart) <= 6
    assert len(np.unique(wrong[count == 2])) == 31 * 30 // 2  # without the bit of the check
    kinds = [count == 0, count == 2, (count == 1) & (lowest < 10), (count == 1) & (lowest > 20)]
    kinds += [(count == 2) & near, (count == 2) & ~near]
    for kind in kinds:
        assert kind.sum() > 3000 and abs(arrives[kind].mean() - 0.8) < 4.5 * np.sqrt(0.16 / kind.sum())


@pytest.mark.parametrize("n_leds", [3, 6])
def test_messages_that_name_a_missing_led_are_not_heard(n_leds):
    """Robots number three LEDs in two bits, and six in three; receivers ignore the check."""
    noise = dataclasses.replace(clean_but(error_in_communication=0.9), parity_check=False)
    last = np.full((N, n_leds), n_leds - 1, np.int32)
    links = Links(0 * last, last > 0, last, *np.full((2, N, n_leds), 5.0, np.float32))
    payload, conditions = Payload({"word": Integer(4)}), conditions_of(SwarmConfig(optics=noise))
    got = exchange_here(conditions, payload, {"word": np.zeros(N, np.int32)}, links, jax.random.key(6))
    named = np.asarray(got.message.led)
    assert (named >= n_leds).any() and (named == n_leds - 1).any()
    np.testing.assert_array_equal(got.is_heard, named < n_leds)


def test_distances_are_measured_to_ten_percent():
    wiring = (np.zeros((N, 4), int), np.zeros((N, 4), int), np.ones((N, 4), bool), np.linspace(2, 9.9, 4 * N))
    sender, led, valid, distance = (a.reshape(N, 4) for a in wiring)
    _, _, measured, *_ = send(clean_but(error_distance_measure=0.1), contents(2), (sender, led, valid, distance))
    relative = np.asarray(measured) / distance - 1
    assert abs(relative.mean()) < 4.5 * 0.1 / np.sqrt(4 * N)
    for part in (relative[: N // 2], relative[N // 2 :]):  # near and far
        assert abs(part.std() - 0.1) < 4.5 * 0.1 / np.sqrt(4 * N)
    assert abs(np.corrcoef(relative.T) - np.eye(4)).max() < 0.03


def test_no_distance_is_negative():
    wiring = (np.zeros((50, 4), int), np.zeros((50, 4), int), np.ones((50, 4), bool), np.full((50, 4), 5.0))
    assert np.asarray(send(clean_but(error_distance_measure=1.0), contents(2), wiring)[2]).min() == 0
