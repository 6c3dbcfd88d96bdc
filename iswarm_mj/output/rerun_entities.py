"""Entities of a swarm's recording, each with its look and the function that makes what moves.

Input is in SI units, output in millimetres, since the viewer's camera moves well at this scale.
What moves is made for a block of frames at once, never with a call per robot or per frame.
docs/files.md lists the entities.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import cycle
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from jaxtyping import Float, Int, Real, Shaped

from iswarm_mj.output import palette
from iswarm_mj.output import shapes as geometry
from iswarm_mj.output import swarm_classes as classes
from iswarm_mj.output.memory_vectors import (
    UNKNOWN,
    RecordedVector,
    hop_colours,
    hop_counts,
    is_known,
    names_without_vectors,
    recorded_vectors,
)
from iswarm_mj.output.message_columns import shown_fields
from iswarm_mj.output.palette import rgb
from iswarm_mj.output.schema import (
    ARRAYS,
    BALLS,
    LINKS,
    ROBOTS,
    Column,
    Frames,
    column_values,
    columns_of,
)
from iswarm_mj.output.shapes import FRONT_RADIUS, MILLIMETRES, SHEET
from iswarm_mj.output.trajectory import AREA, METRIC, Scene

# Entities in space.
FRONTS = "world/robots/front"
BALL_MARKERS = "world/balls/marker"
BOXES = "world/boxes"
TRAILS = "world/trails"
ARROWS = "world/memory"
AREAS = "world/arena"

# Time series.
SERIES_ROOT = "series/"
COUNTS = "series/states"
SHARES = "series/known"
METRICS = "series/task"
MEMORY = "memory"

UNITS = {
    "m": ("mm", 1e3),
    "m/s": ("mm/s", 1e3),
    "rad": ("deg", float(np.rad2deg(np.float32(1)))),
}
"""Unit in recordings, and the factor to it, for each SI unit that recordings do not use."""
VALUE = "Scalars:scalars"
"""Component of a time series."""
_COLOURS = (palette.SKY, palette.YELLOW, palette.GREEN, palette.PINK)
"""Colours of time series and of what robots remember; they repeat."""


def shown_unit(unit: str) -> str:
    """Return the unit that recordings use for an SI unit."""
    return UNITS.get(unit, (unit, 1.0))[0]


class ShownColumn(NamedTuple):
    """A column of tables that recordings show."""

    component: str
    """Component of the recording."""
    quantity: str
    """Field of `Frames`."""
    place: int
    """Place of the column along the last axis of the quantity."""
    column: Column


def _component(column: Column) -> str:
    """Return the component that shows a column; its name has the unit if the table has another."""
    if column.shown.startswith(SERIES_ROOT):
        return VALUE
    unit = shown_unit(column.unit)
    if unit == column.unit:
        return column.name
    return f"{column.name}_{unit.replace('/', '_per_')}"


def _shown_columns() -> Iterator[ShownColumn]:
    """Yield the columns that recordings show, in the order of the schema."""
    for name in ARRAYS:
        for place, column in enumerate(columns_of(name)):
            if column.shown:
                yield ShownColumn(_component(column), name, place, column)


SHOWN = list(_shown_columns())
"""Columns of tables that recordings show."""
SERIES = {shown.column.shown: shown.column for shown in SHOWN if shown.component == VALUE}
"""Columns that are time series, by their entities."""


class Block(NamedTuple):
    """T consecutive frames."""

    frames: Frames
    history: Float[np.ndarray, "_ N 3"]
    """Centres of the robots in these frames, and in up to `TRAIL_FRAMES` frames before them."""

    @property
    def centres(self) -> Float[np.ndarray, "T N 3"]:
        """Centres of the robots."""
        return self.history[-len(self.frames) :]


class Shape(NamedTuple):
    """The content of an entity in T frames."""

    shown: rr.AsComponents
    """The instances of all frames, one frame after the other."""
    lengths: Int[np.ndarray, "T"] | int = 1
    """Number of instances of each frame; a number if it is the same in all frames."""
    values: Mapping[str, Shaped[np.ndarray, "..."]] = MappingProxyType({})
    """Values that the viewer shows where an instance is selected."""


class Entity(NamedTuple):
    """An entity, or a part of its look."""

    name: str
    look: rr.AsComponents | None
    """The components that do not change."""
    moving: Callable[[Block], Shape] | None = None
    """Function that makes the components that change."""


def entities(scene: Scene) -> list[Entity]:
    """Return all entities but the lanes of states."""
    return [
        *_arena_entities(scene),
        *_body_entities(scene),
        *_task_areas(scene),
        *_memory_entities(scene),
        _state_counts(scene),
        *_series(scene),
    ]


def _arena_entities(scene: Scene) -> Iterator[Entity]:
    """Yield axes, classes, floor, walls, painted areas and obstacles, which do not change."""
    yield Entity("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    known_classes = [
        *classes.shown_classes(scene),
        *classes.BALL_CLASSES,
        *classes.LINK_CLASSES,
    ]
    yield Entity("world", rr.AnnotationContext(known_classes))

    vertices, triangles = geometry.floor(scene)
    colour = rgb(palette.FLOOR)
    mesh = rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=colour)
    yield Entity(f"{AREAS}/floor", mesh)
    for boxes in geometry.arena_boxes(scene):
        yield Entity(f"{AREAS}/{boxes.name}", _fixed_boxes(boxes))


def _body_entities(scene: Scene) -> Iterator[Entity]:
    """Yield robots, balls, links, trails and boxes that robots push."""
    points = rr.Radius.ui_points
    size = np.atleast_2d(scene.robot_size) * MILLIMETRES
    bodies = rr.Boxes3D.from_fields(
        half_sizes=size / 2,
        fill_mode="solid",
        show_labels=False,
        labels=_number_labels(len(scene.is_scout)),
    )
    yield Entity(ROBOTS, bodies, partial(_robots, scene))

    white = (255, 255, 255)
    front_dots = rr.Points3D.from_fields(colors=white, radii=FRONT_RADIUS * size[:, 0])
    yield Entity(FRONTS, front_dots, partial(_fronts, scene))

    balls = rr.Points3D.from_fields(
        radii=np.asarray(scene.ball_radius) * MILLIMETRES,
        show_labels=False,
        labels=_number_labels(len(scene.ball_radius)),
    )
    yield Entity(BALLS, balls, partial(_balls, scene))
    markers = rr.Points3D.from_fields(radii=points(4.0), show_labels=False)
    yield Entity(BALL_MARKERS, markers, partial(_ball_markers, scene))

    link_lines = rr.LineStrips3D.from_fields(radii=points(0.6), show_labels=False)
    yield Entity(LINKS, link_lines, _links)
    trail_lines = rr.LineStrips3D.from_fields(colors=rgb(palette.SKY), radii=points(1.2))
    yield Entity(TRAILS, trail_lines, _trails)

    if len(scene.boxes):
        boxes = rr.Boxes3D.from_fields(colors=rgb(palette.BOX), fill_mode="solid")
        yield Entity(BOXES, boxes, partial(_pushed_boxes, scene))


def _number_labels(n: int) -> list[str]:
    return [str(number) for number in range(n)]


def _task_areas(scene: Scene) -> Iterator[Entity]:
    """Yield the areas that the task adds."""
    for name, colour, shape in zip(
        scene.area_names, scene.area_colours, scene.area_shapes, strict=True
    ):
        if shape == "disc":
            look = rr.Cylinders3D.from_fields(colors=colour, fill_mode="solid")
            moving = partial(_discs, AREA + name)
        else:
            look = rr.Boxes3D.from_fields(colors=colour, fill_mode="solid")
            moving = partial(_squares, AREA + name)
        yield Entity(f"{AREAS}/{name}", look, moving)


def _memory_entities(scene: Scene) -> Iterator[Entity]:
    """Yield the recorded parts of the robots' memory: vectors as arrows, others as time series."""
    radius = 0.06 * scene.length * MILLIMETRES
    for vector, colour in zip(recorded_vectors(scene.memory), cycle(_COLOURS)):
        arrows = rr.Arrows3D.from_fields(colors=rgb(colour), radii=radius)
        yield Entity(f"{ARROWS}/{vector.stem}", arrows, partial(_arrows, scene, vector))
    for name in names_without_vectors(scene):
        yield Entity(f"{MEMORY}/{name}", None, partial(_remembered, name))


