"""Declarations of messages: fields one after the other in 32 bits, and refused declarations."""

import jax
import numpy as np
import pytest

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.sensors.channel import exchange
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.sensors.fields import Bearing, Flag, Integer, Real, Vector
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.messages import Message, Payload
from iswarm_mj.utils.errors import UserError

HEAT = Payload({"count": Integer(bits=4), "heat": Real(0, 1, bits=8)})

exchange_here = jax.jit(exchange, static_argnums=1)


def test_fields_stand_one_after_the_other():
    """Parity, zeros, heat, count, LED; worked by hand for four LEDs and for five."""
    heat = f"{51:08b}"  # 0.2 of 255
    content = {"count": np.int32(9), "heat": np.float32(0.2)}
    bits = HEAT.pack(Message(np.int32(2), content))
    assert f"{int(bits):032b}" == "1" + 17 * "0" + heat + "1001" + "10"

    content = {"count": np.int32(8), "heat": np.float32(0.2)}
    bits = HEAT.pack(Message(np.int32(4), content), 5)
    assert f"{int(bits):032b}" == "0" + 16 * "0" + heat + "1000" + "100"


def test_another_check_stands_in_the_highest_bits():
    payload = Payload(HEAT.fields, check="crc-16/xmodem")
    content = {"count": np.int32(0), "heat": np.float32(0)}
    bits = int(payload.pack(Message(np.int32(1), content)))
    assert bits & 0xFFFF == 1
    assert bits >> 16 == 0x1021  # the polynomial is the remainder of x^16


def test_without_fields_messages_carry_the_led():
    empty = Payload()
    message, is_right = empty.unpack(empty.pack(Message(np.arange(4), {})))
    np.testing.assert_array_equal(message.led, range(4))
    assert message.payload == {}
    assert is_right.all()


def receive(payload, content, n_leds=4, error=0.0):
    """Return the messages that two robots receive, which hear each other by all sides."""
    optics = OpticsConfig(error_in_communication=error, p_communication_break=0.0)
    shape = (2, n_leds)
    distance = np.full(shape, 5.0, np.float32)
    links = Links(
        sender=np.broadcast_to([[1], [0]], shape),
        valid=np.ones(shape, bool),
        led=np.broadcast_to(np.arange(n_leds), shape),
        measured_bearing=distance,
        true_distance=distance,
    )

    conditions = conditions_of(SwarmConfig(optics=optics))
    return exchange_here(conditions, payload, content, links, jax.random.key(0))


@pytest.mark.parametrize("n_leds", [2, 4, 6])
def test_robots_without_payload_are_heard(n_leds):
    received = receive(Payload(), {}, n_leds)
    assert received.is_heard.all()
    assert received.bits.shape == (2, n_leds)
    np.testing.assert_array_equal(received.message.led, [range(n_leds)] * 2)


@pytest.mark.parametrize("check", ["parity", "crc-8/smbus"])
def test_every_damaged_message_is_found_out(check):
    payload = Payload(HEAT.fields, check)
    content = {"count": np.array([3, 40]), "heat": np.float32([0.5, -1.0])}
    assert np.mean(receive(payload, content, error=0.9).is_heard) < 0.6
    assert receive(payload, content).is_heard.all()


def test_declarations_survive_json():
    fields = {
        "flag": Flag(),
        "i": Integer(3, low=-5),
        "v": Vector(30.0, 3, 3, 2),
        "b": Bearing(3),
        "r": Real(-1, 1, 4, unit="mm"),
    }
    payload = Payload(fields, check="crc-3/gsm")
    assert Payload.from_json(payload.to_json()) == payload


@pytest.mark.parametrize(
    "fields, check, message",
    [
        (
            {"a": Integer(20), "b": Real(0, 1, bits=12)},
            "parity",
            r"32 bits \(a 20, b 12\) with 2 for the LED's number and 1 for the check \(parity\) "
            r"is longer than a message of 32 bits; leave out or shorten fields by 3 bits",
        ),
        (
            {"led": Flag()},
            "parity",
            "cannot be called 'led'; give it a name as of a variable, but not led or message",
        ),
        ({3: Flag()}, "parity", "cannot be called 3"),
        ({"priority": Integer(3)}, "parity", "make it a Flag, or give it another name"),
        ([("a", Flag()), ("a", Integer(3))], "parity", "share the name 'a'; rename one"),
        ({"a": Vector(9.0), "a_y": Flag()}, "parity", "share the name 'a_y'"),
        (
            {"a": 4},
            "parity",
            "field 'a' of a payload is 4; make it one of Flag, Integer, Real, Bearing, Vector",
        ),
        (Flag(), "parity", "a payload is a dictionary of names and fields"),
        ({"a": Flag()}, "crc-32", r"must be one of parity, crc-3/gsm, .* \(got 'crc-32'\)"),
    ],
)
def test_refused_declarations(fields, check, message):
    with pytest.raises(UserError, match=message):
        Payload(fields, check)


def test_another_bit_for_the_leds_may_be_one_too_many():
    payload = Payload({"a": Integer(29)})
    with pytest.raises(UserError, match=r"29 bits .* with 3 for the LED's number .* by 1 bits"):
        payload.check_room(5)
