"""Shapes of a swarm's recording, frame by frame: colours of robots, links, trails."""

import numpy as np
import pyarrow as pa
import rerun as rr
from jaxtyping import Bool, Float, Int, Int16, UInt16

TRAIL_FRAMES = 20
"""Length of a trail [frames]."""


def robot_classes(
    is_loaded: Bool[np.ndarray, "T N"], is_scout: Bool[np.ndarray, "N"], has_priority: Bool[np.ndarray, "T N"]
) -> UInt16[np.ndarray, "T N"]:
    """Classes of `rerun_swarm_view.ROBOT_CLASSES`: load before scout before worker, twice that, plus priority."""
    return (np.where(is_loaded, 4, np.where(is_scout, 2, 0)) + has_priority).astype(np.uint16)


def link_segments(
    centres: Float[np.ndarray, "T N 3"], sender: Int[np.ndarray, "T N S"], valid: Bool[np.ndarray, "T N S"]
) -> tuple[Float[np.ndarray, "M 2 3"], Int[np.ndarray, "M"], Int[np.ndarray, "M"], Int[np.ndarray, "T"]]:
    """Segments from receivers to senders in the order of frames, their receivers and sides, their number in each frame.

    Args:
        centres: of the robots.
        sender: which robot a sector receives; meaningless where not `valid`.
        valid: whether it receives one.
    """
    frame, receiver, side = np.nonzero(valid)
    segments = np.stack([centres[frame, receiver], centres[frame, sender[valid]]], axis=1)
    return segments, receiver, side, np.count_nonzero(valid, axis=(1, 2))


def robots_of(is_shown: Bool[np.ndarray, "T N"]) -> Int16[np.ndarray, "M"]:
    """Return the number of each robot that is shown, in the order of frames."""
    return np.broadcast_to(np.arange(is_shown.shape[1], dtype=np.int16), is_shown.shape)[is_shown]


def trails(
    positions: Float[np.ndarray, "_ N 3"], n_before: int, is_loaded: Bool[np.ndarray, "T N"]
) -> tuple[Float[np.ndarray, "P 3"], Int[np.ndarray, "M"]]:
    """Trails of the robots that are loaded, oldest point first.

    Args:
        positions: of the robots, in `n_before` frames before the block and the T frames of the block.
        n_before: number of frames before the block; below `TRAIL_FRAMES` the first trails are shorter.
        is_loaded: in the block.

    Returns:
        The points of all trails, trail by trail, in the order of frames; the number of points of each trail.
    """
    frame, robot = np.nonzero(is_loaded)
    back = np.arange(TRAIL_FRAMES, -1, -1)
    times = frame[:, None] + n_before - back
    exists = times >= 0
    points = positions[times[exists], np.broadcast_to(robot[:, None], times.shape)[exists]]
    return points, np.count_nonzero(exists, axis=1)


def strips(points: np.ndarray, lengths: np.ndarray) -> pa.Array:
    """Line strips of the given lengths from consecutive (P, 3) points; without a loop over them."""
    vectors = rr.encodings.Vec3DBatch(np.ascontiguousarray(points, np.float32)).as_arrow_array()
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    return pa.ListArray.from_arrays(offsets, vectors, type=rr.components.LineStrip3DBatch._ARROW_DATATYPE)
