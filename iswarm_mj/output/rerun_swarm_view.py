"""The look of a swarm's recording: colours, line widths, static entities; `rerun_swarm_layout` has the views.

Lengths are in millimetres, as in the recording, since the viewer's camera moves well at this scale.
"""

from collections.abc import Iterator
from itertools import cycle
from typing import Any

import numpy as np
import rerun as rr

from iswarm_mj.output.trajectory import Scene

MILLIMETRES = 1e3
"""Millimetres per metre."""

ROBOTS, FRONTS = "world/robots/body", "world/robots/front"
BALLS, BALL_MARKERS = "world/balls/true_size", "world/balls/marker"
LINKS, TRAILS = "world/links", "world/trails"
MEMORY = "memory"
CONFIG = "config"
KEY = "legend"

SERIES = {
    "series/balls/picked": ("picked up", (230, 140, 40)),
    "series/balls/delivered": ("delivered", (60, 170, 80)),
    "series/collisions": ("collisions", (215, 65, 60)),
    "series/mean_speed": ("mean speed [mm/s]", (150, 110, 210)),
}
"""Entity of each time series but those of the memory: its name in the legend and its colour."""

_HUES = ((80, 150, 230), (225, 180, 40), (110, 200, 120), (220, 110, 160))
"""Colours of what robots remember, in turn."""

ROBOT_CLASSES = (
    (0, "empty", (213, 94, 0)),
    (1, "empty, sends priority", (135, 55, 0)),
    (2, "scout", (0, 158, 115)),
    (3, "scout, sends priority", (0, 95, 70)),
    (4, "loaded", (0, 114, 178)),
    (5, "loaded, sends priority", (0, 60, 105)),
)
"""Class, label and colour: load goes before scout, scout before worker; priority is the darker shade.

The colour-blind can tell them apart (Okabe and Ito 2008), and none is that of the floor or an area on it.
"""

BALL_CLASS_OFFSET = 10
"""A ball's class is this plus its state."""
_BALL_CLASSES = (
    (10, "on the floor", (25, 25, 25)),
    (11, "held", (255, 240, 60)),
    (12, "delivered", (170, 60, 140)),
)

LINK_CLASS_OFFSET = 20
"""A link's class is this, plus one if its message was heard."""
_LINK_CLASSES = ((20, "damaged message", (204, 121, 167)), (21, "heard", (95, 95, 105)))

FRONT_RADIUS = 0.1
"""Radius of the dot at a robot's front, in lengths of a robot."""

_FLOOR, _WALL, _DUMP, _DUST_AREA = (226, 226, 222), (120, 124, 130), (250, 205, 50), (205, 195, 175)
_TRAIL, _FRONT = (86, 180, 233), (255, 255, 255)
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


def _sheet(rectangles: np.ndarray, top: float, colour: tuple[int, int, int]) -> rr.Boxes3D:
    """Thin boxes that cover (A, 4) rectangles [mm] and end at the height `top` [mm]."""
    low, high = rectangles[:, :2], rectangles[:, 2:]
    centres = np.column_stack([(low + high) / 2, np.full(len(low), top - _SHEET / 2)])
    half_sizes = np.column_stack([(high - low) / 2, np.full(len(low), _SHEET / 2)])
    return rr.Boxes3D(centers=centres, half_sizes=half_sizes, colors=colour, fill_mode="solid")


def _walls(arena_size: float, height: float) -> rr.Boxes3D:
    """Four walls of `height` around the square arena [mm]; they stand outside it."""
    half, thick = arena_size / 2, height / 2
    offset, length = half + thick / 2, half + thick
    middle = height / 2
    centres = [(offset, 0, middle), (-offset, 0, middle), (0, offset, middle), (0, -offset, middle)]
    half_sizes = [(thick / 2, length, middle)] * 2 + [(length, thick / 2, middle)] * 2
    return rr.Boxes3D(centers=centres, half_sizes=half_sizes, colors=_WALL, fill_mode="solid")


def _obstacles(boxes: np.ndarray, height: float) -> rr.Boxes3D:
    """Boxes (O, 5) of x, y, half edges [m] and yaw [rad], as high as the walls [mm]."""
    xy, half, yaw = boxes[:, :2] * MILLIMETRES, boxes[:, 2:4] * MILLIMETRES, boxes[:, 4]
    middle, zero = np.full(len(boxes), height / 2), np.zeros(len(boxes))
    turned = np.column_stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)])
    return rr.Boxes3D(
        centers=np.column_stack([xy, middle]),
        half_sizes=np.column_stack([half, middle]),
        quaternions=turned,
        colors=_WALL,
        fill_mode="solid",
    )


def stem(name: str) -> str:
    """Return what a recorded vector is called, as `dust` for dust_vector."""
    return name.removesuffix("_vector")


def title(name: str) -> str:
    """Return what a recorded vector is called in words."""
    return {"dust": "vector to dust", "dump": "vector to the dump"}.get(stem(name), f"vector {stem(name)}")


def arrows(name: str) -> str:
    """Return the entity of the arrows of a recorded vector."""
    return f"world/memory/{stem(name)}"


def known(name: str) -> str:
    """Return the entity of the share of robots that have a recorded vector."""
    return f"series/known/{stem(name)}"