def _state_counts(scene: Scene) -> Entity:
    """Return the time series of the number of robots in each state."""
    states = classes.possible_states(scene)
    lines = rr.SeriesLines(
        names=[state.name for state in states],
        colors=[state.colour for state in states],
        widths=[1.5] * len(states),
    )
    return Entity(COUNTS, lines, partial(_counts, scene))


def label(column: Column) -> str:
    """Return the name of a time series in legends, with its unit."""
    return _with_unit(column.name.replace("_", " "), shown_unit(column.unit))


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


class _Series(NamedTuple):
    """A time series of one number."""

    entity: str
    label: str
    values: Callable[[Frames], Any]
    """Function that returns its values (T,)."""


def _series(scene: Scene) -> Iterator[Entity]:
    """Yield the time series of one number; each group begins with the first colour."""
    quantities = []
    for entity, column in SERIES.items():
        quantities.append(_Series(entity, label(column), partial(_quantity_values, entity)))
    shares = []
    for vector in recorded_vectors(scene.memory):
        values = partial(_share_that_knows, vector)
        shares.append(_Series(f"{SHARES}/{vector.stem}", vector.stem, values))
    metrics = []
    for name, unit in zip(scene.metric_names, scene.metric_units, strict=True):
        values = partial(_metric_values, name)
        metrics.append(_Series(f"{METRICS}/{name}", _with_unit(name, unit), values))

    for group in (quantities, shares, metrics):
        for series, colour in zip(group, cycle(_COLOURS)):
            line = rr.SeriesLines(names=series.label, colors=rgb(colour), widths=1.5)
            yield Entity(series.entity, line, partial(_single_scalar, series.values))


