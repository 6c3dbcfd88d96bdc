"""Vectors among the recorded parts of the robots' memory, and colours of their hop counts."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int8, UInt32

from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene

UNKNOWN = -1
"""Hop count of a robot without the vector."""
VECTOR_SUFFIX = "_vector"


class RecordedVector(NamedTuple):
    """Names of a recorded vector of the plane [m], which is in the robots' own frames.

    `known` and `hop` are names that parts of the memory may have: a strategy may record neither.
    """

    name: str
    """Name of the array of vectors, for instance dust_vector."""
    stem: str
    """Name without the suffix, for instance dust."""
    known: str
    """Name of the flag of robots that have the vector, where it is recorded."""
    hop: str
    """Name of the hop counts of the vector, where they are recorded."""


def recorded_vectors(memory: Iterable[tuple[str, str, int]]) -> list[RecordedVector]:
    """Return the vectors among parts of the memory.

    A recording does not state which parts are vectors. By the convention of this package, those are
    that have two numbers a robot with the unit m; a strategy that records two lengths that are no
    vector records them as two parts.

    Args:
        memory: name, unit and size (numbers a robot) of each part.
    """
    vectors = []
    for name, unit, size in memory:
        if unit == "m" and size == 2:
            stem = name.removesuffix(VECTOR_SUFFIX)
            vectors.append(RecordedVector(name, stem, known=f"{stem}_known", hop=f"{stem}_hop"))
    return vectors


def names_without_vectors(scene: Scene) -> list[str]:
    """Return the names of the recorded parts that are neither vectors nor belong to one."""
    drawn = set()
    for vector in recorded_vectors(scene.memory):
        drawn |= {vector.name, vector.known, vector.hop}
    return [name for name in scene.memory_names if name not in drawn]


def is_known(frames: Frames, vector: RecordedVector) -> Bool[np.ndarray, "T N"]:
    """Return which robots have a finite vector: those with its flag.

    Where there is no flag, a vector of length 0 counts as unknown.
    """
    values = frames.memory[vector.name]
    flag = frames.memory.get(vector.known)
    if flag is None:
        flag = np.any(values, axis=-1)
    return flag & np.isfinite(values).all(axis=-1)


def hop_counts(frames: Frames, vector: RecordedVector) -> Int8[np.ndarray, "T N"]:
    """Return the hop counts of a vector that has some; `UNKNOWN` for robots without the vector."""
    hops = frames.memory[vector.hop]
    return np.where(is_known(frames, vector), hops, UNKNOWN).astype(np.int8)


def hop_colours(hops: Int8[np.ndarray, "T N"]) -> UInt32[np.ndarray, "T N"]:
    """Return a colour for each hop count.

    From the highest to the lowest, its bytes are red, green, blue and 255.
    """
    return _HOP_COLOURS[hops.astype(np.intp)]


_VIRIDIS = {
    0: (68, 1, 84),
    4: (59, 82, 139),
    8: (33, 145, 140),
    11: (94, 201, 98),
    15: (253, 231, 37),
}
"""Colours of some hop counts, which the colour-blind can distinguish.

They are those of the map viridis (Smith and van der Walt 2015).
"""
_GREY_LEVEL = 170
"""Red, green and blue of the colour for `UNKNOWN`."""
_MAX_HOPS = 127
"""Largest hop count of eight bits with a sign."""


def _make_hop_colours() -> UInt32[np.ndarray, "_"]:
    """Return the colour of each hop count from 0 on, and last that of `UNKNOWN`, which is -1."""
    hops = np.arange(_MAX_HOPS + 1)
    channels = []
    for levels in zip(*_VIRIDIS.values(), strict=True):
        levels_of_hops = np.interp(hops, list(_VIRIDIS), levels)
        channels.append(np.append(levels_of_hops, _GREY_LEVEL))
    red, green, blue = np.rint(channels).astype(np.uint32)
    opaque = np.uint32(255)
    return red << 24 | green << 16 | blue << 8 | opaque


_HOP_COLOURS = _make_hop_colours()
