"""Vectors among what is recorded of the robots' memory: their names, and which robots know them."""

import numpy as np
from jaxtyping import Bool

from iswarm_mj.output.schema import Frames


def stem(name: str) -> str:
    """Return what a recorded vector is called, as `dust` for dust_vector."""
    return name.removesuffix("_vector")


def title(name: str) -> str:
    """Return what a recorded vector is called in words."""
    return {"dust": "vector to dust", "dump": "vector to the dump"}.get(stem(name), f"vector {stem(name)}")


def known_name(name: str) -> str:
    """Return the name of the flag of robots that have a recorded vector."""
    return f"{stem(name)}_known"


def hop_name(name: str) -> str:
    """Return the name of the hop counts of a recorded vector."""
    return f"{stem(name)}_hop"


def is_known(frames: Frames, name: str) -> Bool[np.ndarray, "T N"]:
    """Return which robots have a vector: those with its flag where there is one, else those where it is not 0."""
    flags = frames.memory.get(known_name(name))
    return np.any(frames.memory[name], axis=-1) if flags is None else flags
