"""Crowds that press upon each other, with the longest physics steps that are allowed and others.

They fill the arena. No two robots change sides, which would show as centres that pass each other
at less than half a robot, and none leaves the arena. Units: mm, s.
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
EDGE = mm_from_rd(ARENA.size) / 2
N_ROBOTS = 95
N_STEPS = 15
"""Control steps."""
FIRST, SECOND = np.triu_indices(N_ROBOTS, 1)
"""Robots of each pair."""
HALF_ROBOT = 1.0
COURSES = ["centre", "corner", "to and fro", "at random"]

LONGEST = DriveConfig(step_length=6 * LONGEST_STEP, max_turn=4 * LARGEST_TURN)
FEWEST = DriveConfig(
    step_length=LONGEST_STEP,
    walk_substeps=1,
    max_turn=LARGEST_TURN,
    turn_substeps=1,
)
SHORT_PERIOD = replace(LONGEST, control_period=0.1)


def crowd_moves(drive, course, make_engine, n_steps=N_STEPS):
    """Return the nearest pass of two centres in any physics step [mm], and all faults.

    Args:
        drive: all robots use its longest steps and largest turns.
        course: the robots walk to the centre, to one corner, to and fro between random places, or
            turn at random.
        make_engine: returns the engine of a configuration.
        n_steps: control steps.
    """
    rng = np.random.default_rng(0)
    poses = place_robots(ARENA, N_ROBOTS, rng)[None]
    engine = make_engine(SwarmConfig(arena=ARENA, drive=drive))
    bodies = engine.place(poses, np.ones((1, N_ROBOTS), bool))
    places = {
        "centre": 0.0,
        "corner": EDGE,
        "to and fro": rng.uniform(-EDGE, EDGE, (1, N_ROBOTS, 2)),
    }
    max_turn = np.radians(drive.max_turn)
    forward = np.full((1, N_ROBOTS), mm_from_rd(drive.step_length))

    nearest = np.inf
    faults = 0
    for step in range(n_steps):
        if course == "at random":
            turn = rng.choice([-max_turn, max_turn], (1, N_ROBOTS))
        else:
            direction = (-1) ** (step // 5)
            turn = turn_towards(poses, direction * np.asarray(places[course]), max_turn)

        # Look at each physics step.
        for phase in drive_phases(drive, Command(turn, forward)):
            velocity = phase.velocity(poses)
            for _ in range(phase.n_substeps):
                before = poses
                substep = Phase(1, lambda _, held=velocity: held)
                motion = engine.move(bodies, [substep], np.ones(1, bool))
                bodies = motion.bodies
                poses = engine.poses(bodies)
                nearest = min(nearest, nearest_pass(before, poses))
                faults |= int(motion.fault.max())
    return nearest, faults


def turn_towards(poses, place, max_turn):
    """Return turns of robots towards a place, up to the largest turn [rad]."""
    offset = place - poses[..., :2]
    angle = np.arctan2(offset[..., 1], offset[..., 0]) - poses[..., 2]
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    return np.clip(wrapped, -max_turn, max_turn)


def nearest_pass(before, after):
    """Return the smallest distance of two centres on straight paths between poses [mm]."""
    start = before[:, FIRST, :2] - before[:, SECOND, :2]
    end = after[:, FIRST, :2] - after[:, SECOND, :2]
    path = end - start
    squared_length = np.maximum((path**2).sum(-1), 1e-12)
    share = np.clip(-(start * path).sum(-1) / squared_length, 0, 1)
    return np.linalg.norm(start + share[..., None] * path, axis=-1).min()


def random_drive(rng):
    """Return a drive anywhere in its ranges.

    Where it moves too far in a physics step, the error states how many physics steps it needs.
    """
    step_length = float(rng.uniform(0.01, 1.0))
    max_turn = float(rng.uniform(1, 180))
    walk_substeps = int(rng.integers(1, 30))
    turn_substeps = int(rng.integers(1, 30))
    control_period = float(10 ** rng.uniform(-1, 2))
    try:
        return DriveConfig(step_length, control_period, turn_substeps, walk_substeps, max_turn)
    except ConfigError as error:
        least_walks = int(np.ceil(step_length / LONGEST_STEP))
        least_turns = int(np.ceil(max_turn / LARGEST_TURN))
        remedies = (f"at least {least_walks} with", f"at least {least_turns} with")
        assert any(remedy in str(error) for remedy in remedies)
        assert walk_substeps < least_walks or turn_substeps < least_turns
        walk_substeps = max(walk_substeps, least_walks)
        turn_substeps = max(turn_substeps, least_turns)
        return DriveConfig(step_length, control_period, turn_substeps, walk_substeps, max_turn)


def planar(config):
    """Return the planar engine of a configuration."""
    return PlanarEngine(config, compile_arena(config, 1, np.zeros(0)), 1)


def mujoco(config):
    """Return MuJoCo in C of a configuration."""
    return MujocoEngine(config, compile_arena(config, N_ROBOTS, np.zeros(0)), 1, 1, N_ROBOTS)


SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 60))]


@pytest.mark.parametrize("seed", SEEDS)
def test_robots_keep_their_sides_anywhere_in_the_ranges(seed):
    """Drives and courses of robots are random; every third time MuJoCo in C moves them, too."""
    rng = np.random.default_rng(seed)
    drive = random_drive(rng)
    course = COURSES[rng.integers(4)]
    for make_engine in (planar, mujoco) if seed % 3 == 0 else (planar,):
        nearest, faults = crowd_moves(drive, course, make_engine, 6)
        assert nearest > HALF_ROBOT, drive
        assert faults == 0, drive


@pytest.mark.parametrize(
    ("drive", "course"),
    [
        pytest.param(LONGEST, "centre", id="longest to the centre"),
        pytest.param(LONGEST, "corner", id="longest to a corner"),
        pytest.param(FEWEST, "to and fro", id="fewest"),
        pytest.param(SHORT_PERIOD, "at random", id="short period"),
    ],
)
def test_planar_robots_keep_their_sides(drive, course):
    nearest, faults = crowd_moves(drive, course, planar)
    assert nearest > HALF_ROBOT
    assert faults == 0


def test_robots_of_mujoco_keep_their_sides():
    nearest, faults = crowd_moves(LONGEST, "centre", mujoco, 6)
    assert nearest > HALF_ROBOT
    assert faults == 0
