"""What robots remember, as recordings show it."""

import numpy as np
from jaxtyping import Bool, Int8

from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output.trajectory import Frames, Scene

NO_HOP = -1
"""Hop count that is shown of a robot without a vector."""


def is_known(frames: Frames, name: str) -> Bool[np.ndarray, "T N"]:
    """Which robots have a vector: as the strategy says by NAME_known beside NAME_vector, else if it is not 0."""
    flags = frames.memory.get(f"{look.stem(name)}_known")
    return np.any(frames.memory[name], axis=-1) if flags is None else flags


def hop_counts(scene: Scene, frames: Frames) -> dict[str, Int8[np.ndarray, "T N"]]:
    """Hop counts of the recorded vectors that have some, by their names."""
    hops = {name: f"{look.stem(name)}_hop" for name in scene.arrows}
    return {
        hop: np.where(is_known(frames, name), frames.memory[hop], NO_HOP).astype(np.int8)
        for name, hop in hops.items()
        if hop in frames.memory
    }
