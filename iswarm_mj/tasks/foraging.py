"""Foraging from sources that run dry and reappear elsewhere, and a strategy of lone foragers."""

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
from iswarm_mj.tasks.base import AreaStyle, Quantity, Sensed, Task, TaskInputs
from iswarm_mj.tasks.grasping import update_balls
from iswarm_mj.tasks.layout import balls_on_floor, draw_radii, place_robots
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.constraints import Above, Within, validate
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import mm_from_rd


class Sources(NamedTuple):
    """State of the task: S sources with K items."""

    items: Balls
    """Items, of which every S-th belongs to the same source."""
    centres: Float[Array, "S 2"]
    """Centres of the sources [mm]."""
    limits: Float[Array, "2"]
    """Smallest and largest distance of a source from the arena's centre [mm]."""
    is_home: Bool[Array, "K"]
    """Items that were brought home in the last step."""
    n_home: Int[Array, ""]
    """Number of items brought home so far."""
    moves: Int[Array, ""]
    """Number of times that a source reappeared elsewhere so far."""
    time: Float[Array, ""]
    """Time since the start [s]."""


@dataclass(frozen=True)
class Foraging(Task):
    """Carry items home to the dump; a source whose items are all there reappears elsewhere.

    Items are `arena.n_dust` balls that all stick alike; tools lift and release them as in cleaning.
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
    drawn: ClassVar[Mapping[str, AreaStyle]] = {
        "dump": AreaStyle(colour=(250, 205, 50), shape="square"),
        "sources": AreaStyle(colour=(120, 190, 110)),
    }

    def lay_out(
        self,
        config: SwarmConfig,
        n_robots: int,
        rng: np.random.Generator,
        shared: np.random.Generator,
        cell: float,
    ) -> tuple[Float[np.ndarray, "N 3"], Sources]:
        """Return poses and sources.

        Raises:
            ConfigError: a source would lie beyond the walls or have no items, or a setting is out
                of range.
        """
        self._check_sources(config)
        arena = config.arena
        poses = place_robots(arena, n_robots, rng, cell)

        # Sources lie between the dump and the walls.
        farthest = arena.inradius - self.source_radius
        nearest = min(0.75 * arena.dump_size + self.source_radius, farthest)
        limits = np.array(mm_from_rd(np.array([nearest, farthest])), np.float32)
        key = jax.random.key(rng.integers(2**32))
        centres, offsets = self._draw_places(limits, arena.n_dust, key)

        position = np.asarray(centres[self._source_of_items(arena.n_dust)] + offsets)
        items = balls_on_floor(config.gripper, position, draw_radii(arena, shared))
        state = Sources(
            items=items,
            centres=np.asarray(centres),
            limits=limits,
            is_home=np.zeros(arena.n_dust, bool),
            n_home=np.zeros((), np.int32),
            moves=np.zeros((), np.int32),
            time=np.zeros((), np.float32),
        )
        return poses, state

    def _check_sources(self, config: SwarmConfig) -> None:
        """Raise a ConfigError unless sources have room in the arena, and at least an item each."""
        validate(self)
        arena = config.arena
        if self.source_radius > arena.inradius:
            constraint = f"at most {arena.inradius:g} rd, half of `arena.size`"
            remedy = "make it smaller, or that larger"
            raise ConfigError("source_radius", self.source_radius, constraint, remedy)
        if self.sources > arena.n_dust:
            constraint = f"at most {arena.n_dust}, the items of all sources (`arena.n_dust`)"
            raise ConfigError("sources", self.sources, constraint, "take fewer, or more items")

    def _source_of_items(self, n_items: int) -> Int[np.ndarray, "K"]:
        """Return the source of each item."""
        return np.arange(n_items) % self.sources

    def _draw_places(
        self,
        limits: Array,
        n_items: int,
        key: Array,
    ) -> tuple[Float[Array, "S 2"], Float[Array, "K 2"]]:
        """Draw centres of all sources, and offsets of all items from the centre of theirs [mm]."""
        centre_key, offset_key = jax.random.split(key)
        centres = draw_in_ring(limits, self.sources, centre_key)
        offsets = draw_in_ring((0.0, mm_from_rd(self.source_radius)), n_items, offset_key)
        return centres, offsets

    def goal(self, config: SwarmConfig, n_robots: int) -> None:
        """Return None: sources always reappear."""

    def advance(self, state: Sources, inputs: TaskInputs, key: Array) -> tuple[Sources, Sensed]:
        """Carry, release and pick up items, and move the sources that ran dry."""
        grip_key, place_key = jax.random.split(key)
        items, sensed = update_balls(state.items, inputs, grip_key)
        is_home = items.is_delivered & ~state.items.is_delivered

        # A source has run dry when none of its items is left outside of the dump.
        source = self._source_of_items(len(items.radius))
        has_items = jnp.zeros(self.sources, bool).at[source].max(~items.is_delivered)
        moves = ~has_items

        # Move it to a new place, and its items with it.
        new_centres, offsets = self._draw_places(state.limits, len(source), place_key)
        centres = jnp.where(moves[:, None], new_centres, state.centres)
        returns = moves[source]
        position = jnp.where(returns[:, None], centres[source] + offsets, items.position)
        items = items._replace(position=position, is_delivered=items.is_delivered & ~returns)

        state = Sources(
            items=items,
            centres=centres,
            limits=state.limits,
            is_home=is_home,
            n_home=state.n_home + is_home.sum(dtype=jnp.int32),
            moves=state.moves + moves.sum(dtype=jnp.int32),
            time=state.time + jnp.float32(inputs.config.drive.control_period),
        )
        return state, sensed

    def balls(self, state: Sources) -> Balls:
        """Return the items."""
        return state.items

    def progress(self, state: Sources) -> Int[Array, ""]:
        """Return the number of items brought home."""
        return state.n_home

    def reward(self, before: Sources, after: Sources, inputs: TaskInputs) -> Float[Array, "N"]:
        """Return 1 for each item that a robot brings home."""
        nothing = jnp.zeros(len(inputs.poses))
        return nothing.at[after.items.holder].add(after.is_home.astype(jnp.float32))

    def metrics(self, state: Sources) -> dict[str, Array]:
        """Return the items brought home, in total and per minute, and the moves of sources."""
        rate = 60.0 * state.n_home / jnp.maximum(state.time, 1e-3)
        return {"items": state.n_home, "rate": rate, "moves": state.moves}

    def areas(self, config: SwarmConfig, state: Sources) -> dict[str, Float[Array, "M 3"]]:
        """Return the dump and the sources."""
        radius = jnp.full((self.sources, 1), mm_from_rd(self.source_radius), jnp.float32)
        dump = jnp.array([[0.0, 0.0, mm_from_rd(config.arena.dump_size / 2)]])
        return {"dump": dump, "sources": jnp.hstack([state.centres, radius])}


def draw_in_ring(limits: Any, n: int, key: Array) -> Float[Array, "n 2"]:
    """Draw points that are spread evenly over a ring around the origin.

    Args:
        limits: inner and outer radius [mm].
        n: number of points.
        key: random key.
    """
    inner, outer = limits
    turn, share = jax.random.uniform(key, (2, n))
    distance = jnp.sqrt(inner**2 + share * (outer**2 - inner**2))
    angle = 2 * jnp.pi * turn
    return distance[:, None] * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)


_FRONT = 0
"""Side of a robot's front."""
_NEAR = 1.4
"""Distance of a robot ahead for which a forager turns aside, in robot diameters [rd]."""


