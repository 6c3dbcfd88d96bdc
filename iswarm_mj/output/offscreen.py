"""Pictures of the arena of a recorded run, rendered off-screen by MuJoCo."""

import importlib
import os
import sys
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.robot_file import as_robot_file
from iswarm_mj.geometry.robot import RobotFile
from iswarm_mj.output.loading import SavedRun, load, scene_of
from iswarm_mj.output.palette import DUMP, DUST, FLOOR, rgb
from iswarm_mj.output.shapes import floor
from iswarm_mj.output.swarm_classes import robot_classes, shown_classes
from iswarm_mj.output.trajectory import AREA, SCENE, Arrays, Scene
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, check_name, make_output_directory
from iswarm_mj.utils.units import MM, mm_from_m, mm_from_rd

BALL_SCALE = 15.0
"""Magnification of the balls, since 20 um are invisible beside 139 mm."""
PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")
"""Suffixes of the names of pictures."""
DEFAULT_STEP = 100
"""Control step of a picture by default."""
MARGIN = 1.06
"""Ratio of what the oblique camera shows to the size of the arena."""
_SHEET_HALF_HEIGHT = 0.002
"""Half the height of what is painted on the floor [mm]."""
_HIDDEN_SIZE = 1e-6
"""Size of bodies that are not to be seen [mm]."""
_GEOMS_OF_AREAS = {"dump": ("dump",), "dust_areas": ("dust_west", "dust_east")}
"""Names of the model's geoms that show the areas of `Scene`."""


class Shot(NamedTuple):
    """Camera, size and quality of a picture."""

    camera: str = "above"
    """Name of a camera in `models/arena.xml`."""
    size: tuple[int, int] = (1280, 1280)
    """Width and height [pixels]."""
    fine: bool = True
    """Shadows and round shapes; without them a frame takes a tenth of the time on a CPU."""


def load_recorded(directory: Path) -> SavedRun:
    """Return a run with a recorded world; if it was interrupted, print so to the standard error.

    Raises:
        UserError: the directory holds no recorded run, or a damaged one.
    """
    run = load(directory)
    last_step = run.arrays["step"][-1]
    if run.result.get("interrupted"):
        print(
            f"iswarm: the run in {directory} was interrupted after step {last_step}.",
            file=sys.stderr,
        )
    return run


class _PaintedArea(NamedTuple):
    """Areas of a task that are painted on the floor."""

    array: str
    """Name of their array in a trajectory."""
    is_disc: bool
    colour: Float[np.ndarray, "4"]
    """Red, green, blue and opacity, 0 to 1."""


