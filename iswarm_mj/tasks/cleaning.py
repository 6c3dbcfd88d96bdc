"""The paper's task: carry the balls of two dust areas to the dump (section 4 of the paper)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.tasks.base import AreaStyle, Quantity, Sensed, Task, TaskInputs
from iswarm_mj.tasks.grasping import update_balls
from iswarm_mj.tasks.layout import balls_on_floor, draw_radii, place_balls, place_robots
from iswarm_mj.tasks.measures import DELIVERED, PICKED, Measures, fitness
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd


@jax.tree_util.register_static
@dataclass(frozen=True)
class Cleaning(Task):
    """Carry the balls of two dust areas to the dump; `ArenaConfig` says where these are."""

    batch_invariant: ClassVar[bool] = True
    measured: ClassVar[Mapping[str, Quantity]] = {
        "delivered": Quantity("balls at the dump"),
        "picked": Quantity("different balls that were picked up at least once"),
    }
    drawn: ClassVar[Mapping[str, AreaStyle]] = {
        "dump": AreaStyle((250, 205, 50), "square"),
        "dust_areas": AreaStyle((150, 190, 240), "square"),
    }

    def lay_out(
        self,
        config: SwarmConfig,
        n_robots: int,
        rng: np.random.Generator,
        shared: np.random.Generator,
        cell: float,
    ) -> tuple[Float[np.ndarray, "N 3"], Balls]:
        """Return poses and balls; all worlds of a seed have balls of the same radii."""
        radii = draw_radii(config.arena, shared)
        poses = place_robots(config.arena, n_robots, rng, cell)
        position = place_balls(config.arena, rng)
        return poses, balls_on_floor(config.gripper, position, radii)

    def goal(self, config: SwarmConfig, n_robots: int) -> int:
        """Return the number of balls."""
        return config.arena.n_dust

    def advance(self, state: Balls, inputs: TaskInputs, key: Array) -> tuple[Balls, Sensed]:
        """Carry, release and pick up balls, see `update_balls`."""
        return update_balls(state, inputs, key)

    def balls(self, state: Balls) -> Balls:
        """Return the state, which is the balls."""
        return state

    def progress(self, state: Balls) -> Int[Array, ""]:
        """Return the number of balls at the dump."""
        return state.is_delivered.sum(dtype=jnp.int32)

    def reward(self, before: Balls, after: Balls, inputs: TaskInputs) -> Float[Array, "N"]:
        """Return points for robots that pick up a ball for the first time, or deliver one.

        Summed over robots and steps they are the paper's fitness without the parts for collisions
        and for the time that is left.
        """
        is_picked = after.was_picked & ~before.was_picked
        is_delivered = after.is_delivered & ~before.is_delivered
        points = PICKED * is_picked.astype(jnp.float32) + DELIVERED * is_delivered
        return jnp.zeros(len(inputs.poses)).at[after.holder].add(points)

    def metrics(self, state: Balls) -> dict[str, Array]:
        """Return the numbers of balls delivered and picked up."""
        return {
            "delivered": state.is_delivered.sum(dtype=jnp.int32),
            "picked": state.was_picked.sum(dtype=jnp.int32),
        }

    def fitness(self, measures: Measures, config: SwarmConfig, n_robots: int, steps: int) -> float:
        """Return the paper's fitness, see `tasks.measures.fitness`."""
        return fitness(measures, n_robots, config.arena.n_dust, steps)

    def areas(self, config: SwarmConfig, state: Balls) -> dict[str, Float[Array, "M 3"]]:
        """Return the dump and the dust areas."""
        arena = config.arena
        dump = [0.0, 0.0, arena.dump_size / 2]
        west = [-arena.dust_area_offset, 0.0, arena.dust_area_size / 2]
        east = [arena.dust_area_offset, 0.0, arena.dust_area_size / 2]
        return {
            "dump": mm_from_rd(np.array([dump])),
            "dust_areas": mm_from_rd(np.array([west, east])),
        }


CLEANING = Cleaning()
"""Default task of a swarm."""
