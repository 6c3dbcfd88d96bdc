"""One exchange of messages: which arrive, how often, and how exactly distances are measured."""

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

PAYLOAD = payload_for(138.6)
"""Messages of the paper's strategy, with vectors up to 138.6 mm."""

N_ROBOTS = 25_000
N_LEDS = 4
N_MESSAGES = N_ROBOTS * N_LEDS
SIGMAS = 4.5
"""Standard deviations by which a share may differ from its expectation."""

exchange_here = jax.jit(exchange, static_argnums=1)
pack_here = jax.jit(PAYLOAD.pack)
unpack_here = jax.jit(PAYLOAD.unpack)


def clean_but(**errors):
    """Return optics without noise, but for these errors."""
    no_noise = {
        "error_distance_measure": 0.0,
        "error_in_communication": 0.0,
        "p_communication_break": 0.0,
    }
    return OpticsConfig(**no_noise | errors)


CLEAN = clean_but()


def random_content(n_robots, seed=0):
    """Return values that robots send in the paper's strategy."""
    rng = np.random.default_rng(seed)

    def memory():
        vector = rng.uniform(-90, 90, (n_robots, 2))
        hop = rng.integers(0, 17, n_robots)
        return remember(vector, hop, rng.random(n_robots) < 0.8)

    return {"priority": rng.random(n_robots) < 0.5, "dust": memory(), "dump": memory()}


def random_links(n_robots, seed=0):
    """Return links of each side to a random LED, of which seven in ten are valid."""
    rng = np.random.default_rng([seed, 1])
    shape = (n_robots, N_LEDS)
    sender = rng.integers(0, n_robots, shape)
    led = rng.integers(0, N_LEDS, shape)
    valid = rng.random(shape) < 0.7
    return links_to(sender, led, valid, distance=rng.uniform(2, 9.9, shape))


def links_to(sender, led, valid, distance):
    """Return links without a bearing."""
    bearing = np.zeros_like(distance)
    return Links(sender, valid, led, bearing, np.float32(distance))


def links_to_first_robot(distance):
    """Return the valid links of all sides (N, 4) to the first LED of the first robot."""
    zeros = np.zeros(np.shape(distance), int)
    return links_to(zeros, zeros, np.ones(np.shape(distance), bool), distance)


def send(optics, content, links, seed=0):
    """Return the result of an exchange of the paper's messages."""
    conditions = conditions_of(SwarmConfig(optics=optics))
    return exchange_here(conditions, PAYLOAD, content, links, jax.random.key(seed))


def test_without_noise_everything_arrives_as_packed():
    content = random_content(50)
    links = random_links(50)
    received = send(CLEAN, content, links)
    np.testing.assert_array_equal(received.is_heard, links.valid)
    np.testing.assert_allclose(received.distance, links.true_distance, rtol=1e-6)

    sent = Message(links.led, jax.tree.map(lambda values: values[links.sender], content))
    expected, _ = unpack_here(pack_here(sent))
    jax.tree.map(np.testing.assert_array_equal, received.message, expected)
    np.testing.assert_array_equal(received.bits[links.sender, links.led], pack_here(sent))

    message = received.message
    np.testing.assert_array_equal(message.led, links.led)
    np.testing.assert_array_equal(message.payload["priority"], content["priority"][links.sender])


def share_lost(optics, seed=1):
    """Return the share of 1e5 messages that do not arrive."""
    links = links_to_first_robot(np.full((N_ROBOTS, N_LEDS), 5.0))
    received = send(optics, random_content(2), links, seed)
    return 1 - np.asarray(received.is_heard).mean()


def is_close(share, expected):
    """Return whether a share of all messages is within the noise of its expectation."""
    deviation = np.sqrt(expected * (1 - expected) / N_MESSAGES)
    return abs(share - expected) < SIGMAS * deviation


def test_one_link_in_ten_breaks():
    assert is_close(share_lost(clean_but(p_communication_break=0.1)), 0.1)
    assert share_lost(clean_but(p_communication_break=1.0)) == 1
    assert share_lost(CLEAN) == 0