class ArenaRenderer:
    """The arena of a run before a camera; a context manager, since it holds off-screen OpenGL.

    Attributes:
        arena: the compiled model of the arena, with robots and balls.
        data: state of the model.
    """

    def __init__(
        self, config: SwarmConfig, frames: Arrays, shot: Shot, robot_file: RobotFile = None
    ):
        """Compile the arena and start OpenGL.

        Args:
            config: configuration of the arena.
            frames: arrays of the run's trajectory.
            shot: camera, size and quality.
            robot_file: MJCF file of the robots, or of each kind (`RobotFile`), by default
                `models/robot.xml`.

        Raises:
            UserError: the file of the robots has changed, there is no such camera, or no off-screen
                OpenGL.
        """
        self._scene = scene_of(frames)
        self._camera = shot.camera
        self.arena = _compile(config, frames, self._scene, robot_file)
        model = self.arena.model
        _check_camera(model, shot.camera)
        self._paint(frames)
        self._areas = _painted_areas(frames)
        self.data = mujoco.MjData(model)

        if not shot.fine:
            model.vis.quality.numslices = 8
            model.vis.quality.numstacks = 4
            model.vis.quality.offsamples = 4
        model.vis.global_.offwidth, model.vis.global_.offheight = shot.size
        if shot.camera == "oblique":
            _step_back(model, self.data, shot, half=mm_from_rd(config.arena.size) / 2)
        n_painted = sum(frames[area.array].shape[1] for area in self._areas)
        self._renderer = _start_renderer(model, shot.size, max_geom=model.ngeom + n_painted)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shot.fine

    def __enter__(self) -> "ArenaRenderer":
        """Return the renderer."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Release OpenGL."""
        self._renderer.close()

    @property
    def visual_scene(self) -> Any:
        """The `mujoco.MjvScene` that was rendered last."""
        return self._renderer.scene

    def show(
        self, frames: Arrays, step: int, part: float = 0.0
    ) -> UInt8[np.ndarray, "height width 3"]:
        """Return the pixels of robots, balls, boxes and areas of the task after a control step.

        Args:
            frames: arrays of a trajectory.
            step: control step, from 0 for the start.
            part: fraction of the next step that has passed, in which bodies move straight.
        """
        self._place_bodies(frames, step, part)
        self._colour_robots(frames["is_loaded"][step])
        model = self.arena.model
        mujoco.mj_kinematics(model, self.data)
        mujoco.mj_comPos(model, self.data)
        mujoco.mj_camlight(model, self.data)
        self._renderer.update_scene(self.data, self._camera)
        self._add_areas(frames, step)
        return self._renderer.render()

    def _paint(self, frames: Arrays) -> None:
        """Enlarge the balls, colour dump and dust as in recordings, and hide missing ones."""
        model = self.arena.model
        for ball in range(len(self.arena.mocap)):
            model.geom(f"ball{ball}/ball").size[0] *= BALL_SCALE
        for material, colour in (("dump", DUMP), ("dust", DUST)):
            model.material(material).rgba[:3] = _fractions(rgb(colour))
        for field, geoms in _GEOMS_OF_AREAS.items():
            if not np.any(frames[SCENE + field]):
                for geom in geoms:
                    model.geom(geom).size[:] = _HIDDEN_SIZE

    def _place_bodies(self, frames: Arrays, step: int, part: float) -> None:
        """Place robots, boxes and balls, see `show`."""
        robots = _interpolated(frames["pose"], step, part)
        boxes = _interpolated(frames["box_pose"], step, part)
        balls = _interpolated(frames["ball_position"], step, part)
        bodies = np.concatenate([robots, boxes])
        positions = np.column_stack([mm_from_m(bodies[:, :2]), bodies[:, 2]])
        self.data.qpos[self.arena.qpos] = positions
        self.data.mocap_pos[self.arena.mocap] = mm_from_m(balls)

    def _colour_robots(self, is_loaded: Any) -> None:
        """Colour the robots by their classes, without the shade for priority.

        Robots may be loaded although there are no balls, so classes of loaded robots are always
        needed.
        """
        scene_with_balls = self._scene._replace(ball_radius=np.zeros(1))
        colours = {
            number: _fractions(colour) for number, _, colour in shown_classes(scene_with_balls)
        }
        class_of_robot = robot_classes(self._scene, is_loaded, np.zeros_like(is_loaded))
        for robot, number in enumerate(class_of_robot.tolist()):
            geom = self.arena.model.geom(f"robot{robot}/substrate")
            geom.rgba[:3] = colours[number]

    def _add_areas(self, frames: Arrays, step: int) -> None:
        """Add the areas of the task to the scene that is rendered."""
        scene = self._renderer.scene
        identity = np.eye(3).ravel()
        for array, is_disc, colour in self._areas:
            for x, y, half in mm_from_m(frames[array][step].astype(float)):
                if is_disc:
                    shape = mujoco.mjtGeom.mjGEOM_CYLINDER
                    size = [half, _SHEET_HALF_HEIGHT, 0.0]
                else:
                    shape = mujoco.mjtGeom.mjGEOM_BOX
                    size = [half, half, _SHEET_HALF_HEIGHT]
                centre = [x, y, -_SHEET_HALF_HEIGHT]
                geom = scene.geoms[scene.ngeom]
                mujoco.mjv_initGeom(geom, shape, size, centre, identity, colour)
                scene.ngeom += 1


def _compile(config: SwarmConfig, frames: Arrays, scene: Scene, robot_file: RobotFile) -> Any:
    """Return the compiled arena of a run, for the robots of a file.

    Raises:
        UserError: the robots cannot be drawn, or are not as large as those of the run.
    """
    n_robots = frames["pose"].shape[1]
    name_of_file = robot_file or "models/robot.xml"
    tune = partial(_lay_floor, scene) if config.arena.outline else None
    try:
        arena = compile_arena(
            config,
            n_robots,
            frames["scene_ball_radius"],
            visual=True,
            tune=tune,
            robot_file=as_robot_file(robot_file),
        )
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise UserError(f"the robots of {name_of_file} cannot be drawn ({reason})") from None

    size = 2 * MM * arena.robot.each("half_edges", n_robots)
    recorded = np.broadcast_to(frames["scene_robot_size"], size.shape)
    differs = ~np.isclose(recorded, size, rtol=1e-6).all(axis=1)
    if differs.any():
        first = differs.argmax()
        raise UserError(
            f"the robots of {name_of_file} must be as large as those of the run, "
            f"{recorded[first]} m (got {size[first]} m); restore the file, or run again."
        )
    return arena


def _check_camera(model: Any, camera: str) -> None:
    """Raise a UserError if the arena has no camera of this name; those of robots do not count."""
    names = [model.camera(number).name for number in range(model.ncam)]
    cameras = [name for name in names if "/" not in name]
    check("camera", camera, " or ".join(cameras), camera in cameras)


def _painted_areas(frames: Arrays) -> list[_PaintedArea]:
    """Return the areas of the task."""
    names = frames["scene_area_names"].tolist()
    colours = frames["scene_area_colours"].tolist()
    shapes = frames["scene_area_shapes"].tolist()
    return [
        _PaintedArea(AREA + name, shape == "disc", np.array([*colour, 255], np.float32) / 255)
        for name, colour, shape in zip(names, colours, shapes, strict=True)
    ]


