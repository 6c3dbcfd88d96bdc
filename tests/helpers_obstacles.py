"""An arena with four boxes, and crowds of robots in it."""

import numpy as np

from iswarm_mj.config import ArenaConfig, DriveConfig, SwarmConfig
from iswarm_mj.tasks.layout import place_robots

BOXES = (
    (4.0, 3.0, 2.0, 0.3, 30.0),
    (-4.0, -3.0, 0.4, 1.5, -70.0),
    (0.0, 5.0, 1.0, 1.0, 0.0),
    (-5.0, 4.0, 0.2, 0.2, 10.0),
)
CONFIG = SwarmConfig(
    ArenaConfig(size=15, dump_size=3, dust_area_size=2, dust_area_offset=5.5, n_dust=2, obstacles=BOXES), DriveConfig()
)
N = 40


def starts(seed):
    rng = np.random.default_rng(seed)
    return np.stack([place_robots(CONFIG.arena, N, rng) for _ in range(3)])