def _quantity_values(entity: str, frames: Frames) -> Any:
    return shown_values(entity, frames)[VALUE]


def _share_that_knows(vector: RecordedVector, frames: Frames) -> Any:
    return is_known(frames, vector).mean(axis=1)


def _metric_values(name: str, frames: Frames) -> Any:
    return frames.task[METRIC + name]


def _single_scalar(values: Callable[[Frames], Any], block: Block) -> Shape:
    return _scalars(values(block.frames)[:, None])


def shown_values(entity: str, frames: Frames) -> dict[str, np.ndarray]:
    """Return the values that an entity shows, by component.

    They are of each step (T,), robot (T, N), ball (T, K), or side of a robot (T, N, S).
    """
    arrays = frames.arrays()
    values_of = {}
    for component, quantity, place, column in SHOWN:
        if column.shown != entity:
            continue
        values = column_values(arrays, quantity, place)
        if column.unit in UNITS:
            _, factor = UNITS[column.unit]
            values = values * np.float32(factor)
        if column.known is not None and values.dtype.kind == "i":
            values = np.where(column.known(arrays), values, UNKNOWN).astype(values.dtype)
        values_of[component] = values
    return values_of


def _quaternions_of_yaw(yaw: Float[np.ndarray, "*T"]) -> Float[np.ndarray, "_ 4"]:
    """Return quaternions x, y, z, w of turns about the vertical axis."""
    zero = np.zeros_like(yaw)
    quaternions = np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], axis=-1)
    return quaternions.reshape(-1, 4)


