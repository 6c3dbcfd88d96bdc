"""An engine from outside the package: its settings and its class are all that runs and environments need."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import jax
import numpy as np
import pytest
from helpers_mjx import ran

from iswarm_mj import make_env
from iswarm_mj.engines.base import Engine, Motion, Phase, Sight, find_lost
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.engines.settings import EngineSettings, ModelSpec
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.utils.constraints import Within
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import mm_from_rd

N, STEPS = 7, 3


class Places(NamedTuple):
    poses: np.ndarray


class Teleport:
    """Robots appear where their servos would have taken them, through each other, and are blind."""

    def __init__(self, model: ModelSpec, far: float):
        self.robot, self._far = read_robot(model.robot_file), far
        self._timestep, self._edge = model.config.drive.timestep, mm_from_rd(model.config.arena.size) / 2

    def place(self, poses: Any, is_present: Any) -> Places:
        return Places(np.array(poses, float))

    def poses(self, bodies: Places) -> Any:
        return bodies.poses

    def sense(self, bodies: Places, emits: Any, is_running: Any) -> Sight:
        shape = (*bodies.poses.shape[:2], len(self.robot.sides))
        whole, flags, number = np.zeros(shape, np.int32), np.zeros(shape, bool), np.zeros(shape, np.float32)
        return Sight(Links(whole, flags, whole, number, number), flags)

    def move(self, bodies: Places, phases: Sequence[Phase], is_running: Any) -> Motion:
        poses = bodies.poses
        for phase in phases:
            poses = poses + self._far * phase.n_substeps * self._timestep * phase.velocity(poses)
        moves = np.asarray(is_running)[:, None]
        fault, robot = find_lost(poses, np.broadcast_to(moves, poses.shape[:2]), self._edge)
        poses = np.where((moves & (fault == 0)[:, None])[..., None], poses, bodies.poses)
        return Motion(
            Places(poses), np.zeros((len(poses), self.robot.most_partners, poses.shape[1]), np.int32), fault, robot
        )


@dataclass(frozen=True)
class TeleportSettings(EngineSettings):
    name: ClassVar[str] = "teleport"

    far: Annotated[float, Within(0.1, 100)] = 1.0
    """Factor of all distances and turns."""

    @property
    def bytes_per_robot(self) -> int:
        return 24

    def host_engine(self, model: ModelSpec) -> Callable[[int, int], Engine]:
        return lambda n_worlds, n_threads: Teleport(model, self.far)


def after(poses, turn, forward):
    """Where robots end that turn, then walk."""
    yaw = poses[..., 2] + turn
    ahead = np.stack([forward * np.cos(yaw), forward * np.sin(yaw), turn], axis=-1)
    return poses + ahead


def test_a_run_takes_it(small):
    settings = RunSettings(N, STEPS, seed=1, n_worlds=2, record_worlds=(0, 1))  # in which nobody leaves the arena
    run = Run(small, settings=settings, engine=TeleportSettings())
    record = ran(run)
    before = np.concatenate([run.start.poses, record.poses[:-1]])
    np.testing.assert_allclose(record.poses, after(before, *record.command), atol=1e-5)
    assert run.identity == {"engine": "teleport"} and not run.faults and run.step == STEPS
    assert np.abs(np.diff(record.poses, axis=0)).max() > 1


def test_its_faults_end_worlds(small):
    """Robots that go 100 times as far leave the arena."""
    run = Run(small, settings=RunSettings(N, STEPS, n_worlds=2), engine=TeleportSettings(100.0))
    ran(run)
    assert [(fault.world, fault.step) for fault in run.faults] == [(0, 1), (1, 1)]
    np.testing.assert_array_equal(run.arrays()[1].bodies.poses, [start.poses for start in run.starts])


def test_an_environment_takes_it(small):
    env = make_env(n_robots=N, config=small, engine=TeleportSettings(), n_worlds=2, n_starts=3)
    state = env.reset(jax.random.split(jax.random.key(0), 2))
    before = np.asarray(state.data.world.bodies.poses)
    state = env.step(state, np.full((2, N, 2), 0.5, np.float32))
    expected = after(before, *(np.full((2, N), value) for value in (np.radians(45), np.sqrt(2) / 2)))
    np.testing.assert_allclose(state.data.world.bodies.poses, expected, atol=1e-5)
    assert not state.done.any()


def test_its_settings_are_checked():
    with pytest.raises(ConfigError, match=r"far must be between 0.1 and 100 \(got 0.0\)"):
        TeleportSettings(0.0)
