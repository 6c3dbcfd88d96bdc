"""The look of a swarm's recording: colours, line widths, static entities; `rerun_swarm_layout` has the views.

Lengths are in millimetres, as in the recording, since the viewer's camera moves well at this scale.
"""

from collections.abc import Iterator
from itertools import cycle

import numpy as np
import rerun as rr
from jaxtyping import Bool, Float, UInt16

from iswarm_mj.output import palette, rerun_names
from iswarm_mj.output.memory import vectors
from iswarm_mj.output.palette import Rgb, rgb
from iswarm_mj.output.rerun_names import AREAS, BALLS, LINKS, METRICS, ROBOTS, SERIES, SHARES, UNITS
from iswarm_mj.output.trajectory import Scene

MILLIMETRES = 1e3
"""Millimetres per metre."""
CONFIG, KEY = "config", "legend"
_HUES = (palette.SKY, palette.YELLOW, palette.GREEN, palette.PINK)
"""Colours of time series and of what robots remember, in turn."""

ROBOT_CLASSES = (
    (0, "empty", rgb(palette.EMPTY)),
    (1, "empty, sends priority", (135, 55, 0)),
    (2, "scout", rgb(palette.SCOUT)),
    (3, "scout, sends priority", (0, 95, 70)),
    (4, "loaded", rgb(palette.LOADED)),
    (5, "loaded, sends priority", (0, 60, 105)),
)
"""Class, label and colour: load goes before scout, scout before worker; priority is the darker shade.

None is that of the floor or an area on it.
"""
BALL_CLASS_OFFSET, LINK_CLASS_OFFSET = 10, 20
"""A ball's class is the first plus its state; a link's the second, plus one if its message was heard."""
BALL_CLASSES = (
    (10, "on the floor", (25, 25, 25)),
    (11, "held", (255, 240, 60)),
    (12, "delivered", rgb(palette.PURPLE)),
)
_LINK_CLASSES = ((20, "damaged message", rgb(palette.PINK)), (21, "heard", (95, 95, 105)))
FRONT_RADIUS = 0.1
"""Radius of the dot at a robot's front, in lengths of a robot."""
_LEGEND = {
    "": "**Robots**: orange empty, green scout, blue loaded; darker: sends priority. A dot marks the front.",
    "balls": "**Balls**: black on the floor, yellow held, purple delivered; drawn enlarged, above the robots.",
    "links": "**Lines**: grey from a robot to the one it hears, pink if the message arrived damaged; "
    "blue the trail of a loaded robot.",
    "hops": "**Hop counts**: purple 0, blue 4, teal 8, green 11, yellow 15; grey without a vector.",
    "states": "**States**: colours as robots, lighter if an empty one knows dust or a loaded one the dump, "
    "greyer if it stands.",
    "selected": "**Selected**: a robot shows its number, its message of 32 bits and what that says, its hop counts "
    "(-1: no vector), its turn and its way; a line the numbers of receiver and sender, side, LED, and whether the "
    "message was heard; a ball its number and its holder; an arrow or a trail the number of its robot.",
    "floor": "**Floor**: yellow the dump, sand the dust.",
    "units": "All lengths are in millimetres.",
}
"""Paragraphs of the legend."""
_SHEET = 0.02
"""Thickness of the areas that are painted on the floor [mm]."""


def robot_classes(
    is_loaded: Bool[np.ndarray, "T N"], is_scout: Bool[np.ndarray, "N"], has_priority: Bool[np.ndarray, "T N"]
) -> UInt16[np.ndarray, "T N"]:
    """Return classes of `ROBOT_CLASSES`: load before scout before worker, twice that, plus priority."""
    return (np.where(is_loaded, 4, np.where(is_scout, 2, 0)) + has_priority).astype(np.uint16)


def numbers(scene: Scene) -> list[str]:
    """Return the names of what is recorded of the memory, but for vectors drawn as arrows and what belongs to them."""
    drawn = {part for vector in vectors(scene.memory) for part in (vector.name, vector.known, vector.hop)}
    return [name for name in scene.memory_names if name not in drawn]


def areas(areas: Float[np.ndarray, "A 3"], shape: str) -> rr.Boxes3D | rr.Cylinders3D:
    """Return flat areas of x, y and half the width or the radius [mm], of squares or discs."""
    centres, thick = np.column_stack([areas[:, :2], np.full(len(areas), 1.5 * _SHEET)]), np.full(len(areas), _SHEET)
    if shape == "disc":
        return rr.Cylinders3D.from_fields(centers=centres, radii=areas[:, 2], lengths=thick)
    return rr.Boxes3D.from_fields(centers=centres, half_sizes=np.column_stack([areas[:, 2], areas[:, 2], thick / 2]))


def series(scene: Scene) -> dict[str, tuple[str, Rgb]]:
    """Return each time series: its entity, its name in the legend and its colour."""
    metrics = zip(scene.metric_names, scene.metric_units, strict=True)
    groups = (
        [(entity, column.name.replace("_", " "), column.unit) for entity, column in SERIES.items()],
        [(f"{SHARES}/{vector.stem}", vector.stem, "") for vector in vectors(scene.memory)],
        [(f"{METRICS}/{name}", name, unit) for name, unit in metrics],
    )
    found = {}
    for group in groups:
        for (entity, name, unit), hue in zip(group, cycle(_HUES)):
            unit = UNITS.get(unit, (unit,))[0] if entity in SERIES else unit
            found[entity] = f"{name} [{unit}]" if unit else name, rgb(hue)
    return found


