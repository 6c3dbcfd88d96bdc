"""A swarm in pictures: the scene of pages and replays, projected and drawn by Matplotlib's Agg.

Agg draws polygons without OpenGL, five times as fast as MuJoCo renders without a graphics card.
Bodies are drawn from the farthest to the nearest, so that near ones hide what is behind them.
"""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from iswarm_mj.output import shapes
from iswarm_mj.output.frames import FIXED_AREAS
from iswarm_mj.output.legend import ARROW_COLOURS, LINKS, TRAILS
from iswarm_mj.output.palette import BOX, FLOOR, SKY, Rgb, rgb
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.swarm_classes import LINK_CLASSES
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.player import scene as arrays
from iswarm_mj.player.view import aim

_DPI = 100.0
_FIELD_OF_VIEW_ABOVE = np.radians(30)
_MARGIN = 1.08
"""What the camera above shows, in edges of the arena."""
_SUN = np.array([-1.0, -2.0, 4.0]) / np.sqrt(21.0)
"""Direction of the light."""
_AMBIENT = 0.55
"""Part of the light that comes from everywhere; faces that look up have their own colour."""
_FRONT = (0.26, 0.46, 0.25)
"""Mark at a robot's front: from and to ahead, and half its width, in lengths and widths."""
_BALL_SECTIONS = 12
"""Corners of balls."""
_LINK_WIDTH = 0.08
"""Width of links and arrows, in lengths of a robot."""
_TRAIL_WIDTH = 0.1
"""Width of trails, in lengths of a robot."""
_HEAD_LENGTH = 0.25
"""Length of the heads of arrows, in lengths of a robot."""
_HEAD_HALF_WIDTH = 0.45
"""Half the width of an arrow's head, in its lengths."""
_BALL_RADIUS = 0.25
"""Mean radius of the balls as they are drawn, in lengths of a robot."""
_SQUARE = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
"""Corners of a square of half width 1, anticlockwise."""
_ANGLES = np.linspace(0, 2 * np.pi, 64, endpoint=False)
_CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
"""Corners of a disc of radius 1, so many that it looks round."""
_INK = {False: "#282c34", True: "#e8e8e8"}
_PAPER = {False: "#ffffff", True: "#1e1e1e"}
"""Colours of text and background, light and dark."""
_LEAST_TEXT = 10
"""Minimum height of text [pixels]."""
_WIDE = 1.2
"""Width over height from which on a picture is wide."""
_LEGEND_SHARE = 0.19
"""Part of the width of a picture that its legend takes, or of the height where that is larger."""


class Look(NamedTuple):
    """What pictures show beside the swarm, and how."""

    camera: str = "oblique"
    """Name of the camera, above or oblique."""
    size: tuple[int, int] = (1280, 720)
    """Width and height [pixels]."""
    colour_by: str = arrays.STATE
    """What colours robots, one of `scene.ways_to_colour`."""
    draw: tuple[str, ...] = (LINKS,)
    """Lines that are drawn: links, trails, and names of remembered vectors."""
    legend: Sequence[tuple[str, Rgb | None]] = ()
    """Labels, and the colours that they explain; no legend without any."""
    n_caption_lines: int = 3
    """Lines of the caption, for which a picture that is not wide has room above the arena."""
    is_dark: bool = False


