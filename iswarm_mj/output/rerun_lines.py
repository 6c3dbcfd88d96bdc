"""Shapes of a swarm's recording, frame by frame: colours of robots, links, trails."""

from typing import NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from jaxtyping import Bool, Float, Int, Int16, UInt8, UInt16

from iswarm_mj.output.trajectory import Frames

TRAIL_FRAMES = 20
"""Length of a trail [frames]."""


def robot_classes(
    is_loaded: Bool[np.ndarray, "T N"], is_scout: Bool[np.ndarray, "N"], has_priority: Bool[np.ndarray, "T N"]
) -> UInt16[np.ndarray, "T N"]:
    """Classes of `rerun_swarm_view.ROBOT_CLASSES`: load before scout before worker, twice that, plus priority."""
    return (np.where(is_loaded, 4, np.where(is_scout, 2, 0)) + has_priority).astype(np.uint16)


class Links(NamedTuple):
    """Who hears whom, M links in the order of frames."""

    strips: pa.Array
    """From receivers to senders."""
    counts: Int[np.ndarray, "T"]
    """Links of each frame."""
    receiver: Int16[np.ndarray, "M"]
    side: UInt8[np.ndarray, "M"]
    sender: Int16[np.ndarray, "M"]
    led: UInt8[np.ndarray, "M"]
    is_heard: Bool[np.ndarray, "M"]


def links_of(centres: Float[np.ndarray, "T N 3"], frames: Frames) -> Links:
    """Return the links of some frames.

    Args:
        centres: of the robots.
        frames: with whom each side of each robot receives, and whether it receives someone.
    """
    n_frames, n_robots, n_sides = frames.link_valid.shape
    place = np.flatnonzero(frames.link_valid)
    robot, side = np.divmod(place.astype(np.int32), n_sides)
    frame, receiver = np.divmod(robot, n_robots)
    sender = frames.link_sender.reshape(-1)[place]
    points, ends = centres.reshape(-1, 3), np.empty((len(place), 2, 3), np.float32)
    ends[:, 0], ends[:, 1] = points[robot], points[frame * n_robots + sender]
    return Links(
        strips(ends, np.full(len(place), 2)),
        np.bincount(frame, minlength=n_frames),
        receiver.astype(np.int16),
        side.astype(np.uint8),
        sender.astype(np.int16),
        frames.link_led.reshape(-1)[place],
        frames.link_heard.reshape(-1)[place],
    )


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
