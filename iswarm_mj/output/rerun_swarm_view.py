"""The look of a swarm's recording: colours, line widths, static entities; `rerun_swarm_layout` has the views.

Lengths are in millimetres, as in the recording, since the viewer's camera moves well at this scale.
"""

from collections.abc import Iterator
from itertools import cycle

import numpy as np
import rerun as rr
from jaxtyping import Float

from iswarm_mj.output import palette, rerun_names
from iswarm_mj.output.memory import vectors
from iswarm_mj.output.palette import Rgb, rgb
from iswarm_mj.output.rerun_names import AREAS, METRICS, SERIES, SHARES, UNITS
from iswarm_mj.output.schema import BALLS, LINKS, ROBOTS
from iswarm_mj.output.shapes import FRONT_RADIUS, MILLIMETRES, SHEET, Boxes, arena_boxes, floor
from iswarm_mj.output.swarm_classes import BALL_CLASSES, LINK_CLASSES, groups, shown_classes
from iswarm_mj.output.trajectory import Scene

CONFIG, KEY = "config", "legend"
_HUES = (palette.SKY, palette.YELLOW, palette.GREEN, palette.PINK)
"""Colours of time series and of what robots remember, in turn."""

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


def areas(areas: Float[np.ndarray, "A 3"], shape: str) -> rr.Boxes3D | rr.Cylinders3D:
    """Return flat areas of x, y and half the width or the radius [mm], of squares or discs."""
    centres, thick = np.column_stack([areas[:, :2], np.full(len(areas), 1.5 * SHEET)]), np.full(len(areas), SHEET)
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
    names = groups(scene)[1]
    own = {"": f"**Robots** by group: {', '.join(names)}; darker: loaded. A dot marks the front."} if names else {}
    return "\n\n".join(own.get(name, text) for name, text in _LEGEND.items() if not absent.get(name))


def _boxes(boxes: Boxes) -> rr.Boxes3D:
    places, yaw = boxes.places, boxes.places[:, 4] / 2
    middle, half = (np.full(len(yaw), (boxes.high + sign * boxes.low) / 2) for sign in (1, -1))
    return rr.Boxes3D(
        centers=np.column_stack([places[:, :2], middle]),
        half_sizes=np.column_stack([places[:, 2:4], half]),
        quaternions=np.stack([0 * yaw, 0 * yaw, np.sin(yaw), np.cos(yaw)], axis=-1) if yaw.any() else None,
        colors=rgb(boxes.colour),
        fill_mode="solid",
    )


def static_entities(scene: Scene) -> Iterator[tuple[str, rr.AsComponents]]:
    """Yield (entity, archetype) of all that does not change: the arena, the styles, the colours of states."""
    size = np.atleast_2d(scene.robot_size) * MILLIMETRES
    yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    yield "world", rr.AnnotationContext([*shown_classes(scene), *BALL_CLASSES, *LINK_CLASSES])
    yield KEY, rr.TextDocument(legend(scene), media_type=rr.MediaType.MARKDOWN)
    corners, triangles = floor(scene)
    yield (
        f"{AREAS}/floor",
        rr.Mesh3D(vertex_positions=corners, triangle_indices=triangles, albedo_factor=rgb(palette.FLOOR)),
    )
    for boxes in arena_boxes(scene):
        yield f"{AREAS}/{boxes.name}", _boxes(boxes)
    for name, colour, shape in zip(scene.area_names, scene.area_colours, scene.area_shapes, strict=True):
        kind = rr.Cylinders3D if shape == "disc" else rr.Boxes3D
        yield f"{AREAS}/{name}", kind.from_fields(colors=colour, fill_mode="solid")
    if len(scene.boxes):
        yield rerun_names.BOXES, rr.Boxes3D.from_fields(colors=rgb(palette.BOX), fill_mode="solid")
    ids = [str(number) for number in range(max(len(scene.is_scout), len(scene.ball_radius)))]
    robots, balls = ids[: len(scene.is_scout)], ids[: len(scene.ball_radius)]
    radii, points = np.asarray(scene.ball_radius) * MILLIMETRES, rr.Radius.ui_points
    yield ROBOTS, rr.Boxes3D.from_fields(half_sizes=size / 2, fill_mode="solid", show_labels=False, labels=robots)
    yield rerun_names.FRONTS, rr.Points3D.from_fields(colors=(255, 255, 255), radii=FRONT_RADIUS * size[:, 0])
    yield BALLS, rr.Points3D.from_fields(radii=radii, show_labels=False, labels=balls)
    yield rerun_names.BALL_MARKERS, rr.Points3D.from_fields(radii=points(4.0), show_labels=False)
    yield LINKS, rr.LineStrips3D.from_fields(radii=points(0.6), show_labels=False)
    yield rerun_names.TRAILS, rr.LineStrips3D.from_fields(colors=rgb(palette.SKY), radii=points(1.2))
    for vector, colour in zip(vectors(scene.memory), cycle(_HUES)):
        yield (
            f"{rerun_names.ARROWS}/{vector.stem}",
            rr.Arrows3D.from_fields(colors=rgb(colour), radii=0.06 * scene.length * MILLIMETRES),
        )
    for entity, (name, colour) in series(scene).items():
        yield entity, rr.SeriesLines(names=name, colors=colour, widths=1.5)
