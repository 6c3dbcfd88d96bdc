"""The arena of a recorded run before a camera, rendered off-screen by MuJoCo, and a picture of it."""

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
from iswarm_mj.output.palette import DUMP, DUST, FLOOR, rgb
from iswarm_mj.output.saved import SavedRun, load, scene_of
from iswarm_mj.output.shapes import floor
from iswarm_mj.output.swarm_classes import robot_classes, shown_classes
from iswarm_mj.output.trajectory import AREA, SCENE, Arrays, Scene
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, check_name, make_output_directory
from iswarm_mj.utils.units import MM, mm_from_m, mm_from_rd

BALL_SCALE = 15.0
"""Magnification of the balls, since 20 um are invisible beside 139 mm."""
PICTURES = (".png", ".jpg", ".jpeg", ".webp")
"""Endings of the names of pictures."""
STEP = 100
"""The step that is shown by default."""


class Shot(NamedTuple):
    """What the camera shows, and how."""

    camera: str = "above"
    """Name of a camera in `models/arena.xml`."""
    size: tuple[int, int] = (1280, 1280)
    """Width and height [pixels]."""
    fine: bool = True
    """With shadows and round shapes; without them a frame takes a tenth of the time on a CPU."""


def recorded(directory: Path) -> SavedRun:
    """Return a run with a recorded world; if it was interrupted, say so on the standard error.

    Raises:
        UserError: the directory holds no recorded run, or a damaged one.
    """
    run = load(directory)
    last = run.arrays["step"][-1]
    if run.result.get("interrupted"):
        print(f"iswarm: the run in {directory} was interrupted after step {last}.", file=sys.stderr)
    return run


_FLAT = 0.002
"""Half the height of what is painted on the floor [mm]."""


class Stage:
    """The arena of a run before a camera; a context manager, since it holds off-screen OpenGL.

    Args:
        config: of the arena.
        frames: arrays of the run's trajectory.
        shot: camera, size and quality.
        robot_file: MJCF file of the robots, or of each kind (`RobotFile`), by default `models/robot.xml`.

    Raises:
        UserError: the robot is another one by now, no such camera, or no off-screen OpenGL.
    """

    def __init__(self, config: SwarmConfig, frames: Arrays, shot: Shot, robot_file: RobotFile = None):
        n_robots = frames["pose"].shape[1]
        file = as_robot_file(robot_file)
        scene = scene_of(frames)
        tune = partial(_lay_floor, scene) if config.arena.outline else None
        try:
            arena = compile_arena(config, n_robots, frames["scene_ball_radius"], True, tune, file)
        except ValueError as error:
            reason = " ".join(str(error).split())
            raise UserError(f"the robots of {robot_file or 'models/robot.xml'} cannot be drawn ({reason})") from None
        size = 2 * MM * arena.robot.each("half_edges", n_robots)
        recorded = np.broadcast_to(frames["scene_robot_size"], size.shape)
        differs = ~np.isclose(recorded, size, rtol=1e-6).all(axis=1)
        if differs.any():
            first = differs.argmax()
            raise UserError(
                f"the robots of {robot_file or 'models/robot.xml'} must be as large as those of the run, "
                f"{recorded[first]} m (got {size[first]} m); restore the file, or run again."
            )
        model = arena.model
        cameras = [model.camera(i).name for i in range(model.ncam) if "/" not in model.camera(i).name]
        check("camera", shot.camera, " or ".join(cameras), shot.camera in cameras)
        for ball in range(len(arena.mocap)):
            model.geom(f"ball{ball}/ball").size[0] *= BALL_SCALE
        for material, colour in (("dump", DUMP), ("dust", DUST)):  # as in recordings
            model.material(material).rgba[:3] = np.array(rgb(colour)) / 255
        for name, geoms in (("dump", ("dump",)), ("dust_areas", ("dust_west", "dust_east"))):
            for geom in geoms if not np.any(frames[SCENE + name]) else ():  # the task has none
                model.geom(geom).size[:] = 1e-6
        names, colours, shapes = (frames[f"scene_area_{part}"].tolist() for part in ("names", "colours", "shapes"))
        self._areas = [
            (shape == "disc", np.array([*colour, 255], np.float32) / 255, AREA + name)
            for name, colour, shape in zip(names, colours, shapes, strict=True)
        ]
        if not shot.fine:
            quality = model.vis.quality
            quality.numslices, quality.numstacks, quality.offsamples = 8, 4, 4
        model.vis.global_.offwidth, model.vis.global_.offheight = shot.size
        self._arena, self._camera, self._scene = arena, shot.camera, scene
        self._data = mujoco.MjData(model)
        if shot.camera == "oblique":
            _step_back(model, self._data, shot, mm_from_rd(config.arena.size) / 2)
        try:
            _draw_without_display()
            self._renderer = mujoco.Renderer(model, shot.size[1], shot.size[0], max_geom=model.ngeom + 100)
        except (RuntimeError, ImportError, AttributeError, mujoco.FatalError) as error:
            raise UserError(
                f"Off-screen OpenGL did not start ({error}); MUJOCO_GL must be egl or osmesa, and its library "
                "installed: on Debian, apt-get install libegl1 libgl1-mesa-dri."
            ) from None
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shot.fine

    def __enter__(self) -> "Stage":
        """Return the stage."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Release OpenGL."""
        self._renderer.close()

    def show(self, frames: Arrays, step: int, part: float = 0.0) -> UInt8[np.ndarray, "height width 3"]:
        """Pixels of robots, balls, boxes and areas of the task after a control step.

        Args:
            frames: arrays of a trajectory.
            step: the step.
            part: of the next step, in which bodies move straight.
        """
        model, data, is_loaded = self._arena.model, self._data, frames["is_loaded"][step]
        pose, boxes, balls = (_interpolated(frames[n], step, part) for n in ("pose", "box_pose", "ball_position"))
        bodies = np.concatenate([pose, boxes])
        data.qpos[self._arena.qpos] = np.column_stack([mm_from_m(bodies[:, :2]), bodies[:, 2]])
        data.mocap_pos[self._arena.mocap] = mm_from_m(balls)
        loaded_too = self._scene._replace(ball_radius=np.zeros(1))  # robots may be loaded where there are no balls
        colours = {place: np.array(colour) / 255 for place, _, colour in shown_classes(loaded_too)}
        for robot, place in enumerate(robot_classes(self._scene, is_loaded, np.zeros_like(is_loaded)).tolist()):
            model.geom(f"robot{robot}/substrate").rgba[:3] = colours[place]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        self._renderer.update_scene(data, self._camera)
        scene = self._renderer.scene
        for is_disc, colour, name in self._areas:
            kind = mujoco.mjtGeom.mjGEOM_CYLINDER if is_disc else mujoco.mjtGeom.mjGEOM_BOX
            for x, y, half in mm_from_m(frames[name][step].astype(float)):
                size = [half, _FLAT, 0.0] if is_disc else [half, half, _FLAT]
                mujoco.mjv_initGeom(scene.geoms[scene.ngeom], kind, size, [x, y, -_FLAT], np.eye(3).ravel(), colour)
                scene.ngeom += 1
        return self._renderer.render()