def hop(name: str) -> str:
    """Return the name of the hop counts of a recorded vector."""
    return f"{stem(name)}_hop"


def hop_colour(hop: str) -> str:
    """Return the name of the colours of these hop counts."""
    return f"{hop}_colour"


def numbers(scene: Scene) -> list[str]:
    """Names of what is recorded of the memory, but for vectors drawn as arrows and what belongs to them."""
    drawn = {*scene.arrows, *(f"{stem(name)}_{part}" for name in scene.arrows for part in ("known", "hop"))}
    return [name for name in scene.memory_names if name not in drawn]


def area(name: str) -> str:
    """Return the entity of areas of the task."""
    return f"world/arena/{name}"


def areas(areas: np.ndarray, shape: str) -> Any:
    """Return flat areas (A, 3) of x, y and half the width or the radius [mm], of squares or discs."""
    centres = np.column_stack([areas[:, :2], np.full(len(areas), 1.5 * _SHEET)])
    if shape == "disc":
        return rr.Cylinders3D.from_fields(centers=centres, radii=areas[:, 2], lengths=np.full(len(areas), _SHEET))
    half = np.column_stack([areas[:, 2], areas[:, 2], np.full(len(areas), _SHEET / 2)])
    return rr.Boxes3D.from_fields(centers=centres, half_sizes=half)


def metric(name: str) -> str:
    """Return the entity of a metric of the task."""
    return f"series/task/{name}"


def series(scene: Scene) -> dict[str, tuple[str, tuple[int, int, int]]]:
    """Entity of each time series: its name in the legend and its colour."""
    words = {"dust": "know the dust", "dump": "know the dump"}
    shares = {
        known(name): (words.get(stem(name), f"have {stem(name)}"), hue) for name, hue in zip(scene.arrows, cycle(_HUES))
    }
    of_task = {
        metric(name): (f"{name} [{unit}]" if unit else name, hue)
        for name, unit, hue in zip(scene.metric_names, scene.metric_units, cycle(_HUES))
    }
    return SERIES | shares | of_task


def legend(scene: Scene) -> str:
    """Return what colours and lines mean, as far as this scene has them."""
    absent = {
        "balls": not len(scene.ball_radius),
        "hops": not any(hop(name) in scene.memory_names for name in scene.arrows),
        "floor": scene.dump[2] <= scene.dump[0] and not np.size(scene.dust_areas),
    }
    return "\n\n".join(text for name, text in _LEGEND.items() if not absent.get(name))


def static_entities(scene: Scene) -> Iterator[tuple[str, Any]]:
    """Yield (entity, archetype) of all that does not change: the arena, the styles, the colours of states."""
    size = np.asarray(scene.robot_size, float) * MILLIMETRES
    arena = scene.arena_size * MILLIMETRES
    floor = np.array([[-arena / 2, -arena / 2, arena / 2, arena / 2]])
    yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    yield "world", rr.AnnotationContext([*ROBOT_CLASSES, *_BALL_CLASSES, *_LINK_CLASSES])
    yield KEY, rr.TextDocument(legend(scene), media_type=rr.MediaType.MARKDOWN)
    yield "world/arena/floor", _sheet(floor, 0.0, _FLOOR)
    yield "world/arena/walls", _walls(arena, size[2])
    if scene.dump[2] > scene.dump[0]:
        yield "world/arena/dump", _sheet(np.atleast_2d(scene.dump) * MILLIMETRES, 2 * _SHEET, _DUMP)
    areas = np.reshape(scene.dust_areas, (-1, 4)) * MILLIMETRES
    if len(areas):
        yield "world/arena/dust_areas", _sheet(areas, 2 * _SHEET, _DUST_AREA)
    if len(scene.obstacles):
        yield "world/arena/obstacles", _obstacles(scene.obstacles, size[2])
    for name, colour, shape in zip(scene.area_names, scene.area_colours, scene.area_shapes, strict=True):
        kind = rr.Cylinders3D if shape == "disc" else rr.Boxes3D
        yield area(name), kind.from_fields(colors=colour, fill_mode="solid")
    names = [str(robot) for robot in range(len(scene.is_scout))]
    yield ROBOTS, rr.Boxes3D.from_fields(half_sizes=[size / 2], fill_mode="solid", show_labels=False, labels=names)
    yield FRONTS, rr.Points3D.from_fields(colors=_FRONT, radii=FRONT_RADIUS * size[0])
    radii = np.asarray(scene.ball_radius) * MILLIMETRES
    balls = [str(ball) for ball in range(len(radii))]
    yield BALLS, rr.Points3D.from_fields(radii=radii, show_labels=False, labels=balls)
    yield BALL_MARKERS, rr.Points3D.from_fields(radii=rr.Radius.ui_points(4.0), show_labels=False)
    yield LINKS, rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(0.6), show_labels=False)
    yield TRAILS, rr.LineStrips3D.from_fields(colors=_TRAIL, radii=rr.Radius.ui_points(1.2))
    for name, colour in zip(scene.arrows, cycle(_HUES)):
        yield arrows(name), rr.Arrows3D.from_fields(colors=colour, radii=0.06 * size[0])
    for entity, (name, colour) in series(scene).items():
        yield entity, rr.SeriesLines(names=name, colors=colour, widths=1.5)
