"""Vectors among what is recorded of the robots' memory: their names, and which robots know them."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene

_TITLES = {"dust": "vector to dust", "dump": "vector to the dump"}
_SHARES = {"dust": "know the dust", "dump": "know the dump"}


class Vector(NamedTuple):
    """Names of a recorded vector of the plane, in the robots' own frames."""

    name: str
    stem: str
    """As dust for dust_vector."""
    title: str
    """In words."""
    known: str
    """Of the flag of robots that have it, if there is one."""
    hop: str
    """Of its hop counts, if it has some."""
    hop_colour: str
    """Of their colours in recordings."""
    arrows: str
    """Entity of its arrows."""
    share: str
    """Entity of the share of robots that have it."""
    share_title: str


def vector(name: str) -> Vector:
    """Return the names of a recorded vector."""
    stem = name.removesuffix("_vector")
    title, share = _TITLES.get(stem, f"vector {stem}"), _SHARES.get(stem, f"have {stem}")
    entities = f"world/memory/{stem}", f"series/known/{stem}"
    return Vector(name, stem, title, f"{stem}_known", f"{stem}_hop", f"{stem}_hop_colour", *entities, share)


def vectors(scene: Scene) -> list[Vector]:
    """Return the recorded vectors."""
    return [vector(name) for name in scene.arrows]


def is_known(frames: Frames, which: Vector) -> Bool[np.ndarray, "T N"]:
    """Return which robots have a vector: those with its flag where there is one, else those where it is not 0."""
    flags = frames.memory.get(which.known)
    return np.any(frames.memory[which.name], axis=-1) if flags is None else flags
