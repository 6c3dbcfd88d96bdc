"""Arena of a world as arrays, so that one compiled program serves all arenas."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.config.arena import ArenaConfig
from iswarm_mj.utils.arrays import Array


class Arena(NamedTuple):
    """Arena of one world as scalars, or of B worlds as arrays (B,), in the units of `ArenaConfig`.

    The dump's size is one of the `Conditions`, since a task may change it. Obstacles, walls and
    boxes differ in number from arena to arena: a task that needs them puts them into its state in
    `Task.lay_out`.
    """

    size: Float[Array, "*B"]
    """Edge of the square arena, or of the square around it [rd]."""
    half_extent: Float[Array, "*B 2"]
    """Largest |x| and largest |y| of a corner [rd]."""
    inradius: Float[Array, "*B"]
    """Distance of the nearest wall from the centre [rd]."""
    dust_area_size: Float[Array, "*B"]
    """Edge of each dust area [rd]."""
    dust_area_offset: Float[Array, "*B"]
    """Distance of the dust areas' centres from the dump's [rd]."""
    n_dust: Int[Array, "*B"]
    """Number of solder balls."""
    ball_radius_min: Float[Array, "*B"]
    """Smallest radius of a solder ball [m]."""
    ball_radius_max: Float[Array, "*B"]
    """Largest radius of a solder ball [m]."""


def arena_of(config: ArenaConfig) -> Arena:
    """Return the arena that a configuration sets, as NumPy scalars and arrays of 32 bits."""
    half_extent = np.abs(np.array(config.corners)).max(axis=0)
    values: dict[str, Any] = {
        "size": np.float32(config.size),
        "half_extent": half_extent.astype(np.float32),
        "inradius": np.float32(config.inradius),
        "dust_area_size": np.float32(config.dust_area_size),
        "dust_area_offset": np.float32(config.dust_area_offset),
        "n_dust": np.int32(config.n_dust),
        "ball_radius_min": np.float32(config.ball_radius_min),
        "ball_radius_max": np.float32(config.ball_radius_max),
    }
    return Arena(**values)
