"""Episodes of an environment for those who watch: pictures, and recordings for Rerun.

They show robots, balls, areas and metrics, but no links.
"""

import atexit
from dataclasses import asdict
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import UInt8

from iswarm_mj._version import __version__
from iswarm_mj.envs.core import State
from iswarm_mj.envs.env import Env
from iswarm_mj.output.frames import BLOCK_FRAMES, RecordedWorld
from iswarm_mj.output.offscreen import ArenaRenderer, Shot
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.simulation.build import start_record
from iswarm_mj.simulation.given import to_json
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.simulation.step import mean_distance
from iswarm_mj.utils.constraints import check_kind
from iswarm_mj.utils.files import check_name

SHOT = Shot("above", (480, 480), fine=False)
"""Of pictures by default; on a CPU one of 100 robots takes some 10 ms."""


def _record(env: Env, state: State, world: int) -> StepRecord:
    """Record (1, 1, ...) of a world in a state of B worlds, or of one without an axis."""
    found, rows = (env.poses(state), env.boxes(state), state.data.world._replace(bodies=None)), [world]
    if env.n_worlds is None and found[0].ndim == 2:
        found, rows = jax.tree.map(lambda a: np.asarray(a)[None], found), [0]
    poses, boxes = jax.tree.map(lambda a: np.asarray(a, float), found[:2])
    record = start_record(found[2], poses, rows, env.core.robot, boxes)
    return record._replace(collisions=np.asarray(found[2].collisions)[rows][None])


def _recorded(env: Env, record: StepRecord, world: int) -> RecordedWorld:
    """World that begins with a record."""
    core = env.core
    return RecordedWorld(record, 0, core.config, core.params.task, core.robot, number=world)


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
        self._env, first = env, _record(env, state, 0)
        recorded = _recorded(env, first, 0)
        arrays = {**recorded.scene.arrays(), **recorded.frames([first]).arrays()}
        self._stage = ArenaRenderer(env.core.config, arrays, shot, env.core.robot_file)

    def show(self, state: State, world: int = 0) -> UInt8[np.ndarray, "height width 3"]:
        """Return the pixels of a world in a state."""
        record = _record(self._env, state, world)
        return self._stage.show(_recorded(self._env, record, world).frames([record]).arrays(), 0)

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
            path: the file to write, `*.rrd`; an existing one is replaced.
            world: which is recorded.

        Raises:
            UserError: the file is no `*.rrd`.
        """
        check_kind("record", path, (str, Path))
        check_name(path, ".rrd", setting="record")
        self._env, self._path, self._world = env, path, world
        self._before: StepRecord | None = None
        self._file: Recording | None = None
        self._left: list[StepRecord] = []

    def add(self, state: State) -> None:
        """Record a state; the file is written after each block of states, and when it is closed.

        Raises:
            UserError: the file cannot be written, or another recording is writing it.
        """
        env, record = self._env, _record(self._env, state, self._world)
        if self._before is None or self._file is None:
            self._recorded = _recorded(env, record, self._world)
            settings = {"task": to_json(env.core.params.task), **asdict(env.core.config)}
            about = {"version": __version__, "n_robots": env.n_robots}
            self._file = Recording(self._path, self._recorded.scene, settings, about)
            atexit.register(self.close)  # of a program that forgets to
            self._step = 0
        else:
            self._step += 1
            moved = mean_distance(self._before.poses[0], record.poses[0], np.ones(record.poses.shape[1:3], bool))
            record = record._replace(step=np.array([[self._step]], np.int32), speed=moved[None] / env.dt)
        self._before = record
        self._left.append(record)
        if len(self._left) == BLOCK_FRAMES:
            self._write(self._file)

    def _write(self, file: Recording) -> None:
        left, self._left = self._left, []
        if left:
            file.append(self._recorded.frames(left))

    def close(self) -> None:
        """Complete the file."""
        file, self._file = self._file, None
        if file is not None:
            atexit.unregister(self.close)
            try:
                self._write(file)
            finally:
                file.close()

    def __enter__(self) -> "EnvRecording":
        """Return the recording."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Complete the file."""
        self.close()
