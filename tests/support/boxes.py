"""Boxes that robots push, of all kinds, in a small arena."""

import numpy as np

from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.geometry.obstacles import poses_of_boxes
from iswarm_mj.utils.units import RD
from support.mujoco import in_joints

ARENA = ArenaConfig(size=15, dump_size=3, dust_area_size=2, dust_area_offset=5.5, n_dust=2)
"""A small arena without boxes."""
BOXES = (
    (4.0, 3.0, 1.0, 0.6, 30.0, 4e-6, 0.005),
    (-4.0, -3.0, 0.7, 0.7, 45.0, 8e-6, 0.01),
    (0.0, 5.0, 2.4 / RD / 2, 1.6 / RD / 2, 0.0, 5e-6, 0.003),
    (-4.5, 4.0, 1.2, 0.3, 10.0, 1e-5, 0.002),
    (3.0, -4.0, 0.6, 0.6, 0.0, 3e-5, 0.5),
)
"""Fields of `ArenaConfig.boxes`: place and half edges [rd], angle [deg], mass [kg], friction."""


def placed(engine, robots, boxes):
    """Return bodies at rest: robots at poses (B, N, 3), with the boxes of an arena."""
    robots = np.asarray(robots, float)
    start = np.tile(poses_of_boxes(boxes), (len(robots), 1, 1))
    return engine.place(np.concatenate([robots, start], axis=1), np.ones(robots.shape[:2], bool))


def moving(engine, bodies, poses, velocities):
    """Return robots and boxes at poses (*B, N + M, 3) with these velocities."""
    dtype = np.asarray(bodies.poses).dtype
    poses = np.asarray(poses, dtype)
    velocities = np.asarray(velocities, dtype)
    if isinstance(engine, MujocoEngine):
        velocities = in_joints(engine, velocities)
    return bodies._replace(poses=poses, velocity=velocities)
