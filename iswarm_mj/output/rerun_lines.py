"""Shapes of a swarm's recording, frame by frame: links and trails."""

import numpy as np
import pyarrow as pa
import rerun as rr
from jaxtyping import Bool, Float, Int, Int16, Shaped

from iswarm_mj.output.rerun_names import LINKS, shown_values
from iswarm_mj.output.schema import Frames

TRAIL_FRAMES = 20
"""Length of a trail [frames]."""


def links_of(
    centres: Float[np.ndarray, "T N 3"], frames: Frames
) -> tuple[pa.Array, Int[np.ndarray, "T"], dict[str, Shaped[np.ndarray, "M"]]]:
    """Return who hears whom.

    Args:
        centres: of the robots.
        frames: with whom each side of each robot receives, and whether it receives someone.

    Returns:
        Lines from receivers to senders, M of them in the order of frames; how many each frame has; their numbers.
    """
    is_link = frames.link_valid
    frame, receiver, side = np.nonzero(is_link)
    numbers = {"receiver": receiver.astype(np.int16), "side": side.astype(np.uint8)}
    numbers |= {name: values[is_link] for name, values in shown_values(LINKS, frames).items()}
    ends = np.stack([centres[frame, receiver], centres[frame, frames.link_sender[is_link]]], axis=1)
    return strips(ends.reshape(-1, 3), np.full(len(frame), 2)), np.bincount(frame, minlength=len(is_link)), numbers


def robots_of(is_shown: Bool[np.ndarray, "T N"]) -> Int16[np.ndarray, "M"]:
    """Return the number of each robot that is shown, in the order of frames."""
    return np.nonzero(is_shown)[1].astype(np.int16)


def trails(
    positions: Float[np.ndarray, "_ N 3"], n_before: int, is_loaded: Bool[np.ndarray, "T N"]
) -> tuple[Float[np.ndarray, "P 3"], Int[np.ndarray, "M"]]:
    """Return the trails of the robots that are loaded, oldest point first.

    Args:
        positions: of the robots, in `n_before` frames before the block and the T frames of the block.
        n_before: number of frames before the block; below `TRAIL_FRAMES` the first trails are shorter.
        is_loaded: in the block.

    Returns:
        The points of all trails, trail by trail, in the order of frames; the number of points of each trail.
    """
    frame, robot = np.nonzero(is_loaded)
    times = frame[:, None] + n_before - np.arange(TRAIL_FRAMES, -1, -1)
    exists = times >= 0
    points = positions[times[exists], np.broadcast_to(robot[:, None], times.shape)[exists]]
    return points, np.count_nonzero(exists, axis=1)


def strips(points: Float[np.ndarray, "P 3"], lengths: Int[np.ndarray, "M"]) -> pa.Array:
    """Return line strips of the given lengths from consecutive points; without a loop over them."""
    vectors = rr.encodings.Vec3DBatch(np.ascontiguousarray(points, np.float32)).as_arrow_array()
    offsets = np.append(0, np.cumsum(lengths)).astype(np.int32)
    return pa.ListArray.from_arrays(offsets, vectors, type=rr.components.LineStrip3DBatch._ARROW_DATATYPE)
