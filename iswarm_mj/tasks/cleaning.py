"""The paper's task: carry the balls of two dust areas to the dump (section 4 of the paper)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.config import SwarmConfig
from iswarm_mj.gripper.bench.deciders import decider_for
from iswarm_mj.gripper.handling import Balls, Rules, carry, handle
from iswarm_mj.sensors.floor import probe_tips, sense
from iswarm_mj.tasks.layout import draw_radii, lying, place_balls, place_robots
from iswarm_mj.tasks.protocol import Around, Look, Quantity, Sensed, Things
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd

POINTS = 20.0
"""Of the paper's fitness (section 4.6), for a ball picked up, and as many again when it is delivered."""


@jax.tree_util.register_static
@dataclass(frozen=True)
class Cleaning:
    """Balls on two dust areas are to be carried to the dump; the configuration's `arena` says where these are."""

    measured: ClassVar[Mapping[str, Quantity]] = {
        "delivered": Quantity("balls at the dump"),
        "picked": Quantity("different balls that were picked up at least once"),
    }
    drawn: ClassVar[Mapping[str, Look]] = {
        "dump": Look((250, 205, 50), "square"),
        "dust_areas": Look((150, 190, 240), "square"),
    }

    def lay_out(
        self, config: SwarmConfig, n_robots: int, rng: np.random.Generator, shared: np.random.Generator, cell: float
    ) -> tuple[Float[np.ndarray, "N 3"], Things]:
        """See `Task.lay_out`; all worlds of a seed have balls of the same radii."""
        radii = draw_radii(config.arena, shared)
        poses = place_robots(config.arena, n_robots, rng, cell)
        position = place_balls(config.arena, rng)
        return poses, Things(lying(config.gripper, position, radii))

    def goal(self, config: SwarmConfig, n_robots: int) -> int:
        """All balls."""
        return config.arena.n_dust

    def advance(self, things: Things, around: Around, key: Array) -> tuple[Things, Sensed]:
        """Carry, release and lift balls."""
        balls, sensed = grip(things.balls, around, key)
        return Things(balls), sensed

    def progress(self, things: Things) -> Int[Array, ""]:
        """Balls at the dump."""
        return things.balls.is_delivered.sum(dtype=jnp.int32)

    def reward(self, before: Things, after: Things, around: Around) -> Float[Array, "N"]:
        """20 points for the robot that picks up a ball for the first time, 20 for the one that delivers it.

        Summed over robots and steps these are the paper's fitness without collisions and what is left of the time.
        """
        old, new = before.balls, after.balls
        points = POINTS * ((new.was_picked & ~old.was_picked) + (new.is_delivered & ~old.is_delivered))
        return jnp.zeros(len(around.poses)).at[new.holder].add(points)

    def metrics(self, things: Things) -> dict[str, Array]:
        """Balls delivered and picked up."""
        balls = things.balls
        return {
            "delivered": balls.is_delivered.sum(dtype=jnp.int32),
            "picked": balls.was_picked.sum(dtype=jnp.int32),
        }

    def areas(self, config: SwarmConfig, things: Things) -> dict[str, Float[Array, "M 3"]]:
        """The dump and the dust areas."""
        arena = config.arena
        dust = [[side * arena.dust_area_offset, 0.0, arena.dust_area_size / 2] for side in (-1, 1)]
        return {
            "dump": mm_from_rd(np.array([[0.0, 0.0, arena.dump_size / 2]])),
            "dust_areas": mm_from_rd(np.array(dust)),
        }


CLEANING = Cleaning()
"""What robots do where no other task is given."""


def grip(balls: Balls, around: Around, key: Array) -> tuple[Balls, Sensed]:
    """Carry, release and lift balls as the forces of the grippers decide; and what robots sense of dust and dump.

    Args:
        balls: from the step before.
        around: the world as the step begins.
        key: decides which held balls fall, and how strongly balls stick in each attempt.
    """
    conditions = around.conditions
    tips = probe_tips(around.poses, jnp.asarray(around.robot.probe_tip))
    balls = carry(balls, tips)
    dump_size, reach = mm_from_rd(conditions.dump_size), mm_from_rd(conditions.dust_range)
    floor = sense(around.poses, tips, balls.position, balls.is_lying, dump_size, reach)
    falls = jax.random.bernoulli(key, conditions.drop_rate, balls.is_held.shape)
    gripper = around.config.gripper
    rules = Rules(around.config.drive.control_period, decider_for(gripper))
    balls, grasp_failed = handle(
        gripper,
        conditions,
        balls,
        tips,
        floor,
        around.picks,
        falls,
        rules=rules,
        key=jax.random.fold_in(key, 1),
        voltage=around.voltage,
    )
    return balls, Sensed(floor.at_dust, floor.ball_vector, floor.on_dump, grasp_failed, {})
