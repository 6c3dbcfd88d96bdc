"""The devices of this process that a batched run is spread over."""

from typing import Any

import jax

from iswarm_mj.errors import UserError


def devices(count: str) -> list[Any]:
    """Return the devices to use.

    Args:
        count: "all", or how many of the visible ones.

    Raises:
        UserError: there are not so many, or it is no number.
    """
    visible = jax.local_devices()
    if count == "all":
        return visible
    if not (count.isascii() and count.isdecimal()) or not 1 <= int(count) <= len(visible):
        raise UserError(
            f"--devices was {count}; JAX sees {len(visible)} ({visible[0].device_kind}): give all, or 1 to "
            f"{len(visible)}."
        )
    return visible[: int(count)]
