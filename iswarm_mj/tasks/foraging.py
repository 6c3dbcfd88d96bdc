"""Foraging from sources that run dry and come back elsewhere, and a strategy of robots that each do it alone."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.vectors import after_motion, learn_place
from iswarm_mj.tasks.base import Look, Quantity, Sensed, Task, TaskInputs
from iswarm_mj.tasks.grasping import update_balls
from iswarm_mj.tasks.layout import balls_on_floor, draw_radii, place_robots
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.constraints import Above, Within, validate
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import mm_from_rd


class Sources(NamedTuple):
    """State of the task: S sources with K items."""

    items: Balls
    centres: Float[Array, "S 2"]
    """[mm]"""
    limits: Float[Array, "2"]
    """Least and greatest distance of a source from the arena's centre [mm]."""
    is_home: Bool[Array, "K"]
    """Items that were brought home in the last step."""
    n_home: Int[Array, ""]
    """Items brought home so far."""
    moves: Int[Array, ""]
    """Sources that came back elsewhere, so far."""
    time: Float[Array, ""]
    """[s]"""


@dataclass(frozen=True)
class Foraging(Task):
    """Items are to be carried home, to the dump; a source whose items are all there comes back elsewhere.

    Items are `arena.n_dust` balls, which stick alike; tools lift and release them as in cleaning.
    """

    sources: Annotated[int, Within(1, 100)] = 6
    """Number of sources, which share the items."""
    source_radius: Annotated[float, Above(0, 75, "rd")] = 2.0
    """Radius of a source [rd]."""

    measured: ClassVar[Mapping[str, Quantity]] = {
        "items": Quantity("items brought home"),
        "rate": Quantity("items brought home per time", "1/min"),
        "moves": Quantity("sources that ran dry and came back elsewhere"),
    }
    drawn: ClassVar[Mapping[str, Look]] = {"dump": Look((250, 205, 50), "square"), "sources": Look((120, 190, 110))}

    def lay_out(
        self, config: SwarmConfig, n_robots: int, rng: np.random.Generator, shared: np.random.Generator, cell: float
    ) -> tuple[Float[np.ndarray, "N 3"], Sources]:
        """See `Task.lay_out`.

        Raises:
            ConfigError: a source would lie beyond the walls or have no items, or a setting is out of range.
        """
        validate(self)
        arena, poses = config.arena, place_robots(config.arena, n_robots, rng, cell)
        if self.source_radius > arena.inradius:
            most, remedy = f"at most {arena.inradius:g} rd, half of `arena.size`", "make it smaller, or that larger"
            raise ConfigError("source_radius", self.source_radius, most, remedy)
        if self.sources > arena.n_dust:
            most = f"at most {arena.n_dust}, the items of all sources (`arena.n_dust`)"
            raise ConfigError("sources", self.sources, most, "take fewer, or more items")
        nearest, farthest = 0.75 * arena.dump_size + self.source_radius, arena.inradius - self.source_radius
        limits = np.array(mm_from_rd(np.array([min(nearest, farthest), farthest])), np.float32)
        centres, spread = self._places(limits, arena.n_dust, jax.random.key(rng.integers(2**32)))
        position = np.asarray(centres[np.arange(arena.n_dust) % self.sources] + spread)
        items = balls_on_floor(config.gripper, position, draw_radii(arena, shared))
        none, zero = np.zeros(arena.n_dust, bool), np.zeros((), np.int32)
        return poses, Sources(items, np.asarray(centres), limits, none, zero, zero, zero.astype(np.float32))

    def _places(self, limits: Array, n_items: int, key: Array) -> tuple[Float[Array, "S 2"], Float[Array, "K 2"]]:
        """New places of all sources, and of items relative to them [mm]."""
        near, spread = jax.random.split(key)
        return _between(limits, self.sources, near), _between((0.0, mm_from_rd(self.source_radius)), n_items, spread)

    def goal(self, config: SwarmConfig, n_robots: int) -> None:
        """Sources always come back."""

    def advance(self, state: Sources, inputs: TaskInputs, key: Array) -> tuple[Sources, Sensed]:
        """Carry, release and pick up items; sources of which nothing is left move."""
        grip_key, place_key = jax.random.split(key)
        old = state.items
        items, sensed = update_balls(old, inputs, grip_key)
        source = np.arange(len(old.radius)) % self.sources
        moves = ~jnp.zeros(self.sources, bool).at[source].max(~items.is_delivered)
        places, spread = self._places(state.limits, len(source), place_key)
        centres, returns = jnp.where(moves[:, None], places, state.centres), moves[source]
        position = jnp.where(returns[:, None], centres[source] + spread, items.position)
        is_home = items.is_delivered & ~old.is_delivered
        new = Sources(
            items=items._replace(position=position, is_delivered=items.is_delivered & ~returns),
            centres=centres,
            limits=state.limits,
            is_home=is_home,
            n_home=state.n_home + is_home.sum(dtype=jnp.int32),
            moves=state.moves + moves.sum(dtype=jnp.int32),
            time=state.time + jnp.float32(inputs.config.drive.control_period),
        )
        return new, sensed

    def balls(self, state: Sources) -> Balls:
        """The items."""
        return state.items

    def progress(self, state: Sources) -> Int[Array, ""]:
        """Items brought home."""
        return state.n_home

    def reward(self, before: Sources, after: Sources, inputs: TaskInputs) -> Float[Array, "N"]:
        """1 for a robot that brings an item home."""
        return jnp.zeros(len(inputs.poses)).at[after.items.holder].add(after.is_home.astype(jnp.float32))

    def metrics(self, state: Sources) -> dict[str, Array]:
        """Items brought home, also per minute, and how often sources moved."""
        rate = 60.0 * state.n_home / jnp.maximum(state.time, 1e-3)
        return {"items": state.n_home, "rate": rate, "moves": state.moves}

    def areas(self, config: SwarmConfig, state: Sources) -> dict[str, Float[Array, "M 3"]]:
        """Home and the sources."""
        radius = jnp.full((self.sources, 1), mm_from_rd(self.source_radius), jnp.float32)
        dump = jnp.array([[0.0, 0.0, mm_from_rd(config.arena.dump_size / 2)]])
        return {"dump": dump, "sources": jnp.hstack([state.centres, radius])}


