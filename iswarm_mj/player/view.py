"""A swarm in a scene of viser: nodes for what `scene` returns, of a page or of a replay."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float

from iswarm_mj.geometry.obstacles import Obstacle
from iswarm_mj.output import shapes
from iswarm_mj.output.frames import FIXED_AREAS
from iswarm_mj.output.memory_vectors import recorded_vectors
from iswarm_mj.output.palette import BOX, FLOOR, GREEN, PINK, SKY, WALL, YELLOW, rgb
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.player import scene as arrays
from iswarm_mj.player.widgets import show
from iswarm_mj.utils.units import RD

_ROOT = "/swarm"
_HEARD = (95, 95, 105)
_FLAT = np.zeros((1, 2, 3), np.float32)
"""A line of no length, since a node cannot have none."""
_GRAIN = 64
"""Parts of a millimetre, and of 1, that replays tell apart."""


class SwarmView:
    """Nodes of one world.

    Attributes:
        by: what colours robots, one of `scene.ways_to_colour`.
        shows: which of `links`, `trails` and the names of vectors are drawn.
        root: node of all.
        nodes: of the robots, hulls and fronts.
        selected: robot with a ring; None for none.
        is_coarse: numbers are rounded, and lines drawn after whole steps alone, so that replays are small.
    """

    def __init__(self, drawn: Any, scene: Scene):
        """Draw what stands still.

        Args:
            drawn: scene of a viser server.
            scene: constants of the world.
        """
        self.scene, self.by, self.shows, self.selected = scene, arrays.STATE, {"links"}, None
        self.is_coarse = False
        self._drawn, self._step = drawn, None
        drawn.remove_by_name(_ROOT)
        self.root = drawn.add_frame(_ROOT, show_axes=False)
        drawn.add_mesh_simple(f"{_ROOT}/floor", *shapes.floor(scene), color=rgb(FLOOR), side="double")
        self._draw_standing()
        length, height = scene.length * shapes.MILLIMETRES, scene.height * shapes.MILLIMETRES
        self._height, n, k = height, len(scene.is_alive), len(scene.ball_radius)
        front = trimesh.creation.box((0.2, 0.5, 0.1))
        front.apply_translation((0.36, 0, 0.5))
        sizes = np.broadcast_to(np.float32(scene.robot_size * shapes.MILLIMETRES), (n, 3))
        self.nodes = {
            "robots": self._batch("robots", trimesh.creation.box((1, 1, 1)), n, (0, 0, 0), batched_scales=sizes),
            "fronts": self._batch("fronts", front, n, (255, 255, 255), batched_scales=sizes),
        }
        ball, radii = trimesh.creation.icosphere(1, 0.25 * length), np.float32(scene.ball_radius)
        self._balls = self._batch("balls", ball, k, (0, 0, 0), batched_scales=radii / radii.mean()) if k else None
        self._boxes = (
            self._batch("boxes", trimesh.creation.box((2, 2, height)), 0, rgb(BOX)) if len(scene.boxes) else None
        )
        self._areas = {
            name: self._batch(f"areas/{name}", _flat(shape), 0, colour)
            for name, shape, colour in zip(scene.area_names, scene.area_shapes, scene.area_colours, strict=True)
        }
        lines = {"heard": _HEARD, "damaged": rgb(PINK), "trails": rgb(SKY)}
        self._lines = {
            name: drawn.add_line_segments(f"{_ROOT}/{name}", _FLAT, colour, thickness=1.5, thickness_units="screen")
            for name, colour in lines.items()
        }
        hues = (SKY, YELLOW, GREEN, PINK)
        self._arrows = {
            vector.stem: drawn.add_arrows(
                f"{_ROOT}/{vector.stem}",
                _FLAT,
                linear(np.array(rgb(hues[k % len(hues)]), np.uint8)),
                shaft_radius=0.04 * length,
                head_radius=0.12 * length,
                head_length=0.25 * length,
            )
            for k, vector in enumerate(recorded_vectors(scene.memory))
        }
        self._wished = self._batch("wished", trimesh.creation.box((2, 2, height)), 0, rgb(WALL), opacity=0.4)
        ring = trimesh.creation.annulus(0.85 * length, 1.0 * length, 0.1)
        self._ring = drawn.add_mesh_simple(
            f"{_ROOT}/ring", ring.vertices, ring.faces, color=(20, 20, 20), visible=False
        )

    def follow(self, scene: Scene) -> None:
        """Take in the constants of the world after settings have changed, and draw its dump and dust areas anew.

        Args:
            scene: of the same world.
        """
        if scene is self.scene:
            return
        before, self.scene = self.scene, scene
        is_moved = [not np.array_equal(getattr(before, name), getattr(scene, name)) for name in FIXED_AREAS]
        if any(is_moved):
            self._draw_standing()

    def _draw_standing(self) -> None:
        """Draw walls, dump, dust areas and obstacles."""
        for boxes in shapes.arena_boxes(self.scene):
            for k, (x, y, half_x, half_y, yaw) in enumerate(boxes.places):
                self._drawn.add_box(
                    f"{_ROOT}/{boxes.name}/{k}",
                    color=rgb(boxes.colour),
                    dimensions=(2 * half_x, 2 * half_y, boxes.high - boxes.low),
                    position=(x, y, (boxes.high + boxes.low) / 2),
                    wxyz=(np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)),
                    cast_shadow=False,
                )

    @property
    def vectors(self) -> list[str]:
        """Names of the vectors that can be drawn."""
        return list(self._arrows)

    def toggle(self, name: str) -> None:
        """Draw what was not drawn, or no longer what was."""
        self.shows = self.shows ^ {name}

    def wish(self, obstacles: Sequence[Obstacle]) -> None:
        """Draw obstacles that wait for a reset, as shadows of themselves."""
        places = np.array(obstacles, float).reshape(-1, 5) * [RD, RD, RD, RD, np.pi / 180]
        _lay(self._wished, places, self._height / 2)

    def _batch(self, name: str, mesh: trimesh.Trimesh, n: int, colour: tuple[int, int, int], **more: Any) -> Any:
        turns, places = np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)), np.zeros((n, 3), np.float32)
        colours = linear(np.array(colour, np.uint8))  # one for all, until each has its own
        return self._drawn.add_batched_meshes_simple(
            f"{_ROOT}/{name}", mesh.vertices, mesh.faces, turns, places, batched_colors=colours, lod="off",
            cast_shadow=False, receive_shadow=False, flat_shading=True, **more,
        )  # fmt: skip

    def show(
        self,
        past: Sequence[Frames],
        share: float,
        energy: Float[np.ndarray, "N"] | None = None,
    ) -> None:
        """Draw a time between two control steps.

        Args:
            past: frames of one step each, of which the last two are those before and after.
            share: of the step that has passed.
            energy: in the robots' capacitors [J], where there are some.
        """
        scene, after = self.scene, past[-1]
        now = arrays.moment(scene, past[-2] if len(past) > 1 else after, after, share)
        half, zero = now.yaw / 2, np.zeros_like(now.yaw)
        turns = np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)
        for node in self.nodes.values():
            node.batched_positions, node.batched_wxyzs = self._rounded(now.centre), self._rounded(turns)
        if self._balls is not None:
            self._balls.batched_positions = self._rounded(now.ball)
        if self._boxes is not None:
            _lay(self._boxes, now.boxes, self._height / 2)
        if not self.is_coarse or share in (0, 1):
            self._draw_lines(past, now)
        if self._ring.visible != (self.selected is not None):
            self._ring.visible = self.selected is not None
        if self.selected is not None:
            self._ring.position = (*now.centre[self.selected, :2], 0.1)
        key = (int(after.step[0]), self.by, frozenset(self.shows), after.is_alive.tobytes())
        if key == self._step:
            return
        self._step = key
        self.nodes["robots"].batched_colors = linear(arrays.colours(scene, after, self.by, energy))
        if self._balls is not None:
            self._balls.batched_colors = linear(now.ball_colour)
        ends = arrays.arrows(scene, after, now.centre)
        for stem, node in self._arrows.items():
            is_shown = stem in self.shows and len(ends[stem]) > 0
            show(node, "points", ends[stem] if is_shown else _FLAT)
        for name, node in self._areas.items():
            places = now.areas[name]
            _lay(node, np.column_stack([places, places[:, 2], np.zeros(len(places))]), 1.5 * shapes.SHEET)

    def _draw_lines(self, past: Sequence[Frames], now: arrays.Moment) -> None:
        """Links and trails."""
        lines = {name: _FLAT for name in self._lines}
        if "links" in self.shows:
            ends, heard = shapes.link_ends(past[-1], now.centre[None]), past[-1].link_heard[past[-1].link_valid]
            lines |= {"heard": ends[heard], "damaged": ends[~heard]}
        if "trails" in self.shows:
            lines["trails"] = arrays.trails(self.scene, past)
        for name, node in self._lines.items():
            show(node, "points", self._rounded(lines[name] if len(lines[name]) else _FLAT))

    def _rounded(self, values: np.ndarray) -> np.ndarray:
        return np.round(values * _GRAIN) / np.float32(_GRAIN) if self.is_coarse else values


def _flat(shape: str) -> trimesh.Trimesh:
    """An area of half width or radius 1."""
    if shape == "disc":
        return trimesh.creation.cylinder(1.0, shapes.SHEET, sections=48)
    return trimesh.creation.box((2.0, 2.0, shapes.SHEET))


def _lay(node: Any, places: Float[np.ndarray, "M 5"], z: float) -> None:
    """Put the instances of a node, squares or discs of half width 1, at x, y, half widths [mm] and yaws [rad]."""
    x, y, half_x, half_y, yaw = places.T
    zero = np.zeros_like(x)
    show(node, "batched_positions", np.column_stack([x, y, zero + z]))
    show(node, "batched_wxyzs", np.column_stack([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)]))
    show(node, "batched_scales", np.column_stack([half_x, half_y, zero + 1]))


def linear(colours: np.ndarray) -> np.ndarray:
    """Return colours of instances and arrows, which viser 1.1 takes for linear ones and not for those of a screen."""
    return np.rint(255 * (colours / 255) ** 2.2).astype(np.uint8)


def light(drawn: Any) -> None:
    """Set lights by which colours look as in the palette, and no more."""
    drawn.configure_default_lights(enabled=False)
    drawn.configure_environment_map(hdri=None)
    drawn.add_light_ambient("/lights/ambient", intensity=2.2)
    drawn.add_light_directional("/lights/sun", intensity=1.3, position=(-1.0, -2.0, 4.0))


def aim(camera: Any, scene: Scene, aspect: float = 4 / 3, is_low: bool = False) -> None:
    """Point a camera at the whole arena, or from the side at what stands in its middle.

    Args:
        camera: of a browser, or the initial one of a server.
        scene: constants of the world.
        aspect: width of the picture over its height.
        is_low: look at the middle from the side.
    """
    size = scene.arena_size * shapes.MILLIMETRES
    target, from_ = ((0, 0, 0.12 * size), (0, -0.93, 0.37)) if is_low else ((0, -0.06 * size, 0), (0, -0.5, 0.866))
    camera.fov = np.radians(35)
    right, ahead = np.array([1.0, 0, 0]), -np.array(from_)
    corners = 0.53 * size * np.array([(x, y, 0) for x in (-1, 1) for y in (-1, 1)]) - target
    high = np.tan(camera.fov / 2)  # of what is seen, over its distance
    needed = np.maximum(np.abs(corners @ right) / (aspect * high), np.abs(corners @ np.cross(right, ahead)) / high)
    away = 0.9 * size if is_low else float(max(needed - corners @ ahead))
    camera.position = tuple(target - away * ahead)  # which moves what a camera looks at
    camera.look_at = target