def legend(scene: Scene) -> str:
    """Return what colours and lines mean, as far as this scene has them."""
    absent = {
        "balls": not len(scene.ball_radius),
        "hops": not any(vector.hop in scene.memory_names for vector in vectors(scene.memory)),
        "floor": scene.dump[2] <= scene.dump[0] and not np.size(scene.dust_areas),
    }
    return "\n\n".join(text for name, text in _LEGEND.items() if not absent.get(name))


def _boxes(boxes: Float[np.ndarray, "O 5"], low: float, high: float, colour: str) -> rr.Boxes3D:
    """Boxes of x, y, half edges [mm] and yaw [rad], between two heights [mm]."""
    middle, half = np.full(len(boxes), (low + high) / 2), np.full(len(boxes), (high - low) / 2)
    yaw = boxes[:, 4] / 2
    return rr.Boxes3D(
        centers=np.column_stack([boxes[:, :2], middle]),
        half_sizes=np.column_stack([boxes[:, 2:4], half]),
        quaternions=np.stack([0 * yaw, 0 * yaw, np.sin(yaw), np.cos(yaw)], axis=-1) if yaw.any() else None,
        colors=rgb(colour),
        fill_mode="solid",
    )


def _arena(scene: Scene) -> Iterator[tuple[str, rr.Boxes3D]]:
    """Yield floor, walls around it, dump, dust areas and obstacles."""
    half, height = scene.arena_size * MILLIMETRES / 2, scene.robot_size[2] * MILLIMETRES
    beside, thick, length = half + height / 4, height / 4, half + height / 2
    walls = [(side * beside, 0, thick, length, 0) for side in (1, -1)]
    walls += [(0, side * beside, length, thick, 0) for side in (1, -1)]
    dump = np.reshape(scene.dump, (-1, 4))[: int(scene.dump[2] > scene.dump[0])]
    painted = {}
    for name, rectangles in (("dump", dump), ("dust_areas", np.reshape(scene.dust_areas, (-1, 4)))):
        low, high = np.split(rectangles * MILLIMETRES, 2, axis=1)
        painted[name] = np.hstack([(low + high) / 2, (high - low) / 2, 0 * low[:, :1]])
    obstacles = np.reshape(scene.obstacles, (-1, 5)) * [*[MILLIMETRES] * 4, 1]
    for name, boxes, heights, colour in (
        ("floor", np.array([[0, 0, half, half, 0]]), (-_SHEET, 0.0), palette.FLOOR),
        ("walls", np.array(walls), (0.0, height), palette.WALL),
        ("dump", painted["dump"], (_SHEET, 2 * _SHEET), palette.DUMP),
        ("dust_areas", painted["dust_areas"], (_SHEET, 2 * _SHEET), palette.DUST),
        ("obstacles", obstacles, (0.0, height), palette.WALL),
    ):
        if len(boxes):
            yield f"{AREAS}/{name}", _boxes(boxes, *heights, colour)


def static_entities(scene: Scene) -> Iterator[tuple[str, rr.AsComponents]]:
    """Yield (entity, archetype) of all that does not change: the arena, the styles, the colours of states."""
    size = np.asarray(scene.robot_size, float) * MILLIMETRES
    yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    yield "world", rr.AnnotationContext([*ROBOT_CLASSES, *BALL_CLASSES, *_LINK_CLASSES])
    yield KEY, rr.TextDocument(legend(scene), media_type=rr.MediaType.MARKDOWN)
    yield from _arena(scene)
    for name, colour, shape in zip(scene.area_names, scene.area_colours, scene.area_shapes, strict=True):
        kind = rr.Cylinders3D if shape == "disc" else rr.Boxes3D
        yield f"{AREAS}/{name}", kind.from_fields(colors=colour, fill_mode="solid")
    ids = [str(number) for number in range(max(len(scene.is_scout), len(scene.ball_radius)))]
    robots, balls = ids[: len(scene.is_scout)], ids[: len(scene.ball_radius)]
    radii, points = np.asarray(scene.ball_radius) * MILLIMETRES, rr.Radius.ui_points
    yield ROBOTS, rr.Boxes3D.from_fields(half_sizes=[size / 2], fill_mode="solid", show_labels=False, labels=robots)
    yield rerun_names.FRONTS, rr.Points3D.from_fields(colors=(255, 255, 255), radii=FRONT_RADIUS * size[0])
    yield BALLS, rr.Points3D.from_fields(radii=radii, show_labels=False, labels=balls)
    yield rerun_names.BALL_MARKERS, rr.Points3D.from_fields(radii=points(4.0), show_labels=False)
    yield LINKS, rr.LineStrips3D.from_fields(radii=points(0.6), show_labels=False)
    yield rerun_names.TRAILS, rr.LineStrips3D.from_fields(colors=rgb(palette.SKY), radii=points(1.2))
    for vector, colour in zip(vectors(scene.memory), cycle(_HUES)):
        yield f"{rerun_names.ARROWS}/{vector.stem}", rr.Arrows3D.from_fields(colors=rgb(colour), radii=0.06 * size[0])
    for entity, (name, colour) in series(scene).items():
        yield entity, rr.SeriesLines(names=name, colors=colour, widths=1.5)