def _fixed_boxes(boxes: geometry.Boxes) -> rr.Boxes3D:
    """Return boxes that stand still."""
    x, y, half_x, half_y, yaw = boxes.places.T
    centre_height = np.full(len(x), (boxes.high + boxes.low) / 2)
    half_height = np.full(len(x), (boxes.high - boxes.low) / 2)
    return rr.Boxes3D(
        centers=np.column_stack([x, y, centre_height]),
        half_sizes=np.column_stack([half_x, half_y, half_height]),
        quaternions=_quaternions_of_yaw(yaw) if yaw.any() else None,
        colors=rgb(boxes.colour),
        fill_mode="solid",
    )


def _robots(scene: Scene, block: Block) -> Shape:
    """Return boxes coloured by state, with what the viewer shows of a selected robot."""
    frames = block.frames
    class_ids = classes.robot_classes(scene, frames.is_loaded, frames.has_priority)
    boxes = rr.Boxes3D.from_fields(
        centers=block.centres.reshape(-1, 3),
        quaternions=_quaternions_of_yaw(frames.pose[..., 2]),
        class_ids=class_ids.reshape(-1),
    )

    values = shown_values(ROBOTS, frames) | shown_fields(scene, frames.message)
    hops = {
        vector.hop: hop_counts(frames, vector)
        for vector in recorded_vectors(scene.memory)
        if vector.hop in scene.memory_names
    }
    values |= hops
    values |= {f"{name}_colour": hop_colours(counts) for name, counts in hops.items()}
    return Shape(boxes, frames.pose.shape[1], values)


def _fronts(scene: Scene, block: Block) -> Shape:
    """Return the dots at the robots' fronts."""
    points = geometry.fronts(scene, block.centres, block.frames.pose[..., 2])
    return Shape(rr.Points3D.from_fields(positions=points.reshape(-1, 3)), points.shape[1])


def _balls(scene: Scene, block: Block) -> Shape:
    """Return points of the balls' true size."""
    centres, _ = geometry.ball_centres(scene, block.frames)
    return _ball_points(centres, block.frames, shown_values(BALLS, block.frames))


def _ball_markers(scene: Scene, block: Block) -> Shape:
    """Return markers above the robots, which stay visible with the whole arena in view."""
    _, markers = geometry.ball_centres(scene, block.frames)
    return _ball_points(markers, block.frames, {})


def _ball_points(
    positions: Float[np.ndarray, "T K 3"], frames: Frames, values: Mapping[str, np.ndarray]
) -> Shape:
    """Return points in the colours of the balls' states."""
    states = frames.ball_state
    class_ids = (states.reshape(-1) + classes.BALL_CLASS_OFFSET).astype(np.uint16)
    points = rr.Points3D.from_fields(positions=positions.reshape(-1, 3), class_ids=class_ids)
    return Shape(points, states.shape[1], values)


def _pushed_boxes(scene: Scene, block: Block) -> Shape:
    """Return the boxes that robots push."""
    places = geometry.pushed_boxes(scene, block.frames)
    x, y, half_x, half_y, yaw = places.reshape(-1, 5).T
    half_height = np.full(len(x), scene.height * MILLIMETRES / 2)
    boxes = rr.Boxes3D.from_fields(
        centers=np.column_stack([x, y, half_height]),
        half_sizes=np.column_stack([half_x, half_y, half_height]),
        quaternions=_quaternions_of_yaw(yaw),
    )
    return Shape(boxes, len(scene.boxes))


def _links(block: Block) -> Shape:
    """Return lines from receivers to senders."""
    frames = block.frames
    is_link = geometry.drawn_links(frames)
    frame, receiver, side = np.nonzero(is_link)
    values = {"receiver": receiver.astype(np.int32), "side": side.astype(np.uint8)}
    for component, shown in shown_values(LINKS, frames).items():
        values[component] = shown[is_link]

    ends = geometry.link_ends(frames, block.centres)
    strips = _line_strips(ends.reshape(-1, 3), np.full(len(frame), 2))
    class_ids = (values["is_heard"] + classes.LINK_CLASS_OFFSET).astype(np.uint16)
    lines = rr.LineStrips3D.from_fields(strips=strips, class_ids=class_ids)
    return Shape(lines, np.bincount(frame, minlength=len(frames)), values)