class Camera(NamedTuple):
    """A pinhole camera."""

    position: Float[np.ndarray, "3"]
    """Place in the arena [mm]."""
    axes: Float[np.ndarray, "3 3"]
    """Unit vectors to the right, upwards and backwards, as rows."""
    focal_length: float
    """Distance of the image [pixels]."""
    centre: tuple[float, float]
    """Middle of the image, from the upper left corner [pixels]."""

    def project(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
        """Return where points [mm] are in the picture, to the right and down [pixels]."""
        right, up, back = np.moveaxis((points - self.position) @ self.axes.T, -1, 0)
        scale = self.focal_length / -back
        return np.stack([self.centre[0] + scale * right, self.centre[1] - scale * up], axis=-1)

    def distance(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Return the distances of points [mm]."""
        return np.linalg.norm(points - self.position, axis=-1)


class Painter:
    """Pictures of one world.

    Attributes:
        scene: constants of the world.
        look: camera and legend.
    """

    def __init__(self, scene: Scene, look: Look):
        """Draw what stands still and has nothing behind it: floor, dump, dust areas and legend."""
        self.scene = scene
        self.look = look
        self._frame = _frame_beside_text(look)
        self._camera = _camera_of(scene, look.camera, self._frame)
        self._length = scene.length * shapes.MILLIMETRES
        self._height = scene.height * shapes.MILLIMETRES
        self._standing = _standing_boxes(scene)

        width, height = look.size
        drawing = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
        drawing.set_facecolor(_PAPER[look.is_dark])
        self._canvas = FigureCanvasAgg(drawing)
        self._axes = drawing.add_axes((0, 0, 1, 1))
        self._axes.set(xlim=(0, width), ylim=(height, 0))
        self._axes.axis("off")
        self._text_height = _text_height(look)
        self._draw_floor()
        self._draw_legend()
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(drawing.bbox)

        self._polygons = self._add(PolyCollection([], edgecolors="none", antialiased=True))
        self._lines = self._add(LineCollection([], capstyle="round"))
        self._caption = self._axes.text(
            0.8 * self._text_height,
            0.6 * self._text_height,
            "",
            color=_INK[look.is_dark],
            fontsize=self._points(self._text_height),
            va="top",
            linespacing=1.3,
        )

    def paint(
        self, past: Sequence[Frames], share: float, caption: Sequence[str] = ()
    ) -> UInt8[np.ndarray, "height width 4"]:
        """Return the picture of a time between two control steps.

        Args:
            past: frames of one step each, of which the last two are those before and after; trails
                go back to the first.
            share: share of the step that has passed.
            caption: lines in the upper left corner.
        """
        after = past[-1]
        before = past[-2] if len(past) > 1 else after
        now = arrays.moment(self.scene, before, after, share)
        self._canvas.restore_region(self._background)

        # From the floor upwards.
        self._paint_areas(now)
        self._paint_lines(past, now)
        is_held = after.ball_state[0] == arrays.HELD
        self._paint_balls(now, ~is_held)
        self._paint_bodies(after, now)
        self._paint_balls(now, is_held)
        self._paint_arrows(after, now)

        self._caption.set_text("\n".join(caption))
        self._axes.draw_artist(self._caption)
        return np.asarray(self._canvas.buffer_rgba())

    def _add(self, artist: Any) -> Any:
        """Add an artist that is drawn for each picture."""
        artist.set_animated(True)
        return self._axes.add_collection(artist, autolim=False)

    def _points(self, pixels: float) -> float:
        """Return a height of text in points."""
        return 72 * pixels / _DPI * 0.8

    def _fill(self, polygons: Any, colours: Any) -> None:
        """Draw polygons (M, n, 2) in pixels with their colours (M, 3) from 0 to 255, in order."""
        if len(polygons) == 0:
            return
        self._polygons.set_verts(np.asarray(polygons))
        self._polygons.set_facecolor(np.asarray(colours) / 255)
        self._axes.draw_artist(self._polygons)

    def _stroke(self, ends: Float[np.ndarray, "L 2 3"], colour: Rgb, width: float) -> None:
        """Draw lines between points in the arena [mm], as wide as so many millimetres."""
        if len(ends) == 0:
            return
        self._lines.set_segments(self._camera.project(ends))
        self._lines.set_color([np.array(colour) / 255])
        pixels = width * self._pixels_per_millimetre
        self._lines.set_linewidth(72 / _DPI * max(1.0, pixels))
        self._axes.draw_artist(self._lines)

    @property
    def _pixels_per_millimetre(self) -> float:
        """Size of a millimetre in the middle of the arena [pixels]."""
        return self._camera.focal_length / float(self._camera.distance(np.zeros(3)))

    def _draw_floor(self) -> None:
        """Draw the floor, and the areas on it that do not change."""
        outline = shapes.outline(self.scene)
        corners = np.column_stack([outline, np.zeros(len(outline))])
        painted = [(corners, FLOOR)]
        for boxes in shapes.arena_boxes(self.scene):
            if boxes.name in FIXED_AREAS:
                squares = _on_floor(_SQUARE, boxes.places)
                painted += [(square, boxes.colour) for square in squares]
        for points, colour in painted:
            polygon = PolyCollection([self._camera.project(points)], facecolors=colour)
            self._axes.add_collection(polygon, autolim=False)

    def _draw_legend(self) -> None:
        """Draw labels and colours beside the arena, or below it where the picture is not wide."""
        entries = self.look.legend
        if not entries:
            return
        width, height = self.look.size
        left, top, _, frame_height = self._frame
        text_height = 0.8 * self._text_height
        is_beside = left > 0
        line = 1.6 * text_height
        if is_beside:
            column_width = left
            n_lines = len(entries)
            first = (0.8 * self._text_height, height - (n_lines + 0.5) * line)
        else:
            n_columns = 3
            column_width = width / n_columns
            n_lines = -(-len(entries) // n_columns)
            first = (0.8 * self._text_height, top + frame_height + 0.5 * line)

        for number, (label, colour) in enumerate(entries):
            column, row = divmod(number, n_lines)
            x = first[0] + column * column_width
            y = first[1] + row * line
            if colour is not None:
                spot = Rectangle((x, y), text_height, text_height, color=np.array(colour) / 255)
                self._axes.add_patch(spot)
            self._axes.text(
                x + 1.6 * text_height,
                y + 0.5 * text_height,
                label,
                color=_INK[self.look.is_dark],
                fontsize=self._points(text_height),
                va="center_baseline",
            )

    def _paint_areas(self, now: arrays.Moment) -> None:
        """Draw the areas of the task, which may change."""
        scene = self.scene
        for name, shape, colour in zip(
            scene.area_names, scene.area_shapes, scene.area_colours, strict=True
        ):
            x, y, half = now.areas[name].T
            places = np.column_stack([x, y, half, half, np.zeros(len(x))])
            outline = _CIRCLE if shape == "disc" else _SQUARE
            areas = self._camera.project(_on_floor(outline, places))
            self._fill(areas, np.tile(colour, (len(areas), 1)))

    def _paint_lines(self, past: Sequence[Frames], now: arrays.Moment) -> None:
        """Draw links and trails."""
        if LINKS in self.look.draw:
            after = past[-1]
            ends = shapes.link_ends(after, now.centre[None])
            is_heard = after.link_heard[shapes.drawn_links(after)]
            (_, _, damaged_colour), (_, _, heard_colour) = LINK_CLASSES
            width = _LINK_WIDTH * self._length
            self._stroke(ends[is_heard], heard_colour, width)
            self._stroke(ends[~is_heard], damaged_colour, width)
        if TRAILS in self.look.draw:
            trails = arrays.trails(self.scene, past)
            self._stroke(trails, rgb(SKY), _TRAIL_WIDTH * self._length)

    def _paint_arrows(self, after: Frames, now: arrays.Moment) -> None:
        """Draw the vectors that robots remember, as lines with heads."""
        ends_by_name = arrays.arrows(self.scene, after, now.centre)
        for number, (name, ends) in enumerate(ends_by_name.items()):
            if name in self.look.draw and len(ends):
                colour = ARROW_COLOURS[number % len(ARROW_COLOURS)]
                self._stroke(ends, colour, _LINK_WIDTH * self._length)
                heads = _arrow_heads(ends, _HEAD_LENGTH * self._length)
                self._fill(self._camera.project(heads), np.tile(colour, (len(heads), 1)))

    def _paint_balls(self, now: arrays.Moment, is_shown: Bool[np.ndarray, "K"]) -> None:
        """Draw some of the balls, enlarged, as discs that face the camera."""
        if not is_shown.any():
            return
        true_radius = np.asarray(self.scene.ball_radius, float)
        radius = _BALL_RADIUS * self._length * true_radius / true_radius.mean()

        # The outline of a ball of radius 1 around the origin, as the camera sees it.
        angle = np.linspace(0, 2 * np.pi, _BALL_SECTIONS, endpoint=False)[:, None]
        right, up, _ = self._camera.axes
        outline = np.cos(angle) * right + np.sin(angle) * up

        centres = now.ball[is_shown, None]
        points = centres + radius[is_shown, None, None] * outline
        self._fill(self._camera.project(points), now.ball_colour[is_shown])

    def _paint_bodies(self, after: Frames, now: arrays.Moment) -> None:
        """Draw robots, boxes, obstacles and walls, from the farthest to the nearest."""
        robots = _robot_bodies(self.scene, now)
        colours = arrays.colours(self.scene, after, self.look.colour_by)
        boxes = _Bodies(
            places=now.boxes,
            heights=np.full(len(now.boxes), self._height),
            colours=np.tile(rgb(BOX), (len(now.boxes), 1)),
        )
        bodies = _joined(robots._replace(colours=colours), boxes, self._standing)
        corners, normals = _faces(bodies)
        shades = _AMBIENT + (1 - _AMBIENT) * np.clip(normals @ _SUN / _SUN[2], 0, 1)
        face_colours = shades[..., None] * bodies.colours[:, None]

        # The mark at a robot's front is one more face, the last one, that looks up.
        marks, is_robot = _front_marks(robots, n_bodies=len(bodies.places))
        corners = np.concatenate([corners, marks[:, None]], axis=1)
        white = np.full((len(corners), 1, 3), 255.0)
        face_colours = np.concatenate([face_colours, white], axis=1)

        # A camera sees the faces that look towards it.
        to_camera = self._camera.position - corners[:, :-1].mean(axis=2)
        is_seen = np.einsum("bfi,bfi->bf", normals, to_camera) > 0
        is_seen = np.column_stack([is_seen, is_robot])

        centres = np.column_stack([bodies.places[:, :2], bodies.heights / 2])
        order = np.argsort(-self._camera.distance(centres), kind="stable")
        is_seen = is_seen[order]
        self._fill(self._camera.project(corners[order][is_seen]), face_colours[order][is_seen])


class _Bodies(NamedTuple):
    """Upright boxes on the floor."""

    places: Float[np.ndarray, "B 5"]
    """x, y, half edges [mm] and yaw [rad]."""
    heights: Float[np.ndarray, "B"]
    """Heights [mm]."""
    colours: Float[np.ndarray, "B 3"]
    """Colours from 0 to 255."""


def _joined(*bodies: _Bodies) -> _Bodies:
    """Return several sets of bodies as one."""
    return _Bodies(*(np.concatenate(parts) for parts in zip(*bodies, strict=True)))


def _robot_bodies(scene: Scene, now: arrays.Moment) -> _Bodies:
    """Return the robots, still without colours."""
    n_robots = len(now.yaw)
    size = np.broadcast_to(scene.robot_size * shapes.MILLIMETRES, (n_robots, 3))
    places = np.column_stack([now.centre[:, :2], size[:, :2] / 2, now.yaw])
    return _Bodies(places, size[:, 2], np.zeros((n_robots, 3)))


def _standing_boxes(scene: Scene) -> _Bodies:
    """Return walls and obstacles."""
    standing = [boxes for boxes in shapes.arena_boxes(scene) if boxes.name not in FIXED_AREAS]
    places = np.concatenate([boxes.places for boxes in standing])
    heights = np.concatenate([np.full(len(boxes.places), boxes.high) for boxes in standing])
    colours = [np.tile(rgb(boxes.colour), (len(boxes.places), 1)) for boxes in standing]
    return _Bodies(places, heights, np.concatenate(colours))


def _faces(
    bodies: _Bodies,
) -> tuple[Float[np.ndarray, "B 5 4 3"], Float[np.ndarray, "B 5 3"]]:
    """Return the corners of the faces of bodies, the top last, and their normals."""
    outline = _on_floor(_SQUARE, bodies.places)[..., :2]

    # Each side lies between a corner and the next one, below and above.
    n_bodies = len(outline)
    next_corner = np.roll(outline, -1, axis=1)
    faces = np.zeros((n_bodies, 5, 4, 3))
    faces[:, :4, :, :2] = np.stack([outline, next_corner, next_corner, outline], axis=2)
    faces[:, :4, 2:, 2] = bodies.heights[:, None, None]
    faces[:, 4, :, :2] = outline
    faces[:, 4, :, 2] = bodies.heights[:, None]

    along = next_corner - outline
    normals = np.zeros((n_bodies, 5, 3))
    normals[:, :4, 0] = along[..., 1]
    normals[:, :4, 1] = -along[..., 0]
    normals[:, :4] /= np.linalg.norm(normals[:, :4], axis=-1, keepdims=True)
    normals[:, 4, 2] = 1
    return faces, normals


def _front_marks(
    robots: _Bodies, n_bodies: int
) -> tuple[Float[np.ndarray, "B 4 3"], Bool[np.ndarray, "B"]]:
    """Return the marks at the fronts of the robots, the first bodies, and which bodies have one."""
    n_robots = len(robots.places)
    near, far, half_width = _FRONT
    rectangle = [(near, -half_width), (far, -half_width), (far, half_width), (near, half_width)]
    marks = np.zeros((n_bodies, 4, 3))
    marks[:n_robots] = _on_floor(2 * np.array(rectangle), robots.places)
    marks[:n_robots, :, 2] = robots.heights[:, None]
    return marks, np.arange(n_bodies) < n_robots


def _arrow_heads(ends: Float[np.ndarray, "M 2 3"], length: float) -> Float[np.ndarray, "M 3 3"]:
    """Return the heads of arrows as triangles that lie flat [mm].

    Args:
        ends: where the arrows begin and end [mm].
        length: length of the heads [mm].
    """
    tip = ends[:, 1]
    along = tip - ends[:, 0]
    distance = np.linalg.norm(along, axis=-1, keepdims=True)
    forwards = along / np.where(distance == 0, 1, distance)
    leftwards = np.cross([0.0, 0.0, 1.0], forwards)

    base = tip - length * forwards
    aside = _HEAD_HALF_WIDTH * length * leftwards
    return np.stack([tip, base + aside, base - aside], axis=1)


def _on_floor(
    outline: Float[np.ndarray, "K 2"], places: Float[np.ndarray, "B 5"]
) -> Float[np.ndarray, "B K 3"]:
    """Return an outline at places on the floor [mm].

    Args:
        outline: points ahead and to the left, in half edges.
        places: x, y, half edges [mm] and yaw [rad].
    """
    x, y, half_x, half_y, yaw = places.T[..., None]
    ahead = half_x * outline[:, 0]
    left = half_y * outline[:, 1]
    points_x = x + np.cos(yaw) * ahead - np.sin(yaw) * left
    points_y = y + np.sin(yaw) * ahead + np.cos(yaw) * left
    return np.stack([points_x, points_y, np.zeros_like(points_x)], axis=-1)


def _text_height(look: Look) -> int:
    """Return the height of the text [pixels]."""
    return max(_LEAST_TEXT, min(look.size) // 36)


def _frame_beside_text(look: Look) -> tuple[float, float, float, float]:
    """Return left, top, width and height of the part of a picture that shows the arena [pixels].

    In wide pictures the legend is on the left, and the caption above it. In others there is room
    for the caption above the arena, and for the legend below it.
    """
    width, height = look.size
    if width > _WIDE * height:
        left = _LEGEND_SHARE * width if look.legend else 0.0
        return left, 0.0, width - left, float(height)
    n_lines = look.n_caption_lines
    top = 1.3 * (n_lines + 0.5) * _text_height(look) if n_lines else 0.0
    bottom = _LEGEND_SHARE * height if look.legend else 0.0
    return 0.0, top, float(width), height - top - bottom


def _camera_of(scene: Scene, name: str, frame: tuple[float, float, float, float]) -> Camera:
    """Return the camera above, or the oblique one of pages and replays.

    Args:
        scene: constants of the world.
        name: above or oblique.
        frame: left, top, width and height of the part that shows the arena [pixels].
    """
    left, top, width, height = frame
    view = SimpleNamespace()
    if name == "above":
        view.fov = _FIELD_OF_VIEW_ABOVE
        half = _MARGIN * scene.arena_size * shapes.MILLIMETRES / 2
        distance = half / np.tan(view.fov / 2) / min(1.0, width / height)
        view.position = (0.0, 0.0, distance)
        view.look_at = (0.0, 0.0, 0.0)
    else:
        aim(view, scene, aspect=width / height)

    position = np.array(view.position, float)
    back = position - np.array(view.look_at, float)
    back /= np.linalg.norm(back)
    right = np.array([1.0, 0.0, 0.0])
    return Camera(
        position=position,
        axes=np.stack([right, np.cross(back, right), back]),
        focal_length=height / 2 / np.tan(view.fov / 2),
        centre=(left + width / 2, top + height / 2),
    )
