"""Episodes of an environment for those who watch: pictures, a window, and recordings for Rerun."""

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import UInt8

from iswarm_mj import __version__
from iswarm_mj.envs.env import Env
from iswarm_mj.envs.state import State
from iswarm_mj.output.frames import RecordedWorld
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.stage import Shot, Stage
from iswarm_mj.output.trajectory import areas_of
from iswarm_mj.simulation.given import to_json
from iswarm_mj.simulation.start import start_record
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.simulation.step import mean_step

SHOT = Shot("above", (480, 480), fine=False)
"""Of pictures by default; on a CPU one of 100 robots takes some 10 ms."""


class Watched:
    """One world of an environment, as pictures and recordings show it: robots, balls, areas and metrics, but no links.

    Attributes:
        world: its number.
        scene: constants of the world.
    """

    def __init__(self, env: Env, state: State, world: int = 0):
        """Begin with a state.

        Args:
            env: the environment.
            state: of it; of B worlds, or of one.
            world: which of the B is shown.
        """
        self._env, self.world, self._step = env, world, 0
        core, self._before = env.core, self._record(state)
        self._recorded = RecordedWorld(self._before, 0, core.given, core.params.task, core.robot, number=world)
        self.scene = self._recorded.scene

    def frames(self, state: State) -> Frames:
        """Return the frame of the next state."""
        record, before = self._record(state), self._before
        moved = mean_step(before.poses[0], record.poses[0], np.ones(record.poses.shape[1:3], bool))
        self._step, self._before = self._step + 1, record
        record = record._replace(step=np.array([[self._step]], np.int32), speed=moved[None] / self._env.dt)
        return self._recorded.frames([record], before)

    def start(self) -> Frames:
        """Return the frame of the state with which it began."""
        return self._recorded.frames([self._before])

    def _record(self, state: State) -> StepRecord:
        """A state as a record (1, 1, ...)."""
        found, rows = (
            (self._env.poses(state), self._env.boxes(state), state.data.world._replace(bodies=None)),
            [self.world],
        )
        if self._env.n_worlds is None and found[0].ndim == 2:
            found, rows = jax.tree.map(lambda a: np.asarray(a)[None], found), [0]
        poses, boxes, world = found
        poses, boxes = jax.tree.map(lambda a: np.asarray(a, float), (poses, boxes))
        record = start_record(world, poses, rows, self._env.core.robot, boxes)
        return record._replace(collisions=np.asarray(world.collisions)[rows][None])


class Pictures:
    """Pictures of the worlds of an environment; holds off-screen OpenGL until it is closed."""

    def __init__(self, env: Env, state: State, shot: Shot = SHOT):
        """Set up the arena before a camera.

        Args:
            env: the environment.
            state: of it.
            shot: camera, size and quality.

        Raises:
            UserError: there is no off-screen OpenGL.
        """
        self._watched, first, core = partial(Watched, env), Watched(env, state), env.core
        arrays = {**first.scene.arrays(), **first.start().arrays()}
        self._stage = Stage(core.given, arrays, shot, core.robot_file)

    def show(self, state: State, world: int = 0) -> UInt8[np.ndarray, "height width 3"]:
        """Return the pixels of a world in a state."""
        arrays = self._watched(state, world).start().arrays()
        pose, is_loaded, balls, boxes = (arrays[n][0] for n in ("pose", "is_loaded", "ball_position", "box_pose"))
        return self._stage.show(pose, is_loaded, balls, boxes, areas_of(arrays, 0))

    def close(self) -> None:
        """Release OpenGL."""
        self._stage.__exit__()


class EnvRecording:
    """A recording for Rerun of one world of an environment; a context manager.

    Episodes follow each other in one timeline.
    """

    def __init__(self, env: Env, path: Path | str, world: int = 0):
        """Name the file, which begins with the first state.

        Args:
            env: the environment.
            path: the file to write, by custom `*.rrd`.
            world: which is recorded.
        """
        self._env, self._path, self._world = env, path, world
        self._watched: Watched | None = None
        self._recording: Recording | None = None

    def add(self, state: State) -> None:
        """Record a state.

        Raises:
            UserError: the file cannot be written.
        """
        if self._watched is None or self._recording is None:
            self._watched = Watched(self._env, state, self._world)
            core = self._env.core
            settings = {"task": to_json(core.params.task), **asdict(core.given)}
            about = {"version": __version__, "n_robots": self._env.n_robots}
            self._recording = Recording(self._path, self._watched.scene, settings, about)
            self._recording.append(self._watched.start())
        else:
            self._recording.append(self._watched.frames(state))

    def close(self) -> None:
        """Complete the file."""
        if self._recording is not None:
            self._recording.close()
        self._recording = None

    def __enter__(self) -> "EnvRecording":
        """Return the recording."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Complete the file."""
        self.close()
