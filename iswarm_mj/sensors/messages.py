"""Light messages of 32 bits (Valdastri et al. 2006, Table 1: 32 bit/message) with declared fields.

The lowest bits of a message are the number of the LED that sends it: two bits (0 front, 1 left,
2 back, 3 right), or three for robots with five to eight LEDs. Then come the fields of the
strategy's `Payload`, one after the other, and in the highest bits a check. Bits between are 0. The
layout of the paper's strategy is `strategy.vector_strategy.payload_for`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.sensors.bits import bits_from, low_bits
from iswarm_mj.sensors.checks import CHECKS, WORD, add_check, passes_check
from iswarm_mj.sensors.fields import KINDS, Field, Flag, Vector
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError

MAX_LEDS = 8
"""Largest number of LEDs of a robot, since a message has at most three bits for their number."""

RESERVED = ("led", "message")
"""Names that fields cannot have, since tables and recordings use them."""

PRIORITY = "priority"
"""Name of the flag of robots that recordings draw darker."""

_EXAMPLE = '{"count": Integer(bits=4), "heat": Real(0, 1, bits=8)}'


class Message(NamedTuple):
    """Content of messages; all arrays share their leading shape."""

    led: Int[Array, "*N"]
    """Number of the LED that sends the message, int32."""
    payload: dict[str, Any]
    """Values of the fields by name."""


@dataclass(frozen=True)
class Payload:
    """Fields of a strategy's messages by name, and how receivers check them.

    `Payload({"count": Integer(bits=4), "heat": Real(0, 1, bits=8)}, check="crc-8/smbus")`; without
    fields, messages carry the number of the LED alone.
    """

    fields: Any = ()
    """Mapping from names to `sensors.fields`, or pairs of both; kept as a tuple of pairs."""
    check: str = "parity"
    """Name of the check, one of `checks.CHECKS`."""

    def __post_init__(self):
        object.__setattr__(self, "fields", _pairs_of(self.fields))
        for name, field in self.fields:
            _check_field(name, field)
        _check_distinct(self.fields)
        if self.check not in CHECKS:
            names = ", ".join(CHECKS)
            raise UserError(f"check of a payload must be one of {names} (got {self.check!r})")
        self.check_room(n_leds=4)

    @property
    def bits(self) -> int:
        """Length of all fields together [bits]."""
        return sum(field.bits for _, field in self.fields)

    def shapes(self, *shape: int) -> dict[str, Any]:
        """Return shapes and types of values."""
        return {name: field.shapes(*shape) for name, field in self.fields}

    def to_json(self) -> dict[str, Any]:
        """Return the declaration in JSON."""
        fields = []
        for name, field in self.fields:
            fields.append([name, {"kind": type(field).__name__, **asdict(field)}])
        return {"fields": fields, "check": self.check}

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> "Payload":
        """Return the declaration that `to_json` wrote."""
        fields = []
        for name, values in content["fields"]:
            attributes = dict(values)
            kind = KINDS[attributes.pop("kind")]
            fields.append((name, kind(**attributes)))
        return Payload(fields, content["check"])

    def check_room(self, n_leds: int) -> None:
        """Check that the fields have room in the messages of robots with this number of LEDs.

        Raises:
            UserError: they are too long.
        """
        n_led = _led_bits(n_leds)
        n_check = CHECKS[self.check].width
        excess = n_led + self.bits + n_check - WORD
        if excess > 0:
            fields = ", ".join(f"{name} {field.bits}" for name, field in self.fields)
            raise UserError(
                f"a payload of {self.bits} bits ({fields}) with {n_led} for the LED's number and "
                f"{n_check} for the check ({self.check}) is longer than a message of {WORD} bits; "
                f"leave out or shorten fields by {excess} bits"
            )

    def offsets(self, n_leds: int) -> dict[str, int]:
        """Return the number of the first bit of each field, by its name."""
        offsets = {}
        offset = _led_bits(n_leds)
        for name, field in self.fields:
            offsets[name] = offset
            offset += field.bits
        return offsets

    def pack(self, message: Message, n_leds: int = 4) -> UInt32[Array, "*N"]:
        """Return the 32 bits of messages of robots with this number of LEDs, with their check."""
        offsets = self.offsets(n_leds)
        bits = low_bits(message.led.astype(jnp.uint32), _led_bits(n_leds))
        for name, field in self.fields:
            bits = bits | (field.encode(message.payload[name]) << offsets[name])
        return add_check(self.check, bits)

    def unpack(
        self,
        bits: UInt32[Array, "*N"],
        n_leds: int = 4,
    ) -> tuple[Message, Bool[Array, "*N"]]:
        """Return the messages of 32 bits, and whether their check is right."""
        offsets = self.offsets(n_leds)
        led = low_bits(bits, _led_bits(n_leds)).astype(np.int32)
        values = {}
        for name, field in self.fields:
            values[name] = field.decode(bits_from(bits, offsets[name], field.bits))
        return Message(led, values), passes_check(self.check, bits)


def _pairs_of(fields: Any) -> tuple[Any, ...]:
    """Return a payload's fields as pairs of name and field.

    Raises:
        UserError: they are neither a mapping nor pairs.
    """
    pairs = fields.items() if isinstance(fields, Mapping) else fields
    # An array counts as iterable even without axes, such as a computed number of bits, where
    # `tuple` raises a TypeError; and an empty one would pass for no fields.
    is_array = hasattr(pairs, "dtype")
    if isinstance(pairs, Iterable) and not is_array:
        pairs = tuple(pairs)
        if all(isinstance(pair, tuple) and len(pair) == 2 for pair in pairs):
            return pairs
    form = f"a dictionary of names and fields, as {_EXAMPLE}"
    raise UserError(f"a payload is {form} (got {fields!r})")


def _check_field(name: Any, field: Any) -> None:
    """Raise a UserError unless a payload can have this field by this name."""
    if not isinstance(name, str) or not name.isidentifier() or name in RESERVED:
        rule = f"give it a name as of a variable, but not {' or '.join(RESERVED)}"
        raise UserError(f"a field of a payload cannot be called {name!r}; {rule}")
    if not isinstance(field, Field):
        kinds = f"{', '.join(KINDS)} of iswarm_mj, as {_EXAMPLE}"
        raise UserError(f"field {name!r} of a payload is {field!r}; make it one of {kinds}")
    if name == PRIORITY and not isinstance(field, Flag):
        remedy = "make it a Flag, or give it another name"
        raise UserError(f"field {name!r} of a payload is {field}; {remedy}")


def _check_distinct(fields: tuple[tuple[str, Field], ...]) -> None:
    """Raise a UserError if fields share a name, or the columns of tables that they make."""
    names = [column for name, field in fields for column in column_names(name, field)]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise UserError(f"fields of a payload share the name {repeated[0]!r}; rename one of them")


def _led_bits(n_leds: int) -> int:
    """Return the number of bits of the LED's number."""
    return 2 if n_leds <= 4 else 3


