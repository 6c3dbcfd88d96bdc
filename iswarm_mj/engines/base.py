"""What every engine can do."""

from typing import Protocol

import numpy as np

from iswarm_mj.utils.robot import Robot


class Engine(Protocol):
    """Rigid-body physics of B worlds with N robots and K balls each. Units: mm, mg, s, rad."""

    @property
    def robot(self) -> Robot:
        """Geometry and mass of a robot."""
        ...

    def reset(self, poses: np.ndarray, balls: np.ndarray) -> None:
        """Put the robots at rest at `poses` (B, N, 3) x, y, yaw, and the balls at `balls` (B, K, 3)."""
        ...

    def poses(self) -> np.ndarray:
        """Return the robots' x, y, yaw (B, N, 3); yaw is not wrapped."""
        ...

    def advance(self, velocity: np.ndarray, n_substeps: int, worlds: np.ndarray) -> None:
        """Take physics steps in which servos hold the robots' world velocities (B, N, 3) x, y, yaw.

        Args:
            velocity: target velocities [mm/s, mm/s, rad/s].
            n_substeps: number of physics steps.
            worlds: (W,) indices of the worlds that move; the others stand still.
        """
        ...

    def contacts(self, world: int) -> np.ndarray:
        """Return the pairs of robots in contact in the last physics step of a world.

        Each pair is one number (P,), lower index * N + higher index, and may come several times.
        """
        ...

    def cast_rays(
        self, world: np.ndarray, origin: np.ndarray, vector: np.ndarray, robot: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Cast horizontal rays at half the robots' height; each ignores the robot that sends it.

        Args:
            world: (P,) index of the world.
            origin: (P, 2) start [mm].
            vector: (P, 2) direction and length [mm].
            robot: (P,) index of the robot to ignore.

        Returns:
            Share of the vector's length at the first hit (P,), infinite for none; and what is hit (P,): the index
            of a robot, or a number from N on for a wall.
        """
        ...

    def move_balls(self, balls: np.ndarray) -> None:
        """Put the balls' centres at (B, K, 3) [mm]."""
        ...
