"""Boxes that robots push: some of all kinds, in a small arena."""

import numpy as np

from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.geometry.obstacles import poses_of_boxes
from iswarm_mj.utils.units import RD

ARENA = ArenaConfig(size=15, dump_size=3, dust_area_size=2, dust_area_offset=5.5, n_dust=2)
BOXES = (
    (4.0, 3.0, 1.0, 0.6, 30.0, 4e-6, 0.005),
    (-4.0, -3.0, 0.7, 0.7, 45.0, 8e-6, 0.01),
    (0.0, 5.0, 2.4 / RD / 2, 1.6 / RD / 2, 0.0, 5e-6, 0.003),
    (-4.5, 4.0, 1.2, 0.3, 10.0, 1e-5, 0.002),
    (3.0, -4.0, 0.6, 0.6, 0.0, 3e-5, 0.5),
)


def placed(engine, robots, boxes):
    """Bodies of robots (B, N, 3) with the boxes of an arena."""
    robots = np.asarray(robots, float)
    start = np.tile(poses_of_boxes(boxes), (len(robots), 1, 1))
    return engine.place(np.concatenate([robots, start], axis=1), np.ones(robots.shape[:2], bool))


def at_start(engine, bodies, poses, velocities):
    """Put robots and boxes at poses (*B, N + M, 3) with these velocities."""
    if isinstance(engine, MujocoEngine):
        engine._qpos[:, engine._arena.qpos], engine._qvel[:, engine._arena.qpos] = poses, velocities
        engine._batch.forward()
        return engine._bodies(bodies.is_present, bodies.n_contacts)
    dtype = np.asarray(bodies.poses).dtype
    return bodies._replace(poses=np.asarray(poses, dtype), velocity=np.asarray(velocities, dtype))
