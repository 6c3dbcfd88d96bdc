"""A compiled engine from outside the package: robots go through each other, and are blind."""

from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp

from iswarm_mj.engines.base import CompiledEngine, LightReading, Motion
from iswarm_mj.engines.robot_file import read_robots
from iswarm_mj.engines.settings import EngineSettings, ModelSpec
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.links import Links


class Places(NamedTuple):
    poses: jax.Array


@dataclass(frozen=True)
class Glide(CompiledEngine):
    robot: Robots = field(metadata={"static": True})
    timestep: float

    def mapping(self, platform: str) -> Any:
        return "batch"

    def place(self, poses: Any, is_present: Any) -> Places:
        return Places(poses)

    def poses(self, bodies: Places) -> Any:
        return bodies.poses

    def sense(self, bodies: Places, emits: Any, is_running: Any) -> LightReading:
        shape = (*bodies.poses.shape[:-1], len(self.robot.sides))
        whole = jnp.zeros(shape, jnp.int32)
        flags = jnp.zeros(shape, bool)
        number = jnp.zeros(shape, jnp.float32)
        return LightReading(Links(whole, flags, whole, number, number), flags)

    def move(self, bodies: Places, phases: Any, is_running: Any) -> Motion:
        poses = bodies.poses
        for phase in phases:
            poses = poses + phase.n_substeps * self.timestep * phase.velocity(poses)
        poses = jnp.where(is_running[..., None, None], poses, bodies.poses)
        zero = jnp.zeros(is_running.shape, jnp.int32)
        touching = jnp.zeros((*zero.shape, self.robot.most_partners, poses.shape[-2]), jnp.int32)
        return Motion(Places(poses), touching, zero, zero)


@dataclass(frozen=True)
class GlideSettings(EngineSettings):
    """Robots go through each other, in a program of JAX."""

    name: ClassVar[str] = "glide"

    @property
    def on_host(self) -> bool:
        return False

    @property
    def bytes_per_robot(self) -> int:
        return 24

    def compiled_engine(self, model: ModelSpec, n_worlds: int, platform: str) -> CompiledEngine:
        return Glide(read_robots(model.robot_file), model.config.drive.timestep)
