"""Crowds that fill the arena and press upon each other, with the longest physics steps that are allowed and others.

No two robots change sides, which shows as centres that pass each other at less than half a robot, and none leaves the
arena. Units: mm, s.
"""

from dataclasses import replace

import numpy as np
import pytest

from iswarm_mj.config.static import LARGEST_TURN, LONGEST_STEP
from iswarm_mj.config.swarm import ArenaConfig, DriveConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.simulation.step import drive_phases
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import mm_from_rd

ARENA = ArenaConfig(size=10, dump_size=1, dust_area_size=1, dust_area_offset=3, n_dust=4)
N_ROBOTS, N_WORLDS, N_STEPS = 95, 1, 15
EDGE = mm_from_rd(ARENA.size) / 2
PAIRS = np.triu_indices(N_ROBOTS, 1)

LONGEST = DriveConfig(step_length=6 * LONGEST_STEP, max_turn=4 * LARGEST_TURN)
DRIVES = {
    "longest": LONGEST,
    "fewest": DriveConfig(step_length=LONGEST_STEP, walk_substeps=1, max_turn=LARGEST_TURN, turn_substeps=1),
    "quick": replace(LONGEST, control_period=0.1),
}


def crowd_moves(drive, where, engine_of, n_steps=N_STEPS):
    """Nearest pass of two centres in any physics step [mm], and all faults.

    Args:
        drive: all robots use its longest steps and largest turns.
        where: the robots walk to the centre, to one corner, to and fro between random places, or turn at random.
        engine_of: engine of a configuration.
        n_steps: control steps.
    """
    rng, config = np.random.default_rng(0), SwarmConfig(arena=ARENA, drive=drive)
    poses = np.stack([place_robots(ARENA, N_ROBOTS, rng) for _ in range(N_WORLDS)])
    engine, running = engine_of(config), np.ones(N_WORLDS, bool)
    bodies = engine.place(poses, np.ones(poses.shape[:2], bool))
    places = {"centre": 0.0, "corner": EDGE, "to and fro": rng.uniform(-EDGE, EDGE, (*poses.shape[:2], 2))}
    turn, nearest, faults = np.radians(drive.max_turn), np.inf, 0
    for step in range(n_steps):
        if where == "at random":
            turns = rng.choice([-turn, turn], poses.shape[:2])
        else:
            away = (-1) ** (step // 5) * np.asarray(places[where]) - poses[..., :2]
            ahead = np.arctan2(away[..., 1], away[..., 0]) - poses[..., 2]
            turns = np.clip((ahead + np.pi) % (2 * np.pi) - np.pi, -turn, turn)
        command = Command(turns, np.full(turns.shape, mm_from_rd(drive.step_length)))
        for phase in drive_phases(drive, command):
            velocity = phase.velocity(poses)
            for _ in range(phase.n_substeps):
                before = poses
                motion = engine.move(bodies, [Phase(1, lambda _, held=velocity: held)], running)
                bodies, poses = motion.bodies, engine.poses(motion.bodies)
                nearest, faults = min(nearest, nearest_pass(before, poses)), faults | int(motion.fault.max())
    return nearest, faults


def nearest_pass(before, after):
    """Smallest distance of two centres on straight ways between poses (B, N, 3) [mm]."""
    first, last = (p[:, PAIRS[0], :2] - p[:, PAIRS[1], :2] for p in (before, after))
    way = last - first
    share = np.clip(-(first * way).sum(-1) / np.maximum((way**2).sum(-1), 1e-12), 0, 1)
    return np.linalg.norm(first + share[..., None] * way, axis=-1).min()


def allowed(rng):
    """A drive anywhere in its ranges; where it moves too far in a physics step, what refuses it says what to change."""
    step, turn = float(rng.uniform(0.01, 1.0)), float(rng.uniform(1, 180))
    walks, turns, period = int(rng.integers(1, 30)), int(rng.integers(1, 30)), float(10 ** rng.uniform(-1, 2))
    try:
        return DriveConfig(step, period, turns, walks, turn)
    except ConfigError as error:
        least_walks, least_turns = int(np.ceil(step / LONGEST_STEP)), int(np.ceil(turn / LARGEST_TURN))
        assert f"at least {least_walks} with" in str(error) or f"at least {least_turns} with" in str(error)
        assert walks < least_walks or turns < least_turns
        return DriveConfig(step, period, max(turns, least_turns), max(walks, least_walks), turn)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 60))])
def test_robots_keep_their_sides_anywhere_in_the_ranges(seed):
    """Drives, and ways of robots, are drawn; on the planar engine, and every third time on MuJoCo in C too."""
    rng = np.random.default_rng(seed)
    drive, where = allowed(rng), ["centre", "corner", "to and fro", "at random"][rng.integers(4)]
    for engine_of in (planar, mujoco) if seed % 3 == 0 else (planar,):
        nearest, faults = crowd_moves(drive, where, engine_of, 6)
        assert nearest > 1.0 and faults == 0, drive


def planar(config, refinement=1):
    return PlanarEngine(config, compile_arena(config, 1, np.zeros(0), refinement=refinement), 1)


def mujoco(config):
    return MujocoEngine(config, compile_arena(config, N_ROBOTS, np.zeros(0)), N_WORLDS, 1, N_ROBOTS)


@pytest.mark.parametrize(
    ("drive", "where"),
    [
        *(("longest", where) for where in ("centre", "corner")),
        *(("fewest", "to and fro"), ("quick", "at random")),
    ],
)
def test_planar_robots_keep_their_sides(drive, where):
    nearest, faults = crowd_moves(DRIVES[drive], where, planar)
    assert nearest > 1.0 and faults == 0


def test_robots_of_mujoco_keep_their_sides():
    nearest, faults = crowd_moves(LONGEST, "centre", mujoco, 6)
    assert nearest > 1.0 and faults == 0
