"""Pictures of the worlds of an environment, and recordings of its episodes for Rerun.

They show robots, balls, areas and metrics, but no links.
"""

import atexit
from dataclasses import asdict
from pathlib import Path
from typing import Any, Self

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
from iswarm_mj.simulation.stacking import to_json
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.simulation.step import mean_distance
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.constraints import check_kind
from iswarm_mj.utils.files import check_name

SHOT = Shot("above", (480, 480), fine=False)
"""Default of pictures; on a CPU one of 100 robots takes some 10 ms."""


def _record_of(env: Env, state: State, world: int) -> StepRecord:
    """Return the record (1, 1, ...) of a world, as if the episode began in this state."""
    world_state = state.data.world._replace(bodies=None)
    parts = (env.poses(state), env.boxes(state), world_state)
    rows = [world]
    is_single = env.n_worlds is None and parts[0].ndim == 2
    if is_single:
        parts = jax.tree.map(lambda a: np.asarray(a)[None], parts)
        rows = [0]

    poses, boxes, world_state = parts
    poses, boxes = jax.tree.map(lambda a: np.asarray(a, float), (poses, boxes))
    record = start_record(world_state, poses, rows, env.core.robot, boxes)
    collisions = np.asarray(world_state.collisions)[rows]
    return record._replace(collisions=collisions[None])


def _recorded_world(env: Env, start: StepRecord, world: int) -> RecordedWorld:
    """Return a world that begins with a record."""
    core = env.core
    return RecordedWorld(start, 0, core.config, core.params.task, core.robot, number=world)


class Pictures:
    """Pictures of the worlds of an environment; holds off-screen OpenGL until it is closed."""

    def __init__(self, env: Env, state: State, shot: Shot = SHOT):
        """Set up the arena before a camera.

        Args:
            env: the environment.
            state: any state of it.
            shot: camera, size and quality.

        Raises:
            UserError: there is no off-screen OpenGL.
        """
        self._env = env
        start = _record_of(env, state, world=0)
        recorded = _recorded_world(env, start, world=0)
        arrays = {**recorded.scene.arrays(), **recorded.frames([start]).arrays()}
        self._renderer = ArenaRenderer(env.core.config, arrays, shot, env.core.robot_file)

    def show(self, state: State, world: int = 0) -> UInt8[np.ndarray, "height width 3"]:
        """Return the pixels of a world in a state."""
        record = _record_of(self._env, state, world)
        frames = _recorded_world(self._env, record, world).frames([record])
        return self._renderer.show(frames.arrays(), 0)

    def close(self) -> None:
        """Release OpenGL."""
        self._renderer.__exit__()


class EnvRecording:
    """A recording for Rerun of one world of an environment; a context manager.

    Episodes follow each other in one timeline.
    """

    def __init__(self, env: Env, path: Path | str, world: int = 0):
        """Name the file, which begins with the first state.

        Args:
            env: the environment.
            path: file to write, `*.rrd`; an existing one is replaced.
            world: number of the world to record.

        Raises:
            UserError: the file is no `*.rrd`.
        """
        check_kind("record", path, (str, Path))
        check_name(path, ".rrd", setting="record")
        self._env = env
        self._path = path
        self._world = world
        self._step = 0
        self._previous: StepRecord | None = None
        self._file: Recording | None = None
        self._unwritten: list[StepRecord] = []

    def add(self, state: State) -> None:
        """Record a state; the file is written after each block of states, and when it is closed.

        Raises:
            UserError: the file cannot be written, or another recording is writing it.
        """
        record = _record_of(self._env, state, self._world)
        if self._previous is None or self._file is None:
            self._file = self._open(record)
            self._step = 0
        else:
            self._step += 1
            step = np.array([[self._step]], np.int32)
            record = record._replace(step=step, speed=self._speed_since(self._previous, record))
        self._previous = record
        self._unwritten.append(record)
        if len(self._unwritten) == BLOCK_FRAMES:
            self._write(self._file)

    def _open(self, start: StepRecord) -> Recording:
        """Return the file, which begins with a record."""
        core = self._env.core
        self._recorded = _recorded_world(self._env, start, self._world)
        settings = {"task": to_json(core.params.task), **asdict(core.config)}
        about = {"version": __version__, "n_robots": self._env.n_robots}
        file = Recording(self._path, self._recorded.scene, settings, about)
        # Programs that forget to close the recording find it complete all the same.
        atexit.register(self.close)
        return file

    def _speed_since(self, previous: StepRecord, record: StepRecord) -> Array:
        """Return the mean speed of the robots (1, 1) between two records [mm/s]."""
        all_present = np.ones(record.poses.shape[1:3], bool)
        distance = mean_distance(previous.poses[0], record.poses[0], all_present)
        return distance[None] / self._env.dt

    def _write(self, file: Recording) -> None:
        """Append the records that are left to the file."""
        records = self._unwritten
        self._unwritten = []
        if records:
            file.append(self._recorded.frames(records))

    def close(self) -> None:
        """Write what was not yet written, and close the file; further calls do nothing.

        Python calls it as the program ends, if nobody did.
        """
        file = self._file
        self._file = None
        if file is None:
            return
        atexit.unregister(self.close)
        try:
            self._write(file)
        finally:
            file.close()

    def __enter__(self) -> Self:
        """Return the recording."""
        return self

    def __exit__(self, *_: Any) -> None:
        """Complete the file."""
        self.close()
