"""What a swarm's recording shows: each entity once, with its look and what moves. docs/files.md lists them.

SI in, millimetres out, since the viewer's camera moves well at this scale. What moves is made for a block of frames at
once, never with a call per robot or per frame.
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
from iswarm_mj.output.memory import UNKNOWN, Vector, hop_colours, hop_counts, is_known, numbers, vectors
from iswarm_mj.output.message_columns import shown_fields
from iswarm_mj.output.palette import rgb
from iswarm_mj.output.schema import ARRAYS, BALLS, LINKS, ROBOTS, Column, Frames, columns_of
from iswarm_mj.output.schema import numbers as numbers_of
from iswarm_mj.output.shapes import FRONT_RADIUS, MILLIMETRES, SHEET
from iswarm_mj.output.trajectory import AREA, METRIC, Scene

FRONTS, BALL_MARKERS, TRAILS, COUNTS = "world/robots/front", "world/balls/marker", "world/trails", "series/states"
ARROWS, AREAS, MEMORY, SHARES, METRICS = "world/memory", "world/arena", "memory", "series/known", "series/task"
BOXES = "world/boxes"
UNITS = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "rad": ("deg", float(np.rad2deg(np.float32(1))))}
"""SI units, what they become in recordings, and the factor."""
VALUE = "Scalars:scalars"
"""Component of a time series."""
_HUES = (palette.SKY, palette.YELLOW, palette.GREEN, palette.PINK)
"""Colours of time series and of what robots remember, in turn."""


def _component(column: Column) -> str:
    """Component that shows a column of tables, with its unit there if that is another one."""
    unit = UNITS.get(column.unit, (column.unit,))[0]
    own = column.name if unit == column.unit else f"{column.name}_{unit.replace('/', '_per_')}"
    return VALUE if column.shown.startswith("series/") else own


SHOWN = [
    (_component(column), quantity, place, column)
    for quantity in ARRAYS
    for place, column in enumerate(columns_of(quantity))
    if column.shown
]
"""Quantities that recordings show: component there, array, place along its last axis, and column of tables."""
SERIES = {column.shown: column for component, *_, column in SHOWN if component == VALUE}
"""Time series of quantities of a step."""


class Block(NamedTuple):
    """T consecutive frames."""

    frames: Frames
    history: Float[np.ndarray, "_ N 3"]
    """Centres of the robots in up to `TRAIL_FRAMES` frames before them, and in these."""

    @property
    def centres(self) -> Float[np.ndarray, "T N 3"]:
        """Centres of the robots."""
        return self.history[-len(self.frames) :]


class Shape(NamedTuple):
    """What an entity shows in T frames."""

    shown: rr.AsComponents
    """The instances of all frames, one frame after the other."""
    lengths: Int[np.ndarray, "T"] | int = 1
    """Instances of each frame; one number if they are as many in each."""
    values: Mapping[str, Shaped[np.ndarray, "..."]] = MappingProxyType({})
    """What the viewer shows where an instance is selected."""


class Entity(NamedTuple):
    """An entity, or a part of its look."""

    name: str
    look: rr.AsComponents | None
    """What does not change."""
    moving: Callable[[Block], Shape] | None = None


def entities(scene: Scene) -> list[Entity]:
    """Return all entities but the lanes of states."""
    size, points = np.atleast_2d(scene.robot_size) * MILLIMETRES, rr.Radius.ui_points
    robots, balls = ([str(number) for number in range(len(of))] for of in (scene.is_scout, scene.ball_radius))
    corners, triangles = geometry.floor(scene)
    mesh = rr.Mesh3D(vertex_positions=corners, triangle_indices=triangles, albedo_factor=rgb(palette.FLOOR))
    hulls = rr.Boxes3D.from_fields(half_sizes=size / 2, fill_mode="solid", show_labels=False, labels=robots)
    radii = np.asarray(scene.ball_radius) * MILLIMETRES
    known = [*classes.shown_classes(scene), *classes.BALL_CLASSES, *classes.LINK_CLASSES]
    dots = rr.Points3D.from_fields(colors=(255, 255, 255), radii=FRONT_RADIUS * size[:, 0])
    found = [
        Entity("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP),
        Entity("world", rr.AnnotationContext(known)),
        Entity(f"{AREAS}/floor", mesh),
        *(Entity(f"{AREAS}/{boxes.name}", _standing(boxes)) for boxes in geometry.arena_boxes(scene)),
        Entity(ROBOTS, hulls, partial(_robots, scene)),
        Entity(FRONTS, dots, partial(_fronts, scene)),
        Entity(BALLS, rr.Points3D.from_fields(radii=radii, show_labels=False, labels=balls), partial(_balls, scene, 0)),
        Entity(BALL_MARKERS, rr.Points3D.from_fields(radii=points(4.0), show_labels=False), partial(_balls, scene, 1)),
        Entity(LINKS, rr.LineStrips3D.from_fields(radii=points(0.6), show_labels=False), _links),
        Entity(TRAILS, rr.LineStrips3D.from_fields(colors=rgb(palette.SKY), radii=points(1.2)), _trails),
    ]
    if len(scene.boxes):
        look = rr.Boxes3D.from_fields(colors=rgb(palette.BOX), fill_mode="solid")
        found.append(Entity(BOXES, look, partial(_boxes, scene)))
    for name, colour, shape in zip(scene.area_names, scene.area_colours, scene.area_shapes, strict=True):
        kind = rr.Cylinders3D if shape == "disc" else rr.Boxes3D
        look = kind.from_fields(colors=colour, fill_mode="solid")
        found.append(Entity(f"{AREAS}/{name}", look, partial(_areas, AREA + name, shape)))
    for vector, colour in zip(vectors(scene.memory), cycle(_HUES)):
        look = rr.Arrows3D.from_fields(colors=rgb(colour), radii=0.06 * scene.length * MILLIMETRES)
        found.append(Entity(f"{ARROWS}/{vector.stem}", look, partial(_arrows, scene, vector)))
    found += [Entity(f"{MEMORY}/{name}", None, partial(_remembered, name)) for name in numbers(scene)]
    names, colours = zip(*((state.name, state.colour) for state in classes.states(scene)), strict=True)
    look = rr.SeriesLines(names=names, colors=colours, widths=[1.5] * len(names))
    found.append(Entity(COUNTS, look, partial(_counts, scene)))
    return [*found, *_series(scene)]


def label(column: Column) -> str:
    """Return the name of a time series in legends, with its unit."""
    return _with_unit(column.name.replace("_", " "), UNITS.get(column.unit, (column.unit,))[0])


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _series(scene: Scene) -> Iterator[Entity]:
    """Time series of one number, each group in colours of its own."""
    known, metrics = vectors(scene.memory), zip(scene.metric_names, scene.metric_units, strict=True)
    groups: list[list[tuple[str, str, Callable[[Frames], Any]]]] = [
        [
            (name, label(one), lambda frames, name=name: shown_values(name, frames)[VALUE])
            for name, one in SERIES.items()
        ],
        [(f"{SHARES}/{v.stem}", v.stem, lambda frames, v=v: is_known(frames, v).mean(axis=1)) for v in known],
        [(f"{METRICS}/{n}", _with_unit(n, u), lambda frames, n=n: frames.task[METRIC + n]) for n, u in metrics],
    ]
    for group in groups:
        for (entity, name, values), hue in zip(group, cycle(_HUES)):
            look = rr.SeriesLines(names=name, colors=rgb(hue), widths=1.5)
            yield Entity(entity, look, lambda block, values=values: _scalars(values(block.frames)[:, None]))


def shown_values(entity: str, frames: Frames) -> dict[str, np.ndarray]:
    """Return what an entity shows of each step, robot, ball or side of a robot: (T,), (T, N), (T, K) or (T, N, S)."""
    arrays, values = frames.arrays(), {}
    for component, quantity, place, column in SHOWN:
        if column.shown == entity:
            each = numbers_of(arrays, quantity, place)
            if column.unit in UNITS:
                each = each * np.float32(UNITS[column.unit][1])
            if column.known is not None and each.dtype.kind == "i":
                each = np.where(column.known(arrays), each, UNKNOWN).astype(each.dtype)
            values[component] = each
    return values


def _turns(yaw: Float[np.ndarray, "*T"]) -> Float[np.ndarray, "_ 4"]:
    """Quaternions x, y, z, w of turns about the vertical axis."""
    zero = np.zeros_like(yaw)
    return np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], axis=-1).reshape(-1, 4)


def _standing(boxes: geometry.Boxes) -> rr.Boxes3D:
    places = boxes.places
    middle, half = (np.full(len(places), (boxes.high + sign * boxes.low) / 2) for sign in (1, -1))
    return rr.Boxes3D(
        centers=np.column_stack([places[:, :2], middle]),
        half_sizes=np.column_stack([places[:, 2:4], half]),
        quaternions=_turns(places[:, 4]) if places[:, 4].any() else None,
        colors=rgb(boxes.colour),
        fill_mode="solid",
    )


def _robots(scene: Scene, block: Block) -> Shape:
    """Boxes coloured by state."""
    frames = block.frames
    counted = [vector for vector in vectors(scene.memory) if vector.hop in scene.memory_names]
    hops = {vector.hop: hop_counts(frames, vector) for vector in counted}
    boxes = rr.Boxes3D.from_fields(
        centers=block.centres.reshape(-1, 3),
        quaternions=_turns(frames.pose[..., 2]),
        class_ids=classes.robot_classes(scene, frames.is_loaded, frames.has_priority).reshape(-1),
    )
    values = shown_values(ROBOTS, frames) | shown_fields(scene, frames.message)
    values |= hops | {f"{name}_colour": hop_colours(of) for name, of in hops.items()}
    return Shape(boxes, frames.pose.shape[1], values)


def _fronts(scene: Scene, block: Block) -> Shape:
    fronts = geometry.fronts(scene, block.centres, block.frames.pose[..., 2])
    return Shape(rr.Points3D.from_fields(positions=fronts.reshape(-1, 3)), fronts.shape[1])


def _balls(scene: Scene, which: int, block: Block) -> Shape:
    """Points of true size; or markers above the robots, which stay visible with the whole arena in view."""
    frames = block.frames
    places = geometry.ball_centres(scene, frames)[which].reshape(-1, 3)
    kinds = (frames.ball_state.reshape(-1) + classes.BALL_CLASS_OFFSET).astype(np.uint16)
    shown = rr.Points3D.from_fields(positions=places, class_ids=kinds)
    return Shape(shown, frames.ball_state.shape[1], {} if which else shown_values(BALLS, frames))


def _boxes(scene: Scene, block: Block) -> Shape:
    """Boxes that robots push."""
    x, y, half_x, half_y, yaw = geometry.boxes(scene, block.frames).reshape(-1, 5).T
    high = np.full(len(x), scene.height * MILLIMETRES / 2)
    shown = rr.Boxes3D.from_fields(
        centers=np.column_stack([x, y, high]),
        half_sizes=np.column_stack([half_x, half_y, high]),
        quaternions=_turns(yaw),
    )
    return Shape(shown, len(scene.boxes))


def _links(block: Block) -> Shape:
    """Lines from receivers to senders."""
    frames = block.frames
    is_link = frames.link_valid
    frame, receiver, side = np.nonzero(is_link)
    values = {"receiver": receiver.astype(np.int32), "side": side.astype(np.uint8)}
    values |= {name: each[is_link] for name, each in shown_values(LINKS, frames).items()}
    ends = geometry.link_ends(frames, block.centres)
    lines, kinds = _strips(ends.reshape(-1, 3), np.full(len(frame), 2)), values["is_heard"] + classes.LINK_CLASS_OFFSET
    shown = rr.LineStrips3D.from_fields(strips=lines, class_ids=kinds.astype(np.uint16))
    return Shape(shown, np.bincount(frame, minlength=len(frames)), values)


def _trails(block: Block) -> Shape:
    """Where loaded robots came from, oldest point first; shorter where there are fewer frames before."""
    is_loaded = block.frames.is_loaded
    points, lengths = geometry.trails(is_loaded, block.history, len(block.history) - len(is_loaded))
    shown, robot = rr.LineStrips3D.from_fields(strips=_strips(points, lengths)), np.nonzero(is_loaded)[1]
    return Shape(shown, np.count_nonzero(is_loaded, axis=1), {"robot": robot.astype(np.int32)})


def _strips(points: Float[np.ndarray, "P 3"], lengths: Int[np.ndarray, "M"]) -> pa.Array:
    """Line strips of the given lengths from consecutive points; without a loop over them."""
    vectors = rr.encodings.Vec3DBatch(np.ascontiguousarray(points, np.float32)).as_arrow_array()
    offsets = np.append(0, np.cumsum(lengths)).astype(np.int32)
    return pa.ListArray.from_arrays(offsets, vectors, type=rr.components.LineStrip3DBatch._ARROW_DATATYPE)


def _areas(array: str, shape: str, block: Block) -> Shape:
    """Flat squares or discs of a task."""
    places = block.frames.task[array].astype(np.float64) * MILLIMETRES
    x, y, half = places.reshape(-1, 3).T
    centres, thick = np.column_stack([x, y, np.full(len(x), 1.5 * SHEET)]), np.full(len(x), SHEET)
    if shape == "disc":
        return Shape(rr.Cylinders3D.from_fields(centers=centres, radii=half, lengths=thick), places.shape[1])
    sizes = np.column_stack([half, half, thick / 2])
    return Shape(rr.Boxes3D.from_fields(centers=centres, half_sizes=sizes), places.shape[1])


def _arrows(scene: Scene, vector: Vector, block: Block) -> Shape:
    """From the robots that know a vector, turned to the world."""
    origins, ends, known = geometry.arrows(scene, block.frames, vector, block.centres)
    arrows, robot = rr.Arrows3D.from_fields(origins=origins, vectors=ends), np.nonzero(known)[1]
    return Shape(arrows, np.count_nonzero(known, axis=1), {"robot": robot.astype(np.int32)})


def _counts(scene: Scene, block: Block) -> Shape:
    """How many robots are in each state."""
    found = classes.states_of(scene, block.frames)
    places = np.arange(len(classes.states(scene)))
    return _scalars(np.count_nonzero(found[..., None] == places, axis=1))


def _remembered(name: str, block: Block) -> Shape:
    return _scalars(block.frames.memory[name].reshape(len(block.frames), -1))


def _scalars(values: Real[np.ndarray, "T L"]) -> Shape:
    """L time series."""
    return Shape(rr.Scalars(values.reshape(-1).astype(np.float64)), values.shape[1])
