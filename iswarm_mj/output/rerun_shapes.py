"""What moves in a swarm's recording: shapes and numbers of a block of frames. SI in, millimetres out.

Of a block all at once, never with a call per robot or per frame.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from jaxtyping import Bool, Float, Int, Real, Shaped

from iswarm_mj.output import rerun_names as names
from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output import shapes as geometry
from iswarm_mj.output import swarm_classes as classes
from iswarm_mj.output.memory import hop_colours, hop_counts, is_known, numbers, vectors
from iswarm_mj.output.message_columns import shown_fields
from iswarm_mj.output.rerun_names import shown_values
from iswarm_mj.output.rerun_states import states, states_of
from iswarm_mj.output.schema import BALLS, LINKS, ROBOTS, Frames
from iswarm_mj.output.trajectory import AREA, METRIC, Scene


class Shape(NamedTuple):
    """An entity in a block of T frames."""

    entity: str
    shown: rr.AsComponents
    """The instances of all frames, one frame after the other."""
    lengths: Int[np.ndarray, "T"] | int = 1
    """Instances of each frame; one number if they are as many in each."""
    values: dict[str, Shaped[np.ndarray, "..."]] = {}  # noqa: RUF012, never changed
    """What the viewer shows where an instance is selected."""


def shapes(scene: Scene, frames: Frames, before: Float[np.ndarray, "_ N 3"]) -> Iterator[Shape]:
    """Yield all shapes.

    Args:
        scene: of the world.
        frames: of the block.
        before: poses in up to `TRAIL_FRAMES` frames before it.
    """
    history = geometry.centres(scene, np.concatenate([before, frames.pose]))
    centres = history[len(before) :]
    yield from _robots(scene, frames, centres)
    yield from _balls(scene, frames)
    yield from _boxes(scene, frames)
    yield _links(frames, centres)
    yield _trails(frames.is_loaded, history, len(before))
    yield from _memory(scene, frames, centres)
    for name, shape in zip(scene.area_names, scene.area_shapes, strict=True):
        areas = frames.task[AREA + name].astype(np.float64) * geometry.MILLIMETRES
        yield Shape(f"{names.AREAS}/{name}", look.areas(areas.reshape(-1, 3), shape), areas.shape[1])
    yield from _series(scene, frames)


def _robots(scene: Scene, frames: Frames, centres: Float[np.ndarray, "T N 3"]) -> Iterator[Shape]:
    """Boxes coloured by state, and a dot at each front."""
    counted = [vector for vector in vectors(scene.memory) if vector.hop in scene.memory_names]
    yaw, hops = frames.pose[..., 2], {vector.hop: hop_counts(frames, vector) for vector in counted}
    zero = np.zeros_like(yaw)
    boxes = rr.Boxes3D.from_fields(
        centers=centres.reshape(-1, 3),
        quaternions=np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], axis=-1).reshape(-1, 4),
        class_ids=classes.robot_classes(scene, frames.is_loaded, frames.has_priority).reshape(-1),
    )
    values = shown_values(ROBOTS, frames) | shown_fields(scene, frames.message)
    values |= hops | {f"{name}_colour": hop_colours(of) for name, of in hops.items()}
    yield Shape(ROBOTS, boxes, yaw.shape[1], values)
    fronts = geometry.fronts(scene, centres, yaw)
    yield Shape(names.FRONTS, rr.Points3D.from_fields(positions=fronts.reshape(-1, 3)), yaw.shape[1])


def _balls(scene: Scene, frames: Frames) -> Iterator[Shape]:
    """Points of true size; above the robots, markers that stay visible with the whole arena in view."""
    n_balls = frames.ball_position.shape[1]
    positions, above = (a.reshape(-1, 3) for a in geometry.ball_centres(scene, frames))
    kinds = (frames.ball_state.reshape(-1) + classes.BALL_CLASS_OFFSET).astype(np.uint16)
    points = rr.Points3D.from_fields(positions=positions, class_ids=kinds)
    yield Shape(BALLS, points, n_balls, shown_values(BALLS, frames))
    yield Shape(names.BALL_MARKERS, rr.Points3D.from_fields(positions=above, class_ids=kinds), n_balls)


def _boxes(scene: Scene, frames: Frames) -> Iterator[Shape]:
    """Boxes that robots push, if there are any."""
    if not len(scene.boxes):
        return
    x, y, half_x, half_y, yaw = geometry.boxes(scene, frames).reshape(-1, 5).T
    zero, high = np.zeros_like(x), np.full(len(x), scene.height * geometry.MILLIMETRES / 2)
    shown = rr.Boxes3D.from_fields(
        centers=np.column_stack([x, y, high]),
        half_sizes=np.column_stack([half_x, half_y, high]),
        quaternions=np.column_stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)]),
    )
    yield Shape(names.BOXES, shown, len(scene.boxes))


def _links(frames: Frames, centres: Float[np.ndarray, "T N 3"]) -> Shape:
    """Lines from receivers to senders."""
    is_link = frames.link_valid
    frame, receiver, side = np.nonzero(is_link)
    values = {"receiver": receiver.astype(np.int32), "side": side.astype(np.uint8)}
    values |= {name: each[is_link] for name, each in shown_values(LINKS, frames).items()}
    ends = geometry.link_ends(frames, centres)
    lines, kinds = _strips(ends.reshape(-1, 3), np.full(len(frame), 2)), values["is_heard"] + classes.LINK_CLASS_OFFSET
    shown = rr.LineStrips3D.from_fields(strips=lines, class_ids=kinds.astype(np.uint16))
    return Shape(LINKS, shown, np.bincount(frame, minlength=len(frames)), values)


def _trails(is_loaded: Bool[np.ndarray, "T N"], history: Float[np.ndarray, "_ N 3"], n_before: int) -> Shape:
    """Where loaded robots came from, oldest point first; shorter where there are fewer frames before."""
    points, lengths = geometry.trails(is_loaded, history, n_before)
    shown, robot = rr.LineStrips3D.from_fields(strips=_strips(points, lengths)), np.nonzero(is_loaded)[1]
    return Shape(names.TRAILS, shown, np.count_nonzero(is_loaded, axis=1), {"robot": robot.astype(np.int32)})


def _strips(points: Float[np.ndarray, "P 3"], lengths: Int[np.ndarray, "M"]) -> pa.Array:
    """Line strips of the given lengths from consecutive points; without a loop over them."""
    vectors = rr.encodings.Vec3DBatch(np.ascontiguousarray(points, np.float32)).as_arrow_array()
    offsets = np.append(0, np.cumsum(lengths)).astype(np.int32)
    return pa.ListArray.from_arrays(offsets, vectors, type=rr.components.LineStrip3DBatch._ARROW_DATATYPE)


def _memory(scene: Scene, frames: Frames, centres: Float[np.ndarray, "T N 3"]) -> Iterator[Shape]:
    """Arrows from the robots that know a vector, turned to the world; a series for other numbers of each robot."""
    for vector in vectors(scene.memory):
        origins, ends, known = geometry.arrows(scene, frames, vector, centres)
        arrows, robot = rr.Arrows3D.from_fields(origins=origins, vectors=ends), np.nonzero(known)[1]
        counts = np.count_nonzero(known, axis=1)
        yield Shape(f"{names.ARROWS}/{vector.stem}", arrows, counts, {"robot": robot.astype(np.int32)})
    for name in numbers(scene):
        yield _scalars(f"{names.MEMORY}/{name}", frames.memory[name].reshape(len(frames), -1))


def _series(scene: Scene, frames: Frames) -> Iterator[Shape]:
    """How many robots are in each state; time series, of which shares are of all robots."""
    found = states_of(scene, frames)
    yield _scalars(names.COUNTS, [np.count_nonzero(found == place, axis=1) for place in range(len(states(scene)))])
    yield from (_scalars(entity, [*shown_values(entity, frames).values()]) for entity in names.SERIES)
    for vector in vectors(scene.memory):
        yield _scalars(f"{names.SHARES}/{vector.stem}", [is_known(frames, vector).mean(axis=1)])
    yield from (_scalars(f"{names.METRICS}/{name}", [frames.task[METRIC + name]]) for name in scene.metric_names)


def _scalars(entity: str, values: Real[np.ndarray, "T L"] | list[np.ndarray]) -> Shape:
    """L time series, given as columns or as a list of them."""
    columns = np.stack(values, axis=1) if isinstance(values, list) else values
    return Shape(entity, rr.Scalars(columns.reshape(-1).astype(np.float64)), columns.shape[1])
