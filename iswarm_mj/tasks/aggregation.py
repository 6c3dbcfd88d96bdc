"""Aggregation on the brighter of two spots of light, and BEECLUST, a strategy that does it without messages.

Sources: Schmickl et al., "Get in touch: cooperative decision making based on robot-to-robot collisions", Autonomous
Agents and Multi-Agent Systems 18 (2009) 133-155; Kernbach et al., "Re-embodiment of honeybee aggregation behavior in an
artificial micro-robotic system", Adaptive Behavior 17 (2009) 237-259, for the robots of the I-SWARM project.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.tasks.base import Look, Quantity, Sensed, Task, TaskInputs, without_balls
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.constraints import Above, Within, validate
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import mm_from_rd


class Spots(NamedTuple):
    """State of the task."""

    east: Float[Array, ""]
    """1 if the brighter spot is in the east, -1 in the west."""
    shares: Float[Array, "2"]
    """Of the robots, in the brighter and in the dimmer spot."""


@dataclass(frozen=True)
class Aggregation(Task):
    """Two spots of light lie on the x axis; robots are to gather on the brighter one, east or west by chance.

    Light falls off linearly from 1, or `dim`, at a spot's centre to 0 at its edge.
    """

    spot_radius: Annotated[float, Above(0, 75, "rd")] = 9.0
    """Radius of a spot [rd]."""
    spot_offset: Annotated[float, Within(0, 75, "rd")] = 14.0
    """Distance of the spots' centres from the arena's centre [rd]."""
    dim: Annotated[float, Within(0, 1)] = 0.5
    """Brightness of the dimmer spot, relative to the brighter one."""
    error_light: Annotated[float, Within(0, 1)] = 0.05
    """Relative standard deviation of what a photodiode measures."""

    senses: ClassVar[Mapping[str, Quantity]] = {"light": Quantity("brightness at the robot", high=2.0)}
    measured: ClassVar[Mapping[str, Quantity]] = {
        "bright": Quantity("share of the robots in the brighter spot", high=1.0),
        "dim": Quantity("share of the robots in the dimmer spot", high=1.0),
    }
    unused: ClassVar[tuple[str, ...]] = (
        *(f"arena.{name}" for name in ("n_dust", "dust_area_size", "dust_area_offset")),
        *("arena.ball_radius_min", "arena.ball_radius_max", "gripper"),
    )
    drawn: ClassVar[Mapping[str, Look]] = {"bright": Look((255, 214, 70)), "dim": Look((214, 196, 140))}

    def lay_out(
        self, config: SwarmConfig, n_robots: int, rng: np.random.Generator, shared: np.random.Generator, cell: float
    ) -> tuple[Float[np.ndarray, "N 3"], Spots]:
        """See `Task.lay_out`.

        Raises:
            ConfigError: a spot would lie beyond the walls, or a setting is out of range.
        """
        validate(self)
        half, remedy = config.arena.inradius, "make it smaller, or `arena.size` larger"
        if self.spot_radius > half:
            raise ConfigError("spot_radius", self.spot_radius, f"at most {half:g} rd, half of `arena.size`", remedy)
        if self.spot_offset + self.spot_radius > half:
            most = f"at most {half - self.spot_radius:g} rd with spots of {self.spot_radius:g} rd in this arena"
            raise ConfigError("spot_offset", self.spot_offset, most, remedy)
        poses, east = place_robots(config.arena, n_robots, rng, cell), np.asarray(rng.choice([-1.0, 1.0]), np.float32)
        inside = np.asarray(self.light(poses, east)) > 0
        return poses, Spots(east, inside.mean(axis=0, dtype=np.float32))

    def goal(self, config: SwarmConfig, n_robots: int) -> None:
        """Robots go on for ever."""

    def light(self, poses: Float[Array, "N 3"], east: Array) -> Float[Array, "N 2"]:
        """Light of the brighter and the dimmer spot at poses; the brighter is in the east (1) or west (-1)."""
        xp, radius = array_module(poses), mm_from_rd(self.spot_radius)
        x = mm_from_rd(self.spot_offset) * east * xp.asarray([1.0, -1.0])
        away = xp.hypot(poses[:, :1] - x, poses[:, 1:2])
        return xp.asarray([1.0, self.dim]) * xp.maximum(1.0 - away / radius, 0.0)

    def advance(self, state: Spots, inputs: TaskInputs, key: Array) -> tuple[Spots, Sensed]:
        """Count robots, and measure the light at each."""
        n_robots, light = len(inputs.poses), self.light(inputs.poses, state.east)
        inside = (light > 0) & inputs.is_present[:, None]
        shares = inside.sum(axis=0) / inputs.is_present.sum()
        error = 1.0 + self.error_light * jax.random.normal(key, (n_robots,))
        seen = jnp.clip(light.sum(axis=1) * error, 0.0, 2.0)
        return Spots(state.east, shares.astype(jnp.float32)), without_balls(n_robots, light=seen)

    def progress(self, state: Spots) -> Int[Array, ""]:
        """Percent of the robots in the brighter spot."""
        return jnp.round(100.0 * state.shares[0]).astype(jnp.int32)

    def reward(self, before: Spots, after: Spots, inputs: TaskInputs) -> Float[Array, "N"]:
        """1 for each step of a robot in the brighter spot."""
        return (self.light(inputs.poses, after.east)[:, 0] > 0).astype(jnp.float32)

    def metrics(self, state: Spots) -> dict[str, Array]:
        """Shares of the robots in each spot."""
        return {"bright": state.shares[0], "dim": state.shares[1]}

    def areas(self, config: SwarmConfig, state: Spots) -> dict[str, Float[Array, "M 3"]]:
        """The spots."""
        x, radius = mm_from_rd(self.spot_offset) * state.east, mm_from_rd(self.spot_radius)
        return {name: jnp.asarray([[side * x, 0.0, radius]]) for name, side in (("bright", 1), ("dim", -1))}


@dataclass(frozen=True)
class Beeclust(Strategy):
    """Robots walk straight on; one that meets another stops and waits, the longer the brighter, then turns away."""

    longest_wait: Annotated[float, Within(0, 1e6)] = 300.0
    """Control steps that a robot waits at most; 0 makes it a random walk."""
    half_light: Annotated[float, Above(0, 2)] = 0.5
    """Light in which a robot waits half of that."""
    meeting: Annotated[float, Above(0, 20, "rd")] = 1.4
    """Distance within which a robot meets another [rd]."""
    leaving: Annotated[float, Within(0, 1000)] = 4.0
    """Control steps after a wait in which a robot does not stop again."""

    recorded: ClassVar = ("wait",)

    def init(self, n_robots: int, key: Array) -> dict[str, Array]:
        """Nobody waits."""
        return {"wait": jnp.zeros(n_robots)}

    def picks(self, memory: Any) -> Array:
        """No robot picks anything up."""
        return jnp.zeros(len(memory["wait"]), bool)

    def act(self, memory: Any, observation: Observation, key: Array) -> tuple[dict[str, Array], Command]:
        """Steps left to wait, or negative those in which the robot leaves.

        Raises:
            UserError: the task has no light.
        """
        if "light" not in observation.sensed:
            raise UserError(
                "Beeclust follows the light of the task aggregation, and this task has none; "
                "use `iswarm run --task aggregation --strategy beeclust`, or task=Aggregation()"
            )
        wait, light = memory["wait"], observation.sensed["light"]
        chance, aside = jax.random.uniform(key, (2, len(wait)), minval=-1.0)
        meets = (observation.is_heard & (observation.distance < mm_from_rd(self.meeting))).any(axis=1)
        length = jnp.floor(self.longest_wait * light**2 / (light**2 + self.half_light**2))
        begins, ends = meets & (wait == 0) & (length >= 1), wait == 1
        left = jnp.where(wait > 0, wait - 1, jnp.minimum(wait + 1, 0))
        left = jnp.where(ends, -self.leaving, jnp.where(begins, length, left))
        blocked = observation.sees_wall[:, 0] | ends | meets
        turn = jnp.where(blocked, jnp.sign(aside) * jnp.pi / 2 * (0.5 + 0.5 * jnp.abs(chance)), 0.1 * chance)
        rests = left > 0
        return {"wait": left}, Command(jnp.where(rests, 0.0, turn), jnp.where(rests, 0.0, mm_from_rd(0.5)))
