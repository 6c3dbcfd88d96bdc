"""A swarm in a scene of viser: nodes for what `scene` returns, of a page or of a replay."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float

from iswarm_mj.geometry.obstacles import Obstacle
from iswarm_mj.output import shapes
from iswarm_mj.output.legend import ARROW_COLOURS, LINKS, TRAILS
from iswarm_mj.output.memory_vectors import recorded_vectors
from iswarm_mj.output.palette import BOX, FLOOR, SKY, WALL, rgb
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.swarm_classes import LINK_CLASSES
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.player import scene as arrays
from iswarm_mj.player.widgets import show
from iswarm_mj.utils.units import RD

_ROOT = "/swarm"
_RING_COLOUR = (20, 20, 20)
_NO_LINE = np.zeros((1, 2, 3), np.float32)
"""A line of no length, which hides a node, since a node cannot have no lines."""
_AREA_HEIGHT = 1.5 * shapes.SHEET
"""Height of the middle of areas [mm]: sheets at the height of the dump and the dust areas."""
_GRAIN = 64
"""Parts of a millimetre, and of 1, that replays tell apart."""

_FIELD_OF_VIEW = np.radians(35)
_FROM_ABOVE = (0.0, -0.5, 0.866)
"""Direction from the arena to a camera that looks at all of it."""
_FROM_THE_SIDE = (0.0, -0.93, 0.37)
_MARGIN = 0.53
"""Half edge of the square that a camera shows, in edges of the arena."""


class SwarmView:
    """Nodes of one world.

    Attributes:
        scene: constants of the world.
        colour_by: what colours robots, one of `scene.ways_to_colour`.
        shows: which of `links`, `trails` and the names of vectors are drawn.
        root: parent of all nodes.
        nodes: nodes of the robots, hulls and fronts.
        selected: robot with a ring; None for none.
        is_coarse: numbers are rounded, and lines drawn after whole steps alone, so that replays
            are small.
    """

    def __init__(self, drawn: Any, scene: Scene):
        """Draw what stands still, and make nodes for what moves.

        Args:
            drawn: scene of a viser server.
            scene: constants of the world.
        """
        self.scene = scene
        self.colour_by = arrays.STATE
        self.shows = {LINKS}
        self.selected: int | None = None
        self.is_coarse = False
        self._drawn = drawn
        self._drawn_state: tuple[Any, ...] | None = None
        self._length = scene.length * shapes.MILLIMETRES
        self._height = scene.height * shapes.MILLIMETRES

        drawn.remove_by_name(_ROOT)
        self.root = drawn.add_frame(_ROOT, show_axes=False)
        floor = shapes.floor(scene)
        drawn.add_mesh_simple(f"{_ROOT}/floor", *floor, color=rgb(FLOOR), side="double")
        self._draw_standing()
        self.nodes = self._add_robots()
        self._balls = self._add_balls()
        self._boxes = self._add_boxes()
        self._areas = self._add_areas()
        self._lines = self._add_lines()
        self._arrows = self._add_arrows()
        self._planned = self._batch("planned", self._box(), 0, rgb(WALL), opacity=0.4)
        self._ring = self._add_ring()

    def _add_robots(self) -> dict[str, Any]:
        """Add a hull for each robot, and a mark at its front; both are scaled by its size."""
        n_robots = len(self.scene.is_alive)
        front = trimesh.creation.box((0.2, 0.5, 0.1))
        front.apply_translation((0.36, 0, 0.5))
        size = np.float32(self.scene.robot_size * shapes.MILLIMETRES)
        sizes = np.broadcast_to(size, (n_robots, 3))
        hull = trimesh.creation.box((1, 1, 1))
        return {
            "robots": self._batch("robots", hull, n_robots, (0, 0, 0), batched_scales=sizes),
            "fronts": self._batch("fronts", front, n_robots, (255, 255, 255), batched_scales=sizes),
        }

    def _add_balls(self) -> Any:
        """Add the balls, which are drawn enlarged; None where there are none."""
        radii = np.asarray(self.scene.ball_radius, np.float32)
        if not len(radii):
            return None
        ball = trimesh.creation.icosphere(1, 0.25 * self._length)
        scales = radii / radii.mean()
        return self._batch("balls", ball, len(radii), (0, 0, 0), batched_scales=scales)

    def _add_boxes(self) -> Any:
        """Add a node for the boxes that robots push; None where there are none."""
        if not len(self.scene.boxes):
            return None
        return self._batch("boxes", self._box(), 0, rgb(BOX))

    def _add_areas(self) -> dict[str, Any]:
        """Add a node for the areas of each kind that may change in a control step."""
        scene = self.scene
        nodes = {}
        for name, shape, colour in zip(
            scene.area_names,
            scene.area_shapes,
            scene.area_colours,
            strict=True,
        ):
            nodes[name] = self._batch(f"areas/{name}", _flat(shape), 0, colour)
        return nodes

    def _add_lines(self) -> dict[str, Any]:
        """Add nodes for links and trails, whose lines are as thick at any distance."""
        (_, _, damaged), (_, _, heard) = LINK_CLASSES
        colours = {"heard": heard, "damaged": damaged, "trails": rgb(SKY)}
        return {
            name: self._drawn.add_line_segments(
                f"{_ROOT}/{name}", _NO_LINE, colour, thickness=1.5, thickness_units="screen"
            )
            for name, colour in colours.items()
        }

    def _add_arrows(self) -> dict[str, Any]:
        """Add nodes for the arrows of each vector that robots remember."""
        nodes = {}
        for k, vector in enumerate(recorded_vectors(self.scene.memory)):
            colour = np.array(ARROW_COLOURS[k % len(ARROW_COLOURS)], np.uint8)
            nodes[vector.stem] = self._drawn.add_arrows(
                f"{_ROOT}/{vector.stem}",
                _NO_LINE,
                linear(colour),
                shaft_radius=0.04 * self._length,
                head_radius=0.12 * self._length,
                head_length=0.25 * self._length,
            )
        return nodes

    def _add_ring(self) -> Any:
        """Add the ring around the selected robot, which is hidden at first."""
        ring = trimesh.creation.annulus(0.85 * self._length, 1.0 * self._length, 0.1)
        return self._drawn.add_mesh_simple(
            f"{_ROOT}/ring", ring.vertices, ring.faces, color=_RING_COLOUR, visible=False
        )

    def _box(self) -> trimesh.Trimesh:
        """Return a box as high as a robot, with half edges of 1 mm."""
        return trimesh.creation.box((2, 2, self._height))

    def _batch(
        self,
        name: str,
        mesh: trimesh.Trimesh,
        n_instances: int,
        colour: tuple[int, int, int],
        **more: Any,
    ) -> Any:
        """Add a node with instances of a mesh, which all have one colour until each has its own."""
        turns = np.tile(np.array([1, 0, 0, 0], np.float32), (n_instances, 1))
        places = np.zeros((n_instances, 3), np.float32)
        return self._drawn.add_batched_meshes_simple(
            f"{_ROOT}/{name}",
            mesh.vertices,
            mesh.faces,
            turns,
            places,
            batched_colors=linear(np.array(colour, np.uint8)),
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
            flat_shading=True,
            **more,
        )

    def follow(self, scene: Scene) -> None:
        """Take in the constants of the world after settings have changed.

        The dump and the dust areas are drawn again where they have moved.

        Args:
            scene: constants of the same world.
        """
        if scene is self.scene:
            return
        before = self.scene
        self.scene = scene
        if arrays.areas_differ(before, scene):
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
    def drawable(self) -> tuple[str, ...]:
        """Names of the lines and arrows that can be drawn."""
        return (LINKS, TRAILS, *self._arrows)

    def draw(self, name: str, *, is_drawn: bool) -> None:
        """Draw lines or arrows from now on, or no longer."""
        self.shows = self.shows | {name} if is_drawn else self.shows - {name}

    def place_of(self, robot: int) -> Float[np.ndarray, "2"]:
        """Return where a robot is drawn: x, y [mm]."""
        return np.array(self.nodes["robots"].batched_positions[robot, :2])

    def draw_planned(self, obstacles: Sequence[Obstacle]) -> None:
        """Draw obstacles that wait for a reset, as shadows of themselves."""
        places = np.array(obstacles, float).reshape(-1, 5) * [RD, RD, RD, RD, np.pi / 180]
        _lay(self._planned, places, self._height / 2)

    def show(
        self,
        past: Sequence[Frames],
        share: float,
        energy: Float[np.ndarray, "N"] | None = None,
    ) -> None:
        """Draw a time between two control steps.

        Args:
            past: frames of one step each, of which the last two are those before and after.
            share: share of the step that has passed.
            energy: energy in the robots' capacitors [J], where they have some.
        """
        after = past[-1]
        before = past[-2] if len(past) > 1 else after
        now = arrays.moment(self.scene, before, after, share)
        self._draw_bodies(now)
        if not self.is_coarse or share in (0, 1):
            self._draw_lines(past, now)
        self._draw_ring(now)

        # What follows changes with the control step, or with what is chosen on the page.
        step = int(after.step[0])
        state = (step, self.colour_by, frozenset(self.shows), after.is_alive.tobytes())
        if state != self._drawn_state:
            self._drawn_state = state
            self._draw_step(after, now, energy)

    def _draw_bodies(self, now: arrays.Moment) -> None:
        """Draw robots, balls and boxes where they are."""
        half_yaw = now.yaw / 2
        zero = np.zeros_like(now.yaw)
        turns = np.stack([np.cos(half_yaw), zero, zero, np.sin(half_yaw)], axis=-1)
        for node in self.nodes.values():
            node.batched_positions = self._rounded(now.centre)
            node.batched_wxyzs = self._rounded(turns)
        if self._balls is not None:
            self._balls.batched_positions = self._rounded(now.ball)
        if self._boxes is not None:
            _lay(self._boxes, now.boxes, self._height / 2)

    def _draw_lines(self, past: Sequence[Frames], now: arrays.Moment) -> None:
        """Draw links and trails."""
        lines = {name: _NO_LINE for name in self._lines}
        if LINKS in self.shows:
            after = past[-1]
            ends = shapes.link_ends(after, now.centre[None])
            is_heard = after.link_heard[shapes.drawn_links(after)]
            lines["heard"] = ends[is_heard]
            lines["damaged"] = ends[~is_heard]
        if TRAILS in self.shows:
            lines["trails"] = arrays.trails(self.scene, past)
        for name, node in self._lines.items():
            points = lines[name] if len(lines[name]) else _NO_LINE
            show(node, "points", self._rounded(points))

    def _draw_ring(self, now: arrays.Moment) -> None:
        """Draw the ring around the selected robot, if there is one."""
        is_visible = self.selected is not None
        if self._ring.visible != is_visible:
            self._ring.visible = is_visible
        if self.selected is not None:
            x, y, _ = now.centre[self.selected]
            self._ring.position = (x, y, 0.1)

    def _draw_step(
        self,
        after: Frames,
        now: arrays.Moment,
        energy: Float[np.ndarray, "N"] | None,
    ) -> None:
        """Draw what changes from control step to control step: colours, arrows and areas.

        Args:
            after: frame after the step.
            now: places and colours at the present time, up to the end of the step.
            energy: energy in the robots' capacitors [J], where they have some.
        """
        robot_colours = arrays.colours(self.scene, after, self.colour_by, energy)
        self.nodes["robots"].batched_colors = linear(robot_colours)
        if self._balls is not None:
            self._balls.batched_colors = linear(now.ball_colour)

        ends = arrays.arrows(self.scene, after, now.centre)
        for vector, node in self._arrows.items():
            is_shown = vector in self.shows and len(ends[vector]) > 0
            show(node, "points", ends[vector] if is_shown else _NO_LINE)

        for name, node in self._areas.items():
            x, y, half_width = now.areas[name].T
            yaw = np.zeros_like(x)
            places = np.column_stack([x, y, half_width, half_width, yaw])
            _lay(node, places, _AREA_HEIGHT)

    def _rounded(self, values: np.ndarray) -> np.ndarray:
        """Return values as they are, or rounded where the view is coarse."""
        if not self.is_coarse:
            return values
        return np.round(values * _GRAIN) / np.float32(_GRAIN)


def _flat(shape: str) -> trimesh.Trimesh:
    """Return an area of half width or radius 1 mm."""
    if shape == "disc":
        return trimesh.creation.cylinder(1.0, shapes.SHEET, sections=48)
    return trimesh.creation.box((2.0, 2.0, shapes.SHEET))


def _lay(node: Any, places: Float[np.ndarray, "M 5"], z: float) -> None:
    """Put the instances of a node, squares or discs of half width 1 mm, at some places.

    Args:
        node: node of viser, with instances.
        places: x, y, half widths [mm] and yaw [rad] of each instance.
        z: height of their middles [mm].
    """
    x, y, half_x, half_y, yaw = places.T
    zero = np.zeros_like(x)
    positions = np.column_stack([x, y, zero + z])
    turns = np.column_stack([np.cos(yaw / 2), zero, zero, np.sin(yaw / 2)])
    scales = np.column_stack([half_x, half_y, zero + 1])
    show(node, "batched_positions", positions)
    show(node, "batched_wxyzs", turns)
    show(node, "batched_scales", scales)


def linear(colours: np.ndarray) -> np.ndarray:
    """Return colours of a screen as linear ones, for which viser 1.1 takes those of instances."""
    return np.rint(255 * (colours / 255) ** 2.2).astype(np.uint8)


def light(drawn: Any) -> None:
    """Set lights by which colours look as in the palette, and no more."""
    drawn.configure_default_lights(enabled=False)
    drawn.configure_environment_map(hdri=None)
    drawn.add_light_ambient("/lights/ambient", intensity=2.2)
    drawn.add_light_directional("/lights/sun", intensity=1.3, position=(-1.0, -2.0, 4.0))


def aim(camera: Any, scene: Scene, aspect: float = 4 / 3, *, is_low: bool = False) -> None:
    """Point a camera at the whole arena, or from the side at what stands in its middle.

    Args:
        camera: camera of a browser, or the initial one of a server.
        scene: constants of the world.
        aspect: width of the picture over its height.
        is_low: look at the middle from the side.
    """
    size = scene.arena_size * shapes.MILLIMETRES
    camera.fov = _FIELD_OF_VIEW
    if is_low:
        target = (0, 0, 0.12 * size)
        backwards = np.array(_FROM_THE_SIDE)
        distance = 0.9 * size
    else:
        target = (0, -0.06 * size, 0)
        backwards = np.array(_FROM_ABOVE)
        distance = _distance_to_see_all(size, target, -backwards, aspect)
    camera.position = tuple(target + distance * backwards)  # this also moves what a camera looks at
    camera.look_at = target


def _distance_to_see_all(
    size: float,
    target: tuple[float, float, float],
    ahead: Float[np.ndarray, "3"],
    aspect: float,
) -> float:
    """Return the distance from its target at which a camera sees all corners of the arena [mm].

    Args:
        size: edge of the arena [mm].
        target: point that the camera looks at [mm].
        ahead: unit vector in which it looks; x is to the right in the picture.
        aspect: width of the picture over its height.
    """
    corners = _MARGIN * size * np.array([(x, y, 0) for x in (-1, 1) for y in (-1, 1)]) - target
    right = np.array([1.0, 0, 0])
    up = np.cross(right, ahead)

    # Half the height of the picture at distance 1; a corner that is nearer needs more of it.
    half_height = np.tan(_FIELD_OF_VIEW / 2)
    across = np.abs(corners @ right) / (aspect * half_height)
    along = np.abs(corners @ up) / half_height
    return float(max(np.maximum(across, along) - corners @ ahead))
