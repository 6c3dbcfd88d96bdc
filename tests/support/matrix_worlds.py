"""Worlds of the matrix: two arenas, three settings of each, and the part that each robot plays.

Units: mm, rd, rad.
"""

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
GATES = (0, 1)
"""Indices of the gates in `BOXES`."""
PUSHED = 2
"""Index of the box that a robot pushes."""
UNTOUCHED = 3
"""Index of the box that nobody touches."""
BOXES = (
    (5.0, 4.0, 0.5, 1.0, 0.0, 0.0, 0.0),
    (5.0, -4.0, 0.5, 1.0, 0.0, 0.0, 0.0),
    (-8.0, -5.0, 0.5, 0.5, 0.0, 1e-6, 0.005),
    (-2.0, -6.5, 0.5, 0.5, 30.0, 1e-6, 0.005),
)
"""Fields of `ArenaConfig.boxes`; the gates have no mass."""

ARENAS = {"square": {"size": 30.0}, "rectangle": {"outline": ((24.0, 16.0),)}}
"""Walls of the arenas [rd]."""
SETTINGS = (
    {"dump_size": 4.0, "dust_area_size": 3.0, "dust_area_offset": 8.0},
    {"dump_size": 3.0, "dust_area_size": 2.5, "dust_area_offset": 9.0},
    {"dump_size": 4.5, "dust_area_size": 2.0, "dust_area_offset": 10.0},
)
"""Settings of the worlds, none of them the default [rd]."""


def config_of(arena: str, world: int) -> SwarmConfig:
    """Return the configuration of a world in one of the arenas."""
    gripper = GripperConfig(
        grasp_voltage=41.0 + world,
        drop_rate=1e-6 * (1 + world),
        spread_tool_object=0.0,
        spread_object_substrate=0.0,
    )
    return SwarmConfig(
        arena=ArenaConfig(
            n_dust=6,
            obstacles=OBSTACLES,
            boxes=BOXES,
            **ARENAS[arena],
            **SETTINGS[world],
        ),
        drive=DriveConfig(error_turn=2.0 + world),
        gripper=gripper,
    )


CHANGES = {"arena.dump_size": 4.2, "drive.error_turn": 6.0}
"""Settings that change while the page is open."""


def changed(config: SwarmConfig) -> SwarmConfig:
    """Return the configuration after `CHANGES`."""
    arena = replace(config.arena, dump_size=CHANGES["arena.dump_size"])
    return replace(config, arena=arena, drive=DriveConfig(error_turn=CHANGES["drive.error_turn"]))


MORTAL = (1, 5)
"""Robots that die in tasks with deaths."""
AT_WALL = 3
"""Robot that presses against the east wall."""
AT_DUMP = 4
"""Robot whose tool reaches over larger dumps."""
AT_OBSTACLE = 7
"""Robot that presses against the obstacle."""
AT_BOX = 9
"""Robot that pushes a box."""
AT_GATE = 11
"""Robot that presses against a gate."""
HOLDERS = (0, 1, 2, AT_DUMP, 5)
"""Robots at whose tools the first balls lie."""


def places(arena: ArenaConfig) -> np.ndarray:
    """Return the poses of all robots at the start; every second one will drive ahead."""
    east_wall = max(x for x, _ in arena.corners) * RD
    obstacle_x, obstacle_y, half_edge, *_ = OBSTACLES[0]
    diagonally = (half_edge * RD + 2.2) * math.sqrt(0.5)
    box_x, box_y, box_half, *_ = BOXES[PUSHED]
    gate_x, gate_y, gate_half, *_ = BOXES[GATES[1]]
    poses = {
        0: (-28.0, 13.0, 0.0),
        1: (-28.0, 10.0, 0.0),
        2: (-17.8, 10.0, math.pi),
        AT_WALL: (east_wall - 2.2, 8.5, 0.0),
        AT_DUMP: (3.9, 0.0, 0.0),
        5: (22.0, 5.0, 0.0),
        6: (26.0, 5.0, math.pi),
        AT_OBSTACLE: (obstacle_x * RD - diagonally, obstacle_y * RD - diagonally, math.pi / 4),
        8: (0.0, -12.0, 0.0),
        AT_BOX: ((box_x - box_half) * RD - 1.7, box_y * RD, 0.0),
        10: (0.0, -15.5, 0.0),
        AT_GATE: ((gate_x - gate_half) * RD - 2.2, gate_y * RD, 0.0),
    }
    return np.array([poses[robot] for robot in range(N)])