@dataclass(frozen=True)
class Forager(Strategy):
    """Robots search at random, and return home and to their last item by their own odometry.

    Home is the dump. Items are what observations call dust and balls; food is the place of the
    last one.
    """

    random_turn: Annotated[float, Within(0, 180, "deg")] = 25.0
    """Largest turn of a random step, to either side [deg]."""
    reach: Annotated[float | None, Within(0, 100, "mm")] = None
    """Distance of the tool ahead of the robot's centre [mm]; None for that of its file."""

    recorded: ClassVar = {
        "home.vector": "mm",
        "home.known": "",
        "food.vector": "mm",
        "food.known": "",
    }

    def for_world(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "Forager":
        """Return the strategy of robots with this tool.

        Raises:
            UserError: kinds of robots have tools of different lengths, and `reach` is not set.
        """
        if self.reach is not None:
            return self
        reaches = {kind.probe_tip[0] for kind in robot.kinds}
        if len(reaches) > 1:
            remedy = "make each kind of robots a team, or set `reach`."
            raise UserError(f"tools of foragers must have one length; {remedy}")
        return replace(self, reach=reaches.pop())

    def init(self, n_robots: int, key: Array) -> dict[str, VectorMemory]:
        """Return the memories of robots that know neither home nor food."""
        return {"home": VectorMemory.empty(n_robots), "food": VectorMemory.empty(n_robots)}

    def picks(self, memory: Any) -> Array:
        """Return True for all robots: all pick up items."""
        return jnp.ones(len(memory["home"].known), bool)

    def act(self, memory: Any, observation: Observation, key: Array) -> tuple[Any, Command]:
        """Go to an item beside the robot, home with an item, back to the last item, or anywhere."""
        seen = observation
        step = mm_from_rd(0.5)  # in robot diameters, as the default `drive.step_length`
        picks_up = seen.at_dust & ~seen.is_loaded & ~seen.grasp_failed

        # Remember home where the dump is, and food where an item is or was. A robot forgets a place
        # that it does not find within half a step, and food that it failed to grasp.
        here = jnp.zeros_like(seen.ball_vector)
        home = learn_place(memory["home"], seen.on_dump, here, step)
        food = memory["food"].where(~seen.grasp_failed)
        food = learn_place(food, picks_up, seen.ball_vector, step)
        heading = self._heading(seen, picks_up, home, food, key)

        # Turn by at most a quarter, and walk only if that completes the turn: then `clip` has left
        # the heading as it was.
        turn = jnp.clip(heading, -jnp.pi / 2, jnp.pi / 2)
        distance_to_ball = jnp.hypot(seen.ball_vector[:, 0], seen.ball_vector[:, 1])
        distance = jnp.where(picks_up, distance_to_ball - jnp.asarray(self.reach), step)
        forward = jnp.where(turn == heading, jnp.clip(distance, -step, step), 0.0)

        memory = {
            "home": after_motion(home, turn, forward),
            "food": after_motion(food, turn, forward),
        }
        return memory, Command(turn, forward)

    def _heading(
        self,
        seen: Observation,
        picks_up: Bool[Array, "N"],
        home: VectorMemory,
        food: VectorMemory,
        key: Array,
    ) -> Float[Array, "N"]:
        """Return the direction in which each robot wants to go, from its front [rad]."""
        # Head for home when loaded, for food when empty, anywhere when the way is unknown.
        knows_way = jnp.where(seen.is_loaded, home.known & ~seen.on_dump, food.known)
        goal = jnp.where(seen.is_loaded[:, None], home.vector, food.vector)
        n_robots = len(seen.at_dust)
        wander, side = jax.random.uniform(key, (2, n_robots), minval=-1.0)
        random_heading = jnp.deg2rad(self.random_turn) * wander
        heading = jnp.where(knows_way, jnp.arctan2(goal[:, 1], goal[:, 0]), random_heading)

        # Turn aside for a robot ahead and, when wandering, for a wall. A robot beside an item takes
        # it first: it walks no more than the rest of the way, and would lose the item by turning.
        hears_ahead = seen.is_heard[:, _FRONT]
        is_near = seen.distance[:, _FRONT] < mm_from_rd(_NEAR)
        robot_ahead = hears_ahead & is_near & ~picks_up
        wall_ahead = seen.sees_wall[:, _FRONT] & ~knows_way
        return jnp.where(robot_ahead | wall_ahead, jnp.sign(side) * jnp.pi / 2, heading)
