"""The arena of a recorded run before a camera, rendered off-screen by MuJoCo."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from iswarm_mj.config import SwarmConfig
from iswarm_mj.output.trajectory import AREA
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import MM, mm_from_m, mm_from_rd

EMPTY, LOADED, SCOUT = (0.86, 0.1, 0.08, 1.0), (0.12, 0.25, 0.85, 1.0), (0.1, 0.6, 0.25, 1.0)
"""Colours of the robots: those of the paper's Figs. 12 and 16, and green for scouts."""


class Shot(NamedTuple):
    """What the camera shows, and how."""

    camera: str = "above"
    """Name of a camera in `models/arena.xml`."""
    size: tuple[int, int] = (1280, 1280)
    """Width and height [pixels]."""
    ball_scale: float = 15.0
    """Magnification of the balls, since 20 um are invisible beside 139 mm."""
    fine: bool = True
    """With shadows and round shapes; without them a frame takes a tenth of the time on a CPU."""


_FLAT = 0.002
"""Half the height of what is painted on the floor [mm]."""


class TaskArea(NamedTuple):
    """Areas of one kind."""

    colour: np.ndarray
    """Red, green, blue and alpha from 0 to 1."""
    shape: str
    """square or disc."""
    places: Float[np.ndarray, "T M 3"]
    """x, y and half the width or the radius [mm]."""


def task_areas(frames: Mapping[str, np.ndarray]) -> list[TaskArea]:
    """Return the areas that the task of a trajectory has, beside dump and dust."""
    if "scene_area_names" not in frames:
        return []
    each = zip(*(frames[f"scene_area_{part}"].tolist() for part in ("names", "colours", "shapes")), strict=True)
    return [
        TaskArea(np.array([*colour, 255], np.float32) / 255, shape, mm_from_m(frames[AREA + name].astype(float)))
        for name, colour, shape in each
    ]


class Stage:
    """The arena of a run before a camera; a context manager, since it holds off-screen OpenGL.

    Args:
        config: of the arena.
        frames: arrays of the run's trajectory.
        shot: camera, size and quality.
        robot_file: MJCF file of a robot, by default `models/robot.xml`.

    Raises:
        UserError: the robot is another one by now, no such camera, or no off-screen OpenGL.
    """

    def __init__(self, config: SwarmConfig, frames: dict[str, np.ndarray], shot: Shot, robot_file: Path | None = None):
        if sys.platform == "linux" and not os.environ.get("DISPLAY"):
            os.environ.setdefault("MUJOCO_GL", "egl")
        import mujoco

        from iswarm_mj.engines.arena import compile_arena

        arena = compile_arena(
            config, frames["pose"].shape[1], frames["scene_ball_radius"], visual=True, robot_file=robot_file
        )
        size = frames.get("scene_robot_size", 2 * MM * np.array(arena.robot.half_edges))
        if not np.allclose(size, 2 * MM * np.array(arena.robot.half_edges), rtol=1e-6):
            raise UserError(
                f"the robots of {robot_file or 'models/robot.xml'} must be as large as those of the run, {size} m (got "
                f"{arena.robot.half_edges} mm as half edges); restore the file, or run again."
            )
        model = arena.model
        cameras = [model.camera(i).name for i in range(model.ncam) if "/" not in model.camera(i).name]
        check("camera", shot.camera, " or ".join(cameras), shot.camera in cameras)
        for ball in range(len(arena.mocap)):
            model.geom(f"ball{ball}/ball").size[0] *= shot.ball_scale
        for name, areas in (("dump", frames.get("scene_dump")), ("dust_areas", frames.get("scene_dust_areas"))):
            if areas is not None and not np.any(areas):  # the task has none
                for geom in ("dump",) if name == "dump" else ("dust_west", "dust_east"):
                    model.geom(geom).size[:] = 1e-6
        self._areas = task_areas(frames)
        if not shot.fine:
            quality = model.vis.quality
            quality.numslices, quality.numstacks, quality.offsamples = 8, 4, 4
        model.vis.global_.offwidth, model.vis.global_.offheight = shot.size
        self._arena, self._camera, self._is_scout = arena, shot.camera, frames["scene_is_scout"]
        self._data = mujoco.MjData(model)
        if shot.camera == "oblique":
            _step_back(model, self._data, shot, mm_from_rd(config.arena.size) / 2)
        try:
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

    def frame(self, frames: dict[str, np.ndarray], step: int) -> UInt8[np.ndarray, "height width 3"]:
        """Pixels of a step of the trajectory."""
        return self.show(frames["pose"][step], frames["is_loaded"][step], frames["ball_position"][step], step)

    def show(
        self,
        pose: Float[np.ndarray, "N 3"],
        is_loaded: Bool[np.ndarray, "N"],
        balls: Float[np.ndarray, "K 3"],
        step: int = 0,
    ) -> UInt8[np.ndarray, "height width 3"]:
        """Pixels of robots, balls and areas of the task.

        Args:
            pose: x [m], y [m], yaw [rad].
            is_loaded: whether each robot carries a ball.
            balls: their centres [m].
            step: of the trajectory, for the areas.
        """
        import mujoco

        model, data = self._arena.model, self._data
        data.qpos[self._arena.qpos] = np.column_stack([mm_from_m(pose[:, :2].astype(float)), pose[:, 2]])
        data.mocap_pos[self._arena.mocap] = mm_from_m(balls)
        for robot, (loaded, scout) in enumerate(zip(is_loaded, self._is_scout, strict=True)):
            model.geom(f"robot{robot}/substrate").rgba = LOADED if loaded else SCOUT if scout else EMPTY
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        self._renderer.update_scene(data, self._camera)
        scene = self._renderer.scene
        for area in self._areas:
            kind = mujoco.mjtGeom.mjGEOM_CYLINDER if area.shape == "disc" else mujoco.mjtGeom.mjGEOM_BOX
            for x, y, half in area.places[step]:
                size = [half, _FLAT, 0.0] if area.shape == "disc" else [half, half, _FLAT]
                geom = scene.geoms[scene.ngeom]
                mujoco.mjv_initGeom(geom, kind, size, [x, y, -_FLAT], np.eye(3).ravel(), area.colour)
                scene.ngeom += 1
        return self._renderer.render()


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
    import mujoco

    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    camera = model.camera(shot.camera)
    axes, place = data.cam_xmat[camera.id].reshape(3, 3), np.array(camera.pos)
    corners = np.array([(x, y, 0.0) for x in (-half, half) for y in (-half, half)]) * MARGIN
    upright = np.tan(np.radians(model.cam_fovy[camera.id]) / 2)
    limits = np.array([upright * shot.size[0] / shot.size[1], upright])

    def is_seen(scale: float) -> bool:
        seen = (corners - scale * place) @ axes
        return bool((seen[:, 2] < 0).all() and (np.abs(seen[:, :2]) <= -seen[:, 2:] * limits).all())

    low, high = 0.1, 20.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (low, middle) if is_seen(middle) else (middle, high)
    model.cam_pos[camera.id] = high * place