def column_names(name: str, field: Field) -> list[str]:
    """Return the names of a field's columns in tables."""
    if isinstance(field, Vector):
        return [f"{name}_x", f"{name}_y", f"{name}_hop"]
    return [name]


def corrupt(
    bits: UInt32[Array, "*N"],
    uniform: Float[Array, "3 *N"],
    error: Array | float,
    *,
    independent: Array | bool = True,
) -> UInt32[Array, "*N"]:
    """Return messages after a noisy channel, a share `error` of them with at least one wrong bit.

    Either exactly one bit of such a message is wrong, which parity reveals. Or each bit flips
    independently, at a bit error rate e with 1 - (1 - e)^32 = `error`: then some messages, 5 % of
    the wrong ones at an error of 10 %, have two wrong bits, which parity does not reveal. Three or
    more wrong bits count as two.

    Args:
        bits: messages as sent.
        uniform: draws from [0, 1): for the number of wrong bits, and for the positions of the first
            two.
        error: probability of at least one wrong bit.
        independent: bits flip independently.
    """
    # Probabilities of no wrong bit, and of one at most.
    p_none = 1.0 - error
    bit_error_rate = -jnp.expm1(jnp.log1p(-error) / WORD)
    p_one = WORD * bit_error_rate * (1.0 - bit_error_rate) ** (WORD - 1)
    p_one_at_most = jnp.where(independent, p_none + p_one, 1.0)

    # Two different bits, the second by its distance from the first, around the word.
    count, first_place, second_place = uniform
    first = jnp.minimum((first_place * WORD).astype(jnp.uint32), WORD - 1)
    steps = jnp.minimum((second_place * (WORD - 1)).astype(jnp.uint32), WORD - 2)
    second = (first + 1 + steps) % WORD

    lowest_bit = jnp.uint32(1)
    first_flip = jnp.where(count >= p_none, lowest_bit << first, 0)
    second_flip = jnp.where(count >= p_one_at_most, lowest_bit << second, 0)
    return bits ^ (first_flip | second_flip).astype(jnp.uint32)
