"""What robots remember, as recordings show it."""

import numpy as np
from jaxtyping import Bool, Int8, UInt32

from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output.trajectory import Frames, Scene

NO_HOP = -1
"""Hop count that is shown of a robot without a vector."""
_VIRIDIS = {0: (68, 1, 84), 4: (59, 82, 139), 8: (33, 145, 140), 11: (94, 201, 98), 15: (253, 231, 37)}
"""Colours of some hop counts, which the colour-blind can tell apart (Smith and van der Walt 2015)."""
_WITHOUT = (170, 170, 170)
"""Colour of a robot without a vector."""


def is_known(frames: Frames, name: str) -> Bool[np.ndarray, "T N"]:
    """Which robots have a vector: as the strategy says by NAME_known beside NAME_vector, else if it is not 0."""
    flags = frames.memory.get(f"{look.stem(name)}_known")
    return np.any(frames.memory[name], axis=-1) if flags is None else flags


def hop_counts(scene: Scene, frames: Frames) -> dict[str, Int8[np.ndarray, "T N"]]:
    """Hop counts of the recorded vectors that have some, by their names."""
    hops = {name: look.hop(name) for name in scene.arrows}
    return {
        hop: np.where(is_known(frames, name), frames.memory[hop], NO_HOP).astype(np.int8)
        for name, hop in hops.items()
        if hop in frames.memory
    }


def hop_colours(hops: Int8[np.ndarray, "T N"]) -> UInt32[np.ndarray, "T N"]:
    """Return a colour for each hop count, its bytes red, green, blue and 255 from the highest to the lowest."""
    return _COLOURS[hops.astype(np.intp)]


def _packed(hops: np.ndarray) -> np.ndarray:
    """Colours of hop counts; beyond the largest that has one they stay the same."""
    red, green, blue = (np.interp(hops, list(_VIRIDIS), part) for part in zip(*_VIRIDIS.values(), strict=True))
    bytes_ = np.stack([red, green, blue, np.full(len(hops), 255)], axis=1)
    return np.rint(bytes_).astype(np.uint8).view(">u4")[:, 0].astype(np.uint32)


_COLOURS = np.append(_packed(np.arange(2**7)), np.array([[*_WITHOUT, 255]], np.uint8).view(">u4")[0].astype(np.uint32))
"""Colour of each hop count from 0 on; the last is that of `NO_HOP`, -1."""