def test_one_message_in_ten_is_damaged_and_found_out():
    assert is_close(share_lost(clean_but(error_in_communication=0.1)), 0.1)


def test_breaks_depend_neither_on_the_number_of_wrong_bits_nor_on_their_places():
    """Most of 1e5 messages have two wrong bits, and nobody looks at the check."""
    optics = clean_but(
        p_communication_break=0.2,
        error_in_communication=0.9,
        independent_bit_errors=True,
        parity_check=False,
    )
    links = links_to_first_robot(np.full((N_ROBOTS, N_LEDS), 5.0))
    received = exchange_here(
        conditions_of(SwarmConfig(optics=optics)),
        Payload({"word": Integer(29)}),
        {"word": np.zeros(N_ROBOTS, np.int32)},
        links,
        jax.random.key(5),
    )

    # Everything that is sent is 0, so that wrong bits are 1. The bit of the check is not seen.
    word = np.asarray(received.message.payload["word"])
    wrong = (word << 2 | np.asarray(received.message.led)).ravel()
    n_wrong = np.bitwise_count(wrong)
    assert len(np.unique(wrong[n_wrong == 2])) == 31 * 30 // 2

    lowest = np.log2(np.where(wrong, wrong & -wrong, 1)).astype(int)
    highest = np.log2(np.where(wrong, wrong, 1)).astype(int)
    apart = highest - lowest
    are_near = np.minimum(apart, 32 - apart) <= 6
    is_heard = np.asarray(received.is_heard).ravel()
    for group in (
        n_wrong == 0,
        n_wrong == 2,
        (n_wrong == 1) & (lowest < 10),
        (n_wrong == 1) & (lowest > 20),
        (n_wrong == 2) & are_near,
        (n_wrong == 2) & ~are_near,
    ):
        assert group.sum() > 3000
        assert abs(is_heard[group].mean() - 0.8) < SIGMAS * np.sqrt(0.8 * 0.2 / group.sum())


@pytest.mark.parametrize("n_leds", [3, 6])
def test_messages_that_name_a_missing_led_are_not_heard(n_leds):
    """Robots number three LEDs in two bits, and six in three; receivers ignore the check."""
    optics = dataclasses.replace(clean_but(error_in_communication=0.9), parity_check=False)
    shape = (N_ROBOTS, n_leds)
    links = links_to(
        sender=np.zeros(shape, np.int32),
        led=np.full(shape, n_leds - 1, np.int32),
        valid=np.ones(shape, bool),
        distance=np.full(shape, 5.0, np.float32),
    )
    received = exchange_here(
        conditions_of(SwarmConfig(optics=optics)),
        Payload({"word": Integer(4)}),
        {"word": np.zeros(N_ROBOTS, np.int32)},
        links,
        jax.random.key(6),
    )
    led = np.asarray(received.message.led)
    assert (led >= n_leds).any()
    assert (led == n_leds - 1).any()
    np.testing.assert_array_equal(received.is_heard, led < n_leds)


def test_distances_are_measured_to_ten_percent():
    distance = np.linspace(2, 9.9, N_MESSAGES).reshape(N_ROBOTS, N_LEDS)
    optics = clean_but(error_distance_measure=0.1)
    received = send(optics, random_content(2), links_to_first_robot(distance))
    error = np.asarray(received.distance) / distance - 1

    limit = SIGMAS * 0.1 / np.sqrt(N_MESSAGES)
    near = error[: N_ROBOTS // 2]
    far = error[N_ROBOTS // 2 :]
    assert abs(error.mean()) < limit
    assert abs(near.std() - 0.1) < limit
    assert abs(far.std() - 0.1) < limit
    assert abs(np.corrcoef(error.T) - np.eye(N_LEDS)).max() < 0.03


def test_no_distance_is_negative():
    optics = clean_but(error_distance_measure=1.0)
    links = links_to_first_robot(np.full((50, N_LEDS), 5.0))
    received = send(optics, random_content(2), links)
    assert np.asarray(received.distance).min() == 0