def _interpolated(values: Float[np.ndarray, "T *shape"], step: int, part: float) -> Float[np.ndarray, "*shape"]:
    """Values at a part of the way from a step to the next."""
    here = values[step].astype(float)
    return here + part * (values[step + 1] - here) if part else here


def _lay_floor(scene: Scene, spec: mujoco.MjSpec) -> None:
    """Put a floor within the walls in place of the rectangle, a plane."""
    top = floor(scene)[0] - [0, 0, 2 * _FLAT]
    spec.add_mesh(name="floor", uservert=np.concatenate([top, top - [0, 0, 1]]).ravel())  # a prism, their hull
    geom = spec.geom("floor")
    geom.type, geom.meshname, geom.pos = mujoco.mjtGeom.mjGEOM_MESH, "floor", [0, 0, 0]
    geom.material, geom.rgba[:3] = "", np.array(rgb(FLOOR)) / 255


def _draw_without_display() -> None:
    """Have MuJoCo draw by EGL where there is no display, unless the user says by what."""
    if sys.platform == "linux" and not os.environ.get("DISPLAY") and not os.environ.get("MUJOCO_GL"):
        from mujoco.rendering.classic import gl_context

        os.environ["MUJOCO_GL"] = "egl"
        importlib.reload(gl_context)  # MuJoCo chose when it was imported


MARGIN = 1.06
"""Of what the camera shows to what it must."""


def _step_back(model: Any, data: Any, shot: Shot, half: float) -> None:
    """Move a camera along its line from the arena's centre, until the picture just holds the corners of the arena.

    Args:
        model: of the arena.
        data: of the model.
        shot: camera and size of the picture.
        half: half the edge of the arena, walls left out [mm].
    """
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    camera = model.camera(shot.camera)
    axes, place = data.cam_xmat[camera.id].reshape(3, 3), np.array(camera.pos)
    corners = np.array([(x, y, 0.0) for x in (-half, half) for y in (-half, half)]) * MARGIN @ axes
    upright = np.tan(np.radians(model.cam_fovy[camera.id]) / 2)
    limits = np.array([upright * shot.size[0] / shot.size[1], upright])
    # A corner c is seen from s p if |c_xy - s p_xy| <= limits (s p_z - c_z), for the axes of the camera.
    sides = np.array([1.0, -1.0])[:, None, None]
    wanted = sides * corners[:, :2] + limits * corners[:, 2:]
    gained = sides * (place @ axes)[:2] + limits * (place @ axes)[2]
    model.cam_pos[camera.id] = np.max(wanted / gained) * place


def render(directory: Path, step: int | None, shot: Shot, out: Path) -> int:
    """Render one frame of a run to a PNG; return its step.

    Args:
        directory: the `--out` of the run.
        step: control step, from 0 for the start; None for step 100, or the last one of a shorter run.
        shot: camera, size and quality.
        out: the file to write.

    Raises:
        UserError: no such run, step or camera, or no off-screen OpenGL, or `out` is not writable.
    """
    check_name(out, *PICTURES)
    run = recorded(directory)
    frames = run.arrays
    last = int(frames["step"][-1])
    step = min(STEP, last) if step is None else step
    check("step", step, f"a step of the run, 0 to {last}", 0 <= step <= last)
    make_output_directory(out.parent, given=out)
    with run.explained(), Stage(run.config, frames, shot, run.robot_file) as stage:
        pixels = stage.show(frames, step)
    with atomic_write(out) as part:
        Image.fromarray(pixels).save(part)
    return step
