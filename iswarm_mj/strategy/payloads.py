"""What a strategy's messages carry, as it declares and says it."""

from typing import Any

from jaxtyping import Bool

from iswarm_mj.sensors.messages import Layout, Payload
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError


def payload_of(strategy: Any) -> Payload:
    """Return the payload that a strategy declares by its attribute `payload`; an empty one if it has none.

    Raises:
        UserError: the attribute is something else, or its fields cannot be encoded.
    """
    given = getattr(strategy, "payload", None)
    return given if isinstance(given, Payload) else Payload({} if given is None else given)


def layout_of(strategy: Any, n_leds: int) -> Layout:
    """Return the layout of a strategy's messages, sent by robots with so many LEDs.

    Raises:
        UserError: see `payload_of`; or it is too long.
    """
    try:
        return Layout(payload_of(strategy), n_leds)
    except UserError as error:
        raise UserError(f"{type(strategy).__name__}: {error}") from None


def said(strategy: Any, memory: Any, is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
    """Return what each robot says; nothing where the strategy declares no payload."""
    return strategy.say(memory, is_loaded) if payload_of(strategy).fields else {}
