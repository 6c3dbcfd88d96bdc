"""A door opens once robots have waited long enough; boxes lie behind it, elsewhere in each world.

    iswarm run --task examples/door.py:Door --strategy examples/explore.py:Explore --robots 30 --steps 300 \
        --worlds 2 --arena.size 30 --arena.dump-size 1 --engine planar

A wall of two boxes of mass 0 divides the arena; the door, another one, slides along it. Robots push the other boxes.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np

from iswarm_mj import (
    RD,
    Quantity,
    Task,
    Within,
    mm_from_rd,
    place_robots,
    poses_of_boxes,
    without_balls,
)

WALL, DOOR = 4.0, 2.8
"""Where wall and door are, along x [rd]."""


class Passage(NamedTuple):
    step: np.ndarray
    boxes: np.ndarray
    """Where they are to be [mm, mm, rad]."""
    share: np.ndarray


@dataclass(frozen=True)
class Door(Task):
    opens: Annotated[int, Within(1, 10_000)] = 100
    """Control step in which the door opens."""
    n_crates: Annotated[int, Within(0, 20)] = 3
    """Boxes behind it."""

    measured: ClassVar = {"through": Quantity("share of the robots behind the wall", high=1.0)}
    unused: ClassVar = ("gripper", "arena.n_dust")

    def lay_boxes(self, config, rng, shared):
        end = config.arena.size / 2
        wall = [(WALL, side * (end + 2) / 2, 0.4, (end - 2) / 2 - 0.1, 0, 0, 0) for side in (-1, 1)]
        rows = np.linspace(3 - end, end - 3, self.n_crates)
        x, yaw = rng.uniform(WALL + 2, end - 2, len(rows)), rng.uniform(0, 90, len(rows))
        crates = [(*place, 0.6, 0.6, angle, 2e-6, 0.005) for *place, angle in zip(x, rows, yaw, strict=True)]
        return [(DOOR, 0, 0.4, 2.5, 0, 0, 0), *wall, *crates]

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses = place_robots(config.arena, 4 * n_robots, rng, cell)
        before = poses[poses[:, 0] < mm_from_rd(DOOR) - 2 * RD][:n_robots]
        boxes = poses_of_boxes(config.arena.boxes).astype(np.float32)
        return before, Passage(np.int32(0), boxes, np.float32(0))

    def goal(self, config, n_robots):
        return 100

    def advance(self, state, inputs, key):
        door = jnp.where(state.step >= self.opens, mm_from_rd(5.0), 0.0)
        through = (inputs.poses[:, 0] > mm_from_rd(WALL)) & inputs.is_present
        share = through.sum(dtype=jnp.float32) / inputs.is_present.sum()
        return Passage(state.step + 1, state.boxes.at[0, 1].set(door), share), without_balls(len(through))

    def drive_boxes(self, state):
        return state.boxes

    def progress(self, state):
        return jnp.floor(100 * state.share).astype(jnp.int32)

    def reward(self, before, after, inputs):
        return (inputs.poses[:, 0] > mm_from_rd(WALL)).astype(jnp.float32)

    def metrics(self, state):
        return {"through": state.share}
