"""A picture of a run, rendered off-screen by MuJoCo from the run's directory."""

import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import mm_from_m

EMPTY, LOADED, SCOUT = (0.86, 0.1, 0.08, 1.0), (0.12, 0.25, 0.85, 1.0), (0.1, 0.6, 0.25, 1.0)
"""Colours of the robots: those of the paper's Figs. 12 and 16, and green for scouts."""


def load(directory: Path) -> tuple[SwarmConfig, dict[str, np.ndarray]]:
    """Return the arena's configuration and the trajectory's arrays of a recorded run.

    Raises:
        UserError: the directory holds no recorded run.
    """
    try:
        arena = json.loads((directory / RESULT).read_text(encoding="utf-8"))["config"]["arena"]
        with np.load(directory / TRAJECTORY) as file:
            return SwarmConfig(arena=ArenaConfig(**arena)), dict(file)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"The directory was {directory}, where no {RESULT} with {TRAJECTORY} can be read ({error}); "
            "give the --out of a run of `iswarm clean` that was recorded."
        ) from None


def render(directory: Path, step: int, camera: str, size: tuple[int, int], ball_scale: float, out: Path) -> None:
    """Render one frame of a run to a PNG.

    Args:
        directory: the `--out` of the run.
        step: control step, from 0 for the start.
        camera: name of a camera in `models/arena.xml`.
        size: width and height [pixels].
        ball_scale: the balls are drawn this many times larger, since 20 um does not show beside 139 mm.
        out: the file to write.

    Raises:
        UserError: no such run, step or camera, or no off-screen OpenGL, or `out` cannot be written to.
    """
    config, frames = load(directory)
    last = int(frames["step"][-1])
    if not 0 <= step <= last:
        raise UserError(f"--step was {step}; the run has steps 0 to {last}: choose one of these.")
    with Stage(config, frames, camera, size, ball_scale) as stage:
        pixels = stage.frame(frames, step)
    from PIL import Image

    try:
        Image.fromarray(pixels).save(out)
    except (OSError, ValueError) as error:
        raise UserError(
            f"--out was {out}, which cannot be written ({error}): give another name ending in .png."
        ) from None


class Stage:
    """The arena of a run before a camera; a context, since it holds off-screen OpenGL.

    Args:
        config: of the arena.
        frames: arrays of the run's trajectory.
        camera: name of a camera in `models/arena.xml`.
        size: width and height [pixels].
        ball_scale: the balls are drawn this many times larger.
        fine: with shadows and round shapes; without, a frame takes a tenth of the time where no graphics card helps.
        robot_file: MJCF file of a robot, by default `models/robot.xml`.

    Raises:
        UserError: no such camera, or no off-screen OpenGL.
    """

    def __init__(
        self, config: SwarmConfig, frames: dict[str, np.ndarray], camera: str, size: tuple[int, int],
        ball_scale: float, fine: bool = True, robot_file: Path | None = None,
    ):  # fmt: skip
        if sys.platform == "linux" and not os.environ.get("DISPLAY"):
            os.environ.setdefault("MUJOCO_GL", "egl")
        import mujoco

        from iswarm_mj.engines.arena import compile_arena

        arena = compile_arena(
            config, frames["pose"].shape[1], frames["scene_ball_radius"], visual=True, robot_file=robot_file
        )
        model = arena.model
        cameras = [model.camera(i).name for i in range(model.ncam) if "/" not in model.camera(i).name]
        if camera not in cameras:
            raise UserError(f"--camera was {camera!r}; the arena has {', '.join(cameras)}: choose one of these.")
        for ball in range(len(arena.mocap)):
            model.geom(f"ball{ball}/ball").size[0] *= ball_scale
        if not fine:
            quality = model.vis.quality
            quality.numslices, quality.numstacks, quality.offsamples = 8, 4, 4
        model.vis.global_.offwidth, model.vis.global_.offheight = size
        self._arena, self._camera, self._data, self._is_scout = (
            arena,
            camera,
            mujoco.MjData(model),
            frames["scene_is_scout"],
        )
        try:
            self._renderer = mujoco.Renderer(model, size[1], size[0], max_geom=model.ngeom + 100)
        except (RuntimeError, ImportError, AttributeError, mujoco.FatalError) as error:
            raise UserError(
                f"Off-screen OpenGL did not start ({error}); MUJOCO_GL must be egl or osmesa and its library there: "
                "on Debian, apt-get install libegl1 libgl1-mesa-dri."
            ) from None
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = fine

    def __enter__(self) -> "Stage":
        """Return the stage."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Give OpenGL free."""
        self._renderer.close()

    def frame(self, frames: dict[str, np.ndarray], step: int) -> np.ndarray:
        """Pixels (height, width, 3) of a step of the trajectory."""
        return self.show(frames["pose"][step], frames["is_loaded"][step], frames["ball_position"][step])

    def show(self, pose: np.ndarray, is_loaded: np.ndarray, balls: np.ndarray) -> np.ndarray:
        """Pixels (height, width, 3) of robots and balls.

        Args:
            pose: (N, 3) x [m], y [m], yaw [rad].
            is_loaded: (N,) bool.
            balls: (K, 3) their centres [m].
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
        return self._renderer.render()
