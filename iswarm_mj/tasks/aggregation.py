"""Aggregation in the brighter of two spots of light, and BEECLUST, a strategy without messages.

Sources: Schmickl et al., "Get in touch: cooperative decision making based on robot-to-robot
collisions", Autonomous Agents and Multi-Agent Systems 18 (2009) 133-155; Kernbach et al.,
"Re-embodiment of honeybee aggregation behavior in an artificial micro-robotic system", Adaptive
Behavior 17 (2009) 237-259, for the robots of the I-SWARM project.
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
from iswarm_mj.tasks.base import AreaStyle, Quantity, Sensed, Task, TaskInputs, without_balls
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.constraints import Above, Within, validate
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import mm_from_rd


class Spots(NamedTuple):
    """State of the task."""

    east: Float[Array, ""]
    """Side of the brighter spot: 1 east, -1 west."""
    shares: Float[Array, "2"]
    """Shares of the robots in the brighter and in the dimmer spot."""


@dataclass(frozen=True)
class Aggregation(Task):
    """Gather in the brighter of two spots of light, which is in the east or in the west by chance.

    Both spots lie on the x axis. Light falls off linearly from 1, or `dim`, at a spot's centre to 0
    at its edge. A robot is inside a spot where it gets light of it; no robot is inside a spot whose
    `dim` is 0, which is none.
    """

    spot_radius: Annotated[float, Above(0, 75, "rd")] = 9.0
    """Radius of a spot, in robot diameters [rd]."""
    spot_offset: Annotated[float, Within(0, 75, "rd")] = 14.0
    """Distance of the spots' centres from the arena's centre [rd]."""
    dim: Annotated[float, Within(0, 1)] = 0.5
    """Brightness of the dimmer spot, relative to the brighter one; 0 leaves one spot alone."""
    error_light: Annotated[float, Within(0, 1)] = 0.05
    """Relative standard deviation of the measured light."""

    senses: ClassVar[Mapping[str, Quantity]] = {
        "light": Quantity("brightness at the robot", high=2.0),
    }
    # As metrics and as areas, "bright" and "dim" are the spots; the setting `dim` is a brightness.
    measured: ClassVar[Mapping[str, Quantity]] = {
        "bright": Quantity("share of the robots in the brighter spot", high=1.0),
        "dim": Quantity("share of the robots in the dimmer spot", high=1.0),
    }
    unused: ClassVar[tuple[str, ...]] = (
        "arena.n_dust",
        "arena.dust_area_size",
        "arena.dust_area_offset",
        "arena.ball_radius_min",
        "arena.ball_radius_max",
        "gripper",
    )
    drawn: ClassVar[Mapping[str, AreaStyle]] = {
        "bright": AreaStyle(colour=(255, 214, 70)),
        "dim": AreaStyle(colour=(214, 196, 140)),
    }

    def lay_out(
        self,
        config: SwarmConfig,
        n_robots: int,
        rng: np.random.Generator,
        shared: np.random.Generator,
        cell: float,
    ) -> tuple[Float[np.ndarray, "N 3"], Spots]:
        """Return poses and spots.

        Raises:
            ConfigError: a spot would lie beyond the walls, or a setting is out of range.
        """
        self._check_spots(config)
        poses = place_robots(config.arena, n_robots, rng, cell)
        east = np.asarray(rng.choice([-1.0, 1.0]), np.float32)
        is_inside = np.asarray(self.light(poses, east)) > 0
        return poses, Spots(east, is_inside.mean(axis=0, dtype=np.float32))

    def _check_spots(self, config: SwarmConfig) -> None:
        """Raise a ConfigError unless the settings are in range and the spots within the walls."""
        validate(self)
        half_size = config.arena.inradius
        remedy = "make it smaller, or `arena.size` larger"
        if self.spot_radius > half_size:
            constraint = f"at most {half_size:g} rd, half of `arena.size`"
            raise ConfigError("spot_radius", self.spot_radius, constraint, remedy)
        if self.spot_offset + self.spot_radius > half_size:
            largest = half_size - self.spot_radius
            radius = self.spot_radius
            constraint = f"at most {largest:g} rd with spots of {radius:g} rd in this arena"
            raise ConfigError("spot_offset", self.spot_offset, constraint, remedy)

    def goal(self, config: SwarmConfig, n_robots: int) -> None:
        """Return None: robots may leave a spot again."""

    def light(self, poses: Float[Array, "N 3"], east: Array) -> Float[Array, "N 2"]:
        """Return the light of the brighter and of the dimmer spot at each robot; NumPy or JAX.

        Args:
            poses: poses of the robots, x and y in mm.
            east: side of the brighter spot, 1 east or -1 west.
        """
        xp = array_module(poses)
        brightness = xp.asarray([1.0, self.dim])
        spot_x = mm_from_rd(self.spot_offset) * east * xp.asarray([1.0, -1.0])
        distance = xp.hypot(poses[:, :1] - spot_x, poses[:, 1:2])
        return brightness * xp.maximum(1.0 - distance / mm_from_rd(self.spot_radius), 0.0)

    def advance(self, state: Spots, inputs: TaskInputs, key: Array) -> tuple[Spots, Sensed]:
        """Count the robots in each spot, and measure the light at each robot."""
        n_robots = len(inputs.poses)
        light = self.light(inputs.poses, state.east)

        is_inside = (light > 0) & inputs.is_present[:, None]
        shares = is_inside.sum(axis=0) / inputs.is_present.sum()

        error = 1.0 + self.error_light * jax.random.normal(key, (n_robots,))
        measured_light = jnp.clip(light.sum(axis=1) * error, 0.0, 2.0)

        state = Spots(state.east, shares.astype(jnp.float32))
        return state, without_balls(n_robots, light=measured_light)

    def progress(self, state: Spots) -> Int[Array, ""]:
        """Return the percentage of the robots in the brighter spot."""
        return jnp.round(100.0 * state.shares[0]).astype(jnp.int32)

    def reward(self, before: Spots, after: Spots, inputs: TaskInputs) -> Float[Array, "N"]:
        """Return 1 for each robot in the brighter spot."""
        light_of_brighter = self.light(inputs.poses, after.east)[:, 0]
        is_inside = (light_of_brighter > 0) & inputs.is_present
        return is_inside.astype(jnp.float32)

    def metrics(self, state: Spots) -> dict[str, Array]:
        """Return the shares of the robots in each spot."""
        return {"bright": state.shares[0], "dim": state.shares[1]}

    def areas(self, config: SwarmConfig, state: Spots) -> dict[str, Float[Array, "M 3"]]:
        """Return the spots."""
        x = mm_from_rd(self.spot_offset) * state.east
        radius = mm_from_rd(self.spot_radius)
        return {
            "bright": jnp.asarray([[x, 0.0, radius]]),
            "dim": jnp.asarray([[-x, 0.0, radius]]),
        }


@dataclass(frozen=True)
class Beeclust(Strategy):
    """Robots walk on; one that meets another waits, longer in brighter light, then turns away."""

    longest_wait: Annotated[float, Within(0, 1e6)] = 300.0
    """Longest wait in control steps; 0 makes it a random walk."""
    half_light: Annotated[float, Above(0, 2)] = 0.5
    """Light in which a robot waits half as long."""
    meeting: Annotated[float, Above(0, 20, "rd")] = 1.4
    """Distance within which a robot meets another, in robot diameters [rd]."""
    leaving: Annotated[float, Within(0, 1000)] = 4.0
    """Control steps after a wait in which a robot does not stop again."""

    recorded: ClassVar = ("wait",)

    def init(self, n_robots: int, key: Array) -> dict[str, Array]:
        """Return a memory in which no robot waits."""
        return {"wait": jnp.zeros(n_robots)}

    def picks(self, memory: Any) -> Array:
        """Return False for all robots: none picks up balls."""
        return jnp.zeros(len(memory["wait"]), bool)

    def act(
        self,
        memory: Any,
        observation: Observation,
        key: Array,
    ) -> tuple[dict[str, Array], Command]:
        """Return the timers and the commands.

        A positive timer counts the steps that are left to wait, a negative one those in which the
        robot leaves and does not stop again.

        Raises:
            UserError: the task has no light.
        """
        if "light" not in observation.sensed:
            raise UserError(
                "Beeclust follows the light of the task aggregation, and this task has none; "
                "use `iswarm run --task aggregation --strategy beeclust`, or task=Aggregation()"
            )
        wait = memory["wait"]
        light = observation.sensed["light"]
        # Robots hear each other although they say nothing: a message without fields has the number
        # of its LED, by whose light the distance is measured.
        is_near = observation.is_heard & (observation.distance < mm_from_rd(self.meeting))
        meets = is_near.any(axis=1)

        # Stop at a meeting for a time that grows with the light, and leave when it is over. Timers
        # count towards 0; `begins` and `ends` exclude each other, as the timer is 0 or 1 then.
        wait_here = jnp.floor(self.longest_wait * light**2 / (light**2 + self.half_light**2))
        begins = meets & (wait == 0) & (wait_here >= 1)
        ends = wait == 1
        counted_down = jnp.where(wait > 0, wait - 1, jnp.minimum(wait + 1, 0))
        wait = jnp.where(begins, wait_here, counted_down)
        wait = jnp.where(ends, -self.leaving, wait)

        # Turn aside by 45 to 90 degrees before walls and others, else walk nearly straight on.
        amount, side = jax.random.uniform(key, (2, len(wait)), minval=-1.0)
        wall_ahead = observation.sees_wall[:, 0]  # side 0 is the front
        is_blocked = wall_ahead | ends | meets
        turn_aside = jnp.sign(side) * jnp.pi / 2 * (0.5 + 0.5 * jnp.abs(amount))
        turn = jnp.where(is_blocked, turn_aside, 0.1 * amount)

        rests = wait > 0
        command = Command(
            turn=jnp.where(rests, 0.0, turn),
            forward=jnp.where(rests, 0.0, mm_from_rd(0.5)),
        )
        return {"wait": wait}, command
