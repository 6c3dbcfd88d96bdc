"""Boxes that robots push: some of all kinds, in a small arena."""

import numpy as np

from iswarm_mj.config import ArenaConfig
from iswarm_mj.utils.obstacles import poses_of
from iswarm_mj.utils.units import RD

ARENA = ArenaConfig(size=15, dump_size=3, dust_area_size=2, dust_area_offset=5.5, n_dust=2)
BOXES = (
    (4.0, 3.0, 1.0, 0.6, 30.0, 4e-6, 0.005),
    (-4.0, -3.0, 0.7, 0.7, 45.0, 8e-6, 0.01),
    (0.0, 5.0, 2.4 / RD / 2, 1.6 / RD / 2, 0.0, 5e-6, 0.003),
    (-5.0, 4.0, 1.2, 0.3, 10.0, 1e-5, 0.002),
    (3.0, -4.0, 0.6, 0.6, 0.0, 3e-5, 0.5),
)


def placed(engine, robots, boxes):
    """Bodies of robots (B, N, 3) with the boxes of an arena."""
    robots = np.asarray(robots, float)
    start = np.tile(poses_of(boxes), (len(robots), 1, 1))
    return engine.place(np.concatenate([robots, start], axis=1), np.ones(robots.shape[:2], bool))
