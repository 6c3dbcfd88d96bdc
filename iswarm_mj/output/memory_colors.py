"""Hop counts of what robots remember, and their colours in recordings."""

import numpy as np
from jaxtyping import Int8, UInt32

from iswarm_mj.output.memory_vectors import is_known, vectors
from iswarm_mj.output.rerun_names import UNKNOWN
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene

_VIRIDIS = {0: (68, 1, 84), 4: (59, 82, 139), 8: (33, 145, 140), 11: (94, 201, 98), 15: (253, 231, 37)}
"""Colours of some hop counts, which the colour-blind can distinguish (Smith and van der Walt 2015)."""
_WITHOUT = (170, 170, 170)
"""Colour of a robot without a vector."""


def hop_counts(scene: Scene, frames: Frames) -> dict[str, Int8[np.ndarray, "T N"]]:
    """Return the hop counts of the recorded vectors that have some, by their names; -1 without a vector."""
    each = [vector for vector in vectors(scene) if vector.hop in frames.memory]
    return {v.hop: np.where(is_known(frames, v), frames.memory[v.hop], UNKNOWN).astype(np.int8) for v in each}


def hop_colours(hops: Int8[np.ndarray, "T N"]) -> UInt32[np.ndarray, "T N"]:
    """Return a colour for each hop count, its bytes red, green, blue and 255 from the highest to the lowest."""
    return _COLOURS[hops.astype(np.intp)]


_RGB = [np.interp(np.arange(2**7), list(_VIRIDIS), part) for part in zip(*_VIRIDIS.values(), strict=True)]
_BYTES = np.vstack([np.rint(np.stack(_RGB, axis=1)), _WITHOUT]).astype(np.uint32)
_COLOURS = (_BYTES @ np.array([2**24, 2**16, 2**8], np.uint32) + np.uint32(255)).astype(np.uint32)
"""Colour of each hop count from 0 on; the last is that of `UNKNOWN`, -1."""
