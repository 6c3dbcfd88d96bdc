"""A door opens after some time; boxes lie behind it, at other places in each world.

    iswarm run --task examples/door.py:Door --strategy examples/explore.py:Explore \
        --robots 30 --steps 300 --worlds 2 --arena.size 30 --arena.dump-size 1 --engine planar

A wall of two boxes of mass 0 divides the arena. The door, another box of mass 0, slides along it.
Robots push the crates, which have a mass.
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

WALL_X = 4.0
"""x of the wall [rd]."""
DOOR_X = 2.8
"""x of the door [rd]."""
OPEN_Y = 5.0
"""y of the open door [rd]."""
GAP = 2.0
"""Half the width of the gap in the wall [rd]."""


class Passage(NamedTuple):
    """State of the task."""

    step: np.ndarray
    """Control steps since the start."""
    boxes: np.ndarray
    """Poses where the boxes of mass 0 are to be: x, y [mm] and yaw [rad]."""
    share: np.ndarray
    """Share of the robots behind the wall."""


@dataclass(frozen=True)
class Door(Task):
    """Walk through the door."""

    opens: Annotated[int, Within(1, 10_000)] = 100
    """Control step in which the door opens."""
    n_crates: Annotated[int, Within(0, 20)] = 3
    """Number of crates behind it."""

    measured: ClassVar = {"through": Quantity("share of the robots behind the wall", high=1.0)}
    unused: ClassVar = ("gripper", "arena.n_dust")

    def lay_boxes(self, config, rng, shared):
        """Return the door, the two parts of the wall, and the crates.

        Each box is x, y, half edges [rd], yaw [deg], mass [kg] and friction with the floor.
        """
        end = config.arena.size / 2

        door = (DOOR_X, 0, 0.4, 2.5, 0, 0, 0)
        middle = (end + GAP) / 2
        half_length = (end - GAP) / 2 - 0.1
        south = (WALL_X, -middle, 0.4, half_length, 0, 0, 0)
        north = (WALL_X, middle, 0.4, half_length, 0, 0, 0)

        x = rng.uniform(WALL_X + 2, end - 2, self.n_crates)
        y = np.linspace(3 - end, end - 3, self.n_crates)
        yaw = rng.uniform(0, 90, self.n_crates)
        crates = [(x[k], y[k], 0.6, 0.6, yaw[k], 2e-6, 0.005) for k in range(self.n_crates)]
        return [door, south, north, *crates]

    def lay_out(self, config, n_robots, rng, shared, cell):
        # Robots start in front of the door: place more of them, and keep those that are there.
        poses = place_robots(config.arena, 4 * n_robots, rng, cell)
        is_in_front = poses[:, 0] < mm_from_rd(DOOR_X) - 2 * RD
        poses = poses[is_in_front][:n_robots]

        boxes = poses_of_boxes(config.arena.boxes).astype(np.float32)
        return poses, Passage(step=np.int32(0), boxes=boxes, share=np.float32(0))

    def goal(self, config, n_robots):
        return 100

    def advance(self, state, inputs, key):
        is_open = state.step >= self.opens
        door_y = jnp.where(is_open, mm_from_rd(OPEN_Y), 0.0)

        is_through = (inputs.poses[:, 0] > mm_from_rd(WALL_X)) & inputs.is_present
        share = is_through.sum(dtype=jnp.float32) / inputs.is_present.sum()

        state = Passage(
            step=state.step + 1,
            boxes=state.boxes.at[0, 1].set(door_y),
            share=share,
        )
        return state, without_balls(n_robots=len(is_through))

    def drive_boxes(self, state):
        return state.boxes

    def progress(self, state):
        return jnp.floor(100 * state.share).astype(jnp.int32)

    def reward(self, before, after, inputs):
        is_through = inputs.poses[:, 0] > mm_from_rd(WALL_X)
        return is_through.astype(jnp.float32)

    def metrics(self, state):
        return {"through": state.share}
