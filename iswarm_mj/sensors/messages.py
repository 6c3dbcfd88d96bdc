"""The 32 bits of a light message (Valdastri et al. 2006, Table 1: 32 bit/message), by declaration.

A message begins with the number of the LED that sends it, in two bits (0 front, 1 left, 2 back, 3 right), or three of
robots with five to eight LEDs. Then come the fields of the strategy's `Payload`, one after the other, and in the
highest bits a check. Bits between are 0. The layout of the paper's strategy is `strategy.vector_strategy.payload_for`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.sensors.checks import CHECKS, WORD, holds, with_check
from iswarm_mj.sensors.fields import KINDS, Field, Flag, Vector
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError

MAX_LEDS = 8
"""Of a robot, since a message has at most three bits for their number."""
RESERVED = ("led", "message")
"""Names that fields cannot have, since tables and recordings have them."""
PRIORITY = "priority"
"""Name of the flag of robots that recordings draw darker."""
_EXAMPLE = '{"count": Integer(bits=4), "heat": Real(0, 1, bits=8)}'


class Message(NamedTuple):
    """Contents of a message; all arrays share their leading shape."""

    led: Int[Array, "*N"]
    """int32, number of the LED that sent it."""
    payload: dict[str, Any]
    """Values of the fields, by their names."""


@dataclass(frozen=True)
class Payload:
    """What a strategy's messages carry: fields by their names, and how receivers check them.

    `Payload({"count": Integer(bits=4), "heat": Real(0, 1, bits=8)}, check="crc-8/smbus")`; without fields, messages
    carry the number of the LED alone.
    """

    fields: Any = ()
    """A mapping from names to `sensors.fields`, or pairs of both; kept as a tuple of pairs."""
    check: str = "parity"
    """One of `checks.CHECKS`."""

    def __post_init__(self):
        given = self.fields.items() if isinstance(self.fields, Mapping) else self.fields
        is_listed = isinstance(given, Iterable) and not hasattr(given, "dtype")
        own: Any = tuple(given) if is_listed else (None,)
        if not all(isinstance(pair, tuple) and len(pair) == 2 for pair in own):
            raise UserError(f"a payload is a dictionary of names and fields, as {_EXAMPLE} (got {self.fields!r})")
        object.__setattr__(self, "fields", own)
        for name, field in own:
            if not isinstance(name, str) or not name.isidentifier() or name in RESERVED:
                rule = f"give it a name as of a variable, but not {' or '.join(RESERVED)}"
                raise UserError(f"a field of a payload cannot be called {name!r}; {rule}")
            if not isinstance(field, Field):
                kinds = f"{', '.join(KINDS)} of iswarm_mj, as {_EXAMPLE}"
                raise UserError(f"field {name!r} of a payload is {field!r}; make it one of {kinds}")
            if name == PRIORITY and not isinstance(field, Flag):
                raise UserError(f"field {name!r} of a payload is {field}; make it a Flag, or give it another name")
        parts = [part for name, field in own for part in columns(name, field)]
        if twice := sorted({part for part in parts if parts.count(part) > 1}):
            raise UserError(f"fields of a payload share the name {twice[0]!r}; rename one of them")
        if self.check not in CHECKS:
            raise UserError(f"check of a payload must be one of {', '.join(CHECKS)} (got {self.check!r})")
        self.check_room(4)

    @property
    def bits(self) -> int:
        """Length of all fields."""
        return sum(field.bits for _, field in self.fields)

    def shapes(self, *shape: int) -> dict[str, Any]:
        """Shapes and types of values."""
        return {name: field.shapes(*shape) for name, field in self.fields}

    def to_json(self) -> dict[str, Any]:
        """Return the declaration in JSON."""
        fields = [[name, {"kind": type(field).__name__, **asdict(field)}] for name, field in self.fields]
        return {"fields": fields, "check": self.check}

    @staticmethod
    def from_json(content: Mapping[str, Any]) -> "Payload":
        """Return the declaration that `to_json` gave."""
        pairs = [(name, dict(values)) for name, values in content["fields"]]
        return Payload([(name, KINDS[values.pop("kind")](**values)) for name, values in pairs], content["check"])

    def check_room(self, n_leds: int) -> None:
        """Check that the fields have room in the messages of robots with so many LEDs.

        Raises:
            UserError: they have not.
        """
        led, check = _led_bits(n_leds), CHECKS[self.check].width
        if (more := led + self.bits + check - WORD) > 0:
            fields = ", ".join(f"{name} {field.bits}" for name, field in self.fields)
            raise UserError(
                f"a payload of {self.bits} bits ({fields}) with {led} for the LED's number and {check} for the check "
                f"({self.check}) is longer than a message of {WORD} bits; leave out or shorten fields by {more} bits"
            )

    def pack(self, message: Message, n_leds: int = 4) -> UInt32[Array, "*N"]:
        """32 bits that encode a message of a robot with so many LEDs, including the check."""
        at = _led_bits(n_leds)
        bits = message.led.astype(jnp.uint32) & (2**at - 1)
        for name, field in self.fields:
            bits = bits | (field.encode(message.payload[name]) << at)
            at += field.bits
        return with_check(self.check, bits)

    def unpack(self, bits: UInt32[Array, "*N"], n_leds: int = 4) -> tuple[Message, Bool[Array, "*N"]]:
        """Message that 32 bits encode, and whether its check is right."""
        values, at = {}, _led_bits(n_leds)
        led = (bits & (2**at - 1)).astype(np.int32)
        for name, field in self.fields:
            values[name] = field.decode((bits >> at) & (2**field.bits - 1))
            at += field.bits
        return Message(led, values), holds(self.check, bits)


def _led_bits(n_leds: int) -> int:
    """Bits of the LED's number."""
    return 2 if n_leds <= 4 else 3


def columns(name: str, field: Field) -> list[str]:
    """Names of a field's parts in tables."""
    return [f"{name}_{part}" for part in ("x", "y", "hop")] if isinstance(field, Vector) else [name]


def corrupt(
    bits: UInt32[Array, "*N"],
    uniform: Float[Array, "3 *N"],
    error: Array | float,
    independent: Array | bool = True,
) -> UInt32[Array, "*N"]:
    """Messages after transmission over a noisy channel, a share `error` of them with at least one wrong bit.

    Either exactly one bit of such a message is wrong, which parity reveals. Or each bit flips independently,
    at a bit error rate e with 1 - (1 - e)^32 = `error`: then some messages, 5 % of the wrong ones at an error of 10 %,
    have two wrong bits, which parity does not reveal. Three or more wrong bits count as two.

    Args:
        bits: as sent.
        uniform: draws from [0, 1): for the number of wrong bits, and for the positions of the first two.
        error: probability of at least one wrong bit.
        independent: bits flip independently.
    """
    clean = 1.0 - error
    rate = -jnp.expm1(jnp.log1p(-error) / 32)
    one_at_most = jnp.where(independent, clean + 32 * rate * (1.0 - rate) ** 31, 1.0)
    count, one_place, other_place = uniform
    first = jnp.minimum((one_place * 32).astype(jnp.uint32), 31)
    second = (first + 1 + jnp.minimum((other_place * 31).astype(jnp.uint32), 30)) % 32
    one = jnp.uint32(1)
    flips = jnp.where(count >= clean, one << first, 0) | jnp.where(count >= one_at_most, one << second, 0)
    return bits ^ flips.astype(jnp.uint32)
