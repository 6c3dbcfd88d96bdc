"""An engine from outside the package, in one file: it needs its settings and its class alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from iswarm_mj import (
    RD,
    Engine,
    EngineSettings,
    LightReading,
    Links,
    ModelSpec,
    Motion,
    Phase,
    Within,
    find_lost,
    read_robots,
)


class Places(NamedTuple):
    poses: np.ndarray


class Teleport(Engine):
    """Robots appear where their servos would have taken them, through each other, and are blind."""

    def __init__(self, model: ModelSpec, far: float):
        self.robot, self._far = read_robots(model.robot_file), far
        self._timestep = model.config.drive.timestep
        # Normals, and distances from the centre in mm.
        self._walls = model.config.arena.walls * [1, 1, RD]

    def place(self, poses: Any, is_present: Any) -> Places:
        return Places(np.array(poses, float))

    def poses(self, bodies: Places) -> Any:
        return bodies.poses

    def sense(self, bodies: Places, emits: Any, is_running: Any) -> LightReading:
        shape = (*bodies.poses.shape[:2], len(self.robot.sides))
        whole = np.zeros(shape, np.int32)
        flags = np.zeros(shape, bool)
        number = np.zeros(shape, np.float32)
        return LightReading(Links(whole, flags, whole, number, number), flags)

    def move(self, bodies: Places, phases: Sequence[Phase], is_running: Any) -> Motion:
        poses = bodies.poses
        for phase in phases:
            poses = poses + self._far * phase.n_substeps * self._timestep * phase.velocity(poses)
        moves = np.asarray(is_running)[:, None]
        fault, robot = find_lost(poses, np.broadcast_to(moves, poses.shape[:2]), self._walls)
        poses = np.where((moves & (fault == 0)[:, None])[..., None], poses, bodies.poses)
        return Motion(
            Places(poses),
            np.zeros((len(poses), self.robot.most_partners, poses.shape[1]), np.int32),
            fault,
            robot,
        )


@dataclass(frozen=True)
class TeleportSettings(EngineSettings):
    """Robots go through each other."""

    name: ClassVar[str] = "teleport"

    far: Annotated[float, Within(0.1, 100)] = 1.0
    """Factor of all distances and turns."""

    @property
    def bytes_per_robot(self) -> int:
        return 24

    def host_engine(self, model: ModelSpec) -> Callable[[int, int], Engine]:
        return lambda n_worlds, n_threads: Teleport(model, self.far)