def _fractions(colour: tuple[int, int, int]) -> Float[np.ndarray, "3"]:
    """Return red, green and blue from 0 to 1."""
    return np.array(colour) / 255


def _interpolated(
    values: Float[np.ndarray, "T *shape"], step: int, part: float
) -> Float[np.ndarray, "*shape"]:
    """Return values at a fraction of the way from a step to the next."""
    start = values[step].astype(float)
    if part == 0:  # the last step has no next one
        return start
    return start + part * (values[step + 1] - start)


def _lay_floor(scene: Scene, spec: mujoco.MjSpec) -> None:
    """Replace the rectangular floor, a plane, by one that ends at the walls.

    It is a prism, the hull of its vertices.
    """
    vertices, _ = floor(scene)
    top = vertices - [0, 0, 2 * _SHEET_HALF_HEIGHT]
    bottom = top - [0, 0, 1]
    spec.add_mesh(name="floor", uservert=np.concatenate([top, bottom]).ravel())
    geom = spec.geom("floor")
    geom.type = mujoco.mjtGeom.mjGEOM_MESH
    geom.meshname = "floor"
    geom.pos = [0, 0, 0]
    geom.material = ""
    geom.rgba[:3] = _fractions(rgb(FLOOR))


def _start_renderer(model: Any, size: tuple[int, int], max_geom: int) -> mujoco.Renderer:
    """Return a renderer.

    Args:
        model: model of the arena.
        size: width and height [pixels].
        max_geom: maximum number of geoms in a picture.

    Raises:
        UserError: there is no off-screen OpenGL.
    """
    width, height = size
    try:
        _draw_without_display()
        return mujoco.Renderer(model, height, width, max_geom=max_geom)
    except (RuntimeError, ImportError, AttributeError, mujoco.FatalError) as error:
        raise UserError(f"Off-screen OpenGL did not start ({error}); {_remedy()}.") from None


def _remedy() -> str:
    """Return what a user can do where there is no off-screen OpenGL."""
    if sys.platform == "linux":
        return (
            "MUJOCO_GL must be egl or osmesa, and its library installed: on Debian, apt-get install "
            "libegl1 libgl1-mesa-dri"
        )
    return "log in at the machine's own desktop, and leave MUJOCO_GL unset"


def _draw_without_display() -> None:
    """Make MuJoCo draw by EGL where there is no display, unless the user chose otherwise."""
    if (
        sys.platform == "linux"
        and not os.environ.get("DISPLAY")
        and not os.environ.get("MUJOCO_GL")
    ):
        from mujoco.rendering.classic import gl_context

        os.environ["MUJOCO_GL"] = "egl"
        importlib.reload(gl_context)  # MuJoCo chose when it was imported


def _step_back(model: Any, data: Any, shot: Shot, half: float) -> None:
    """Move a camera away from the arena's centre, until it just shows the arena's corners.

    Args:
        model: model of the arena.
        data: state of the model.
        shot: camera and size of the picture.
        half: half the edge of the arena without walls [mm].
    """
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    camera = model.camera(shot.camera)
    position = np.array(camera.pos)
    axes = data.cam_xmat[camera.id].reshape(3, 3)

    # Corners and position along the axes of the camera.
    corners = np.array([(x, y, 0.0) for x in (-half, half) for y in (-half, half)])
    corners = corners * MARGIN @ axes
    position_in_axes = position @ axes

    # Tangents of half the angles of view, horizontally and vertically.
    width, height = shot.size
    vertical = np.tan(np.radians(model.cam_fovy[camera.id]) / 2)
    tangents = np.array([vertical * width / height, vertical])

    # A corner c is seen from s p if |c_xy - s p_xy| <= tangents (s p_z - c_z), on either side.
    sides = np.array([1.0, -1.0])[:, None, None]
    needed = sides * corners[:, :2] + tangents * corners[:, 2:]
    gained = sides * position_in_axes[:2] + tangents * position_in_axes[2]
    scale = np.max(needed / gained)
    model.cam_pos[camera.id] = scale * position


def render(directory: Path, step: int | None, shot: Shot, out: Path) -> int:
    """Render one frame of a run to a picture; return its step.

    Args:
        directory: the `--out` of the run.
        step: control step, from 0 for the start; None for step 100, or the last one of a shorter
            run.
        shot: camera, size and quality.
        out: the file to write.

    Raises:
        UserError: no such run, step or camera, or no off-screen OpenGL, or `out` is not writable.
    """
    check_name(out, *PICTURE_SUFFIXES)
    run = load_recorded(directory)
    frames = run.arrays
    last_step = int(frames["step"][-1])
    if step is None:
        step = min(DEFAULT_STEP, last_step)
    check("step", step, f"a step of the run, 0 to {last_step}", 0 <= step <= last_step)
    make_output_directory(out.parent, given=out)
    with run.explained(), ArenaRenderer(run.config, frames, shot, run.robot_file) as renderer:
        pixels = renderer.show(frames, step)
    with atomic_write(out) as part:
        Image.fromarray(pixels).save(part)
    return step
