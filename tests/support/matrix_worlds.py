"""Worlds of the matrix: two arenas, three settings of each, and the part that each robot plays.
Units: mm, rd, rad."""

import math
from dataclasses import replace

import numpy as np

from iswarm_mj.config.swarm import ArenaConfig, DriveConfig, GripperConfig, SwarmConfig
from iswarm_mj.utils.units import RD

NUMBERS = (12, 10, 8)
"""Robots in the worlds of a run of three; all others have the first number."""
N = NUMBERS[0]
STEPS = 5

OBSTACLES = ((-4.0, 5.0, 1.0, 1.0, 45.0),)
GATES, PUSHED, UNTOUCHED = (0, 1), 2, 3
BOXES = (
    (5.0, 4.0, 0.5, 1.0, 0.0, 0.0, 0.0),
    (5.0, -4.0, 0.5, 1.0, 0.0, 0.0, 0.0),
    (-8.0, -5.0, 0.5, 0.5, 0.0, 1e-6, 0.005),
    (-2.0, -6.5, 0.5, 0.5, 30.0, 1e-6, 0.005),
)
"""Two gates of mass 0; a box that robot 9 pushes; one that nobody touches."""

STANDING = {"square": {"size": 30.0}, "rectangle": {"outline": ((24.0, 16.0),)}}
SETTINGS = (
    {"dump_size": 4.0, "dust_area_size": 3.0, "dust_area_offset": 8.0},
    {"dump_size": 3.0, "dust_area_size": 2.5, "dust_area_offset": 9.0},
    {"dump_size": 4.5, "dust_area_size": 2.0, "dust_area_offset": 10.0},
)
"""Of the worlds, in rd; none is the default."""


def config_of(arena: str, world: int) -> SwarmConfig:
    """Return the configuration of a world in one of the arenas."""
    return SwarmConfig(
        arena=ArenaConfig(
            n_dust=6, obstacles=OBSTACLES, boxes=BOXES, **STANDING[arena], **SETTINGS[world]
        ),
        drive=DriveConfig(error_turn=2.0 + world),
        gripper=GripperConfig(
            grasp_voltage=41.0 + world,
            drop_rate=1e-6 * (1 + world),
            spread_tool_object=0.0,
            spread_object_substrate=0.0,
        ),
    )


def changed(config: SwarmConfig) -> SwarmConfig:
    """Return the configuration after the changes that the page makes, `CHANGES`."""
    arena = replace(config.arena, dump_size=CHANGES["arena.dump_size"])
    return replace(config, arena=arena, drive=DriveConfig(error_turn=CHANGES["drive.error_turn"]))


CHANGES = {"arena.dump_size": 4.2, "drive.error_turn": 6.0}

MORTAL = (1, 5)
"""Robots that die in tasks with deaths."""
AT_WALL, AT_DUMP, AT_OBSTACLE, AT_BOX, AT_GATE = 3, 4, 7, 9, 11
"""Robots that press against the east wall, the obstacle, a box and a gate, and one that stands in
larger dumps."""
HOLDERS = (0, 1, 2, AT_DUMP, 5)
"""Robots at whose tools the first balls lie."""


def places(arena: ArenaConfig) -> np.ndarray:
    """Return the poses of all robots at the start; every second one will drive ahead, the others
    stand."""
    east = max(x for x, _ in arena.corners) * RD
    obstacle_x, obstacle_y, half_edge, *_ = OBSTACLES[0]
    aside = (half_edge * RD + 2.2) * math.sqrt(0.5)
    box_x, box_y, box_half, *_ = BOXES[PUSHED]
    gate_x, gate_y, gate_half, *_ = BOXES[GATES[1]]
    poses = {
        0: (-28.0, 13.0, 0.0),
        1: (-28.0, 10.0, 0.0),
        2: (-17.8, 10.0, math.pi),
        AT_WALL: (east - 2.2, 8.5, 0.0),
        AT_DUMP: (3.9, 0.0, 0.0),
        5: (22.0, 5.0, 0.0),
        6: (26.0, 5.0, math.pi),
        AT_OBSTACLE: (obstacle_x * RD - aside, obstacle_y * RD - aside, math.pi / 4),
        8: (0.0, -12.0, 0.0),
        AT_BOX: ((box_x - box_half) * RD - 1.7, box_y * RD, 0.0),
        10: (0.0, -15.5, 0.0),
        AT_GATE: ((gate_x - gate_half) * RD - 2.2, gate_y * RD, 0.0),
    }
    return np.array([poses[robot] for robot in range(N)])