def _between(limits: Any, n: int, key: Array) -> Float[Array, "n 2"]:
    """Points spread evenly over a ring around the origin [mm]."""
    angle, share = jax.random.uniform(key, (2, n))
    away = jnp.sqrt(limits[0] ** 2 + share * (limits[1] ** 2 - limits[0] ** 2))
    return away[:, None] * jnp.stack([jnp.cos(2 * jnp.pi * angle), jnp.sin(2 * jnp.pi * angle)], axis=-1)


@dataclass(frozen=True)
class Forager(Strategy):
    """Robots search at random; where home and the last item lay they know by their own steps, and go back there."""

    random_turn: Annotated[float, Within(0, 180, "deg")] = 25.0
    """Largest turn of a random step, to either side [deg]."""
    reach: Annotated[float | None, Within(0, 100, "mm")] = None
    """Distance of the tool ahead of a robot's centre [mm]; by default as in its file."""

    recorded: ClassVar = {"home.vector": "mm", "home.known": "", "food.vector": "mm", "food.known": ""}

    def for_world(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "Forager":
        """Return the strategy of robots with this tool."""
        reaches = {kind.probe_tip[0] for kind in robot.kinds}
        if self.reach is None and len(reaches) > 1:
            raise UserError("tools of foragers must have one length; make each kind of robots a team, or set `reach`.")
        return replace(self, reach=reaches.pop()) if self.reach is None else self

    def init(self, n_robots: int, key: Array) -> dict[str, VectorMemory]:
        """Nobody knows anything."""
        return {"home": VectorMemory.empty(n_robots), "food": VectorMemory.empty(n_robots)}

    def picks(self, memory: Any) -> Array:
        """All robots pick items up."""
        return jnp.ones(len(memory["home"].known), bool)

    def act(self, memory: Any, observation: Observation, key: Array) -> tuple[Any, Command]:
        """Go to the item beside, home with an item, back to where the last one lay, or anywhere."""
        seen, step = observation, mm_from_rd(0.5)
        chance, aside = jax.random.uniform(key, (2, len(seen.at_dust)), minval=-1.0)
        takes = seen.at_dust & ~seen.is_loaded & ~seen.grasp_failed
        home = learn_place(memory["home"], seen.on_dump, jnp.zeros_like(seen.ball_vector), step)
        food = learn_place(memory["food"].where(~seen.grasp_failed), takes, seen.ball_vector, step)
        known = jnp.where(seen.is_loaded, home.known & ~seen.on_dump, food.known)
        goal = jnp.where(seen.is_loaded[:, None], home.vector, food.vector)
        angle = jnp.where(known, jnp.arctan2(goal[:, 1], goal[:, 0]), jnp.deg2rad(self.random_turn) * chance)
        near = (seen.is_heard & (seen.distance < mm_from_rd(1.4)))[:, 0] & ~takes
        angle = jnp.where(near | (seen.sees_wall[:, 0] & ~known), jnp.sign(aside) * jnp.pi / 2, angle)
        turn = jnp.clip(angle, -jnp.pi / 2, jnp.pi / 2)
        ahead = jnp.where(takes, jnp.hypot(*seen.ball_vector.T) - jnp.asarray(self.reach), step)
        forward = jnp.where(turn == angle, jnp.clip(ahead, -step, step), 0.0)
        own = {name: after_motion(known, turn, forward) for name, known in (("home", home), ("food", food))}
        return own, Command(turn, forward)