def _trails(block: Block) -> Shape:
    """Return the trails of loaded robots, oldest point first."""
    is_loaded = block.frames.is_loaded
    n_before = len(block.history) - len(is_loaded)
    points, lengths = geometry.trails(is_loaded, block.history, n_before)
    lines = rr.LineStrips3D.from_fields(strips=_line_strips(points, lengths))
    _, robot = np.nonzero(is_loaded)
    return Shape(lines, np.count_nonzero(is_loaded, axis=1), {"robot": robot.astype(np.int32)})


def _line_strips(points: Float[np.ndarray, "P 3"], lengths: Int[np.ndarray, "M"]) -> pa.Array:
    """Return line strips of the given lengths from consecutive points; without a loop over them."""
    vertices = np.ascontiguousarray(points, np.float32)
    arrow_vertices = rr.encodings.Vec3DBatch(vertices).as_arrow_array()
    offsets = np.append(0, np.cumsum(lengths)).astype(np.int32)
    strip_type = rr.components.LineStrip3DBatch._ARROW_DATATYPE
    return pa.ListArray.from_arrays(offsets, arrow_vertices, type=strip_type)


def _squares(array: str, block: Block) -> Shape:
    """Return flat squares of a task."""
    centres, half, n_areas = _area_places(array, block)
    half_height = np.full(len(half), SHEET / 2)
    half_sizes = np.column_stack([half, half, half_height])
    return Shape(rr.Boxes3D.from_fields(centers=centres, half_sizes=half_sizes), n_areas)


def _discs(array: str, block: Block) -> Shape:
    """Return flat discs of a task."""
    centres, radius, n_areas = _area_places(array, block)
    height = np.full(len(radius), SHEET)
    discs = rr.Cylinders3D.from_fields(centers=centres, radii=radius, lengths=height)
    return Shape(discs, n_areas)


def _area_places(
    array: str, block: Block
) -> tuple[Float[np.ndarray, "P 3"], Float[np.ndarray, "P"], int]:
    """Return centres and half widths of areas in all frames, and the number of areas of a frame."""
    places = block.frames.task[array].astype(np.float64) * MILLIMETRES
    x, y, half = places.reshape(-1, 3).T
    centres = np.column_stack([x, y, np.full(len(x), 1.5 * SHEET)])
    return centres, half, places.shape[1]


def _arrows(scene: Scene, vector: RecordedVector, block: Block) -> Shape:
    """Return arrows from the robots that know a vector, turned to the arena."""
    origins, directions, known = geometry.arrows(scene, block.frames, vector, block.centres)
    arrows = rr.Arrows3D.from_fields(origins=origins, vectors=directions)
    _, robot = np.nonzero(known)
    return Shape(arrows, np.count_nonzero(known, axis=1), {"robot": robot.astype(np.int32)})


def _counts(scene: Scene, block: Block) -> Shape:
    """Return the number of robots in each state."""
    state_of_robot = classes.states_of(scene, block.frames)
    states = np.arange(len(classes.possible_states(scene)))
    return _scalars(np.count_nonzero(state_of_robot[..., None] == states, axis=1))


def _remembered(name: str, block: Block) -> Shape:
    """Return the numbers of a part of the memory, one time series for each robot and number."""
    return _scalars(block.frames.memory[name].reshape(len(block.frames), -1))


def _scalars(values: Real[np.ndarray, "T L"]) -> Shape:
    """Return L time series."""
    return Shape(rr.Scalars(values.reshape(-1).astype(np.float64)), values.shape[1])
