"""Vectors among what is recorded of the robots' memory, and the colours of their hop counts in recordings."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int8, UInt32

from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene

UNKNOWN = -1
"""Hop count without a vector."""


class Vector(NamedTuple):
    """Names of a recorded vector of the plane [m], in the robots' own frames."""

    name: str
    stem: str
    """As dust for dust_vector."""
    known: str
    """Of the flag of robots that have it, if there is one."""
    hop: str
    """Of its hop counts, if it has some."""


def vectors(memory: Iterable[tuple[str, str, int]]) -> list[Vector]:
    """Return the vectors among parts of the memory: their names, units and numbers of numbers."""
    stems = {name: name.removesuffix("_vector") for name, *about in memory if about == ["m", 2]}
    return [Vector(name, stem, f"{stem}_known", f"{stem}_hop") for name, stem in stems.items()]


def numbers(scene: Scene) -> list[str]:
    """Return the names of what is recorded of the memory, but for vectors drawn as arrows and what belongs to them."""
    drawn = {part for vector in vectors(scene.memory) for part in (vector.name, vector.known, vector.hop)}
    return [name for name in scene.memory_names if name not in drawn]


def is_known(frames: Frames, which: Vector) -> Bool[np.ndarray, "T N"]:
    """Return which robots have a finite vector: those with its flag, or where there is none those where it is not 0."""
    flags, vector = frames.memory.get(which.known), frames.memory[which.name]
    return (np.any(vector, axis=-1) if flags is None else flags) & np.isfinite(vector).all(axis=-1)


def hop_counts(frames: Frames, which: Vector) -> Int8[np.ndarray, "T N"]:
    """Return the hop counts of a vector that has some; `UNKNOWN` without the vector."""
    return np.where(is_known(frames, which), frames.memory[which.hop], UNKNOWN).astype(np.int8)


def hop_colours(hops: Int8[np.ndarray, "T N"]) -> UInt32[np.ndarray, "T N"]:
    """Return a colour for each hop count, its bytes red, green, blue and 255 from the highest to the lowest."""
    return _COLOURS[hops.astype(np.intp)]


_VIRIDIS = {0: (68, 1, 84), 4: (59, 82, 139), 8: (33, 145, 140), 11: (94, 201, 98), 15: (253, 231, 37)}
"""Colours of some hop counts, which the colour-blind can distinguish (Smith and van der Walt 2015)."""
_RGB = [[*np.interp(np.arange(2**7), list(_VIRIDIS), part), 170] for part in zip(*_VIRIDIS.values(), strict=True)]
_COLOURS = (np.rint(_RGB).T.astype(np.uint32) @ np.array([2**24, 2**16, 2**8], np.uint32) + 255).astype(np.uint32)
"""Colour of each hop count from 0 on; the last, a grey, is that of `UNKNOWN`, -1."""
