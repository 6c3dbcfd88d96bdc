"""Long runs: memory stays as it is, and at each step everything is where it can be.

`pytest -m slow tests/robustness/test_soak.py` takes hours.
"""

import numpy as np
import pytest
from support.files import memory_mb
from support.worlds import start_of

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.sensors.floor import probe_tips
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.units import mm_from_m, mm_from_rd
from iswarm_mj.workflows.recorder import Recorder

OUTSIDE_MM = 0.4
"""Largest distance beyond a wall of a corner of a robot that others press against it [mm]."""
ROUNDING_MM = 1e-4
"""Largest error of rounding of a place [mm]."""
ROUNDING = 1 + 1e-6
"""Largest ratio of a command to its limit, by rounding."""
GROWTH_MB = 50
"""Largest growth of memory after the first fifth of a run [MB]; the C library keeps some."""
INDEX_KB = 0.3
"""Further growth at each step [kB]: Rerun keeps an index of what it wrote until the file ends."""
N_PARTS = 200
"""Number of parts of a run after which the memory is measured."""


def endless_run(n_robots, steps):
    """Return a run that never ends early, as one ball sticks for ever."""
    genome = PRESETS["type1"]
    config = SwarmConfig()
    start = start_of(config, n_robots, 0, 0)
    works = start.task.work_object_substrate.copy()
    works[0] = 10.0
    start = start._replace(task=start.task._replace(work_object_substrate=works))
    scenario = Scenario(
        config,
        strategy=genome,
        robots=n_robots,
        engine=PlanarSettings(1),
        worlds=[World(genome, n_robots, start=start)],
        steps=steps,
    )
    return Run(scenario)


# What holds at each step.


def of_first_world(array):
    """Return the part of a record's array that belongs to its one step and world."""
    return np.asarray(array)[0, 0]


def assert_step_is_possible(run, before, record):
    """Assert the invariants of one control step.

    Args:
        run: run of the swarm.
        before: record of the step before, with axes (1, 1).
        record: record of the step, with axes (1, 1).
    """
    assert_balls_are_somewhere(run.config, before, record)
    assert_picked_balls_were_in_reach(run, before, record)
    assert_commands_are_allowed(run.config, record)
    assert_robots_are_within_walls(run, record)


def assert_balls_are_somewhere(config, before, record):
    """Assert that each ball is held, delivered, or on the floor."""
    balls = record.swarm.task
    is_held = of_first_world(balls.is_held)
    is_delivered = of_first_world(balls.is_delivered)
    holders = of_first_world(balls.holder)[is_held]
    assert not (is_held & is_delivered).any()
    assert len(np.unique(holders)) == len(holders)

    # Delivered balls stay, on the dump. The first ball sticks.
    was_delivered = of_first_world(before.swarm.task.is_delivered)
    assert is_delivered[was_delivered].all()
    distance = np.abs(of_first_world(balls.position)[is_delivered]).max(initial=0)
    assert distance <= mm_from_rd(config.arena.dump_size) / 2 + ROUNDING_MM
    assert not is_held[0]
    assert not is_delivered[0]


def assert_picked_balls_were_in_reach(run, before, record):
    """Assert that balls which robots picked up were in reach of their tools."""
    balls_before = before.swarm.task
    balls = record.swarm.task
    is_picked = of_first_world(balls.is_held) & ~of_first_world(balls_before.is_held)
    poses = of_first_world(before.poses).astype(np.float32)
    tips = np.asarray(probe_tips(poses, np.asarray(run.robot.probe_tip, np.float32)))
    tip_of_ball = tips[of_first_world(balls.holder)]
    distance = np.linalg.norm(tip_of_ball - of_first_world(balls_before.position), axis=1)
    assert (distance[is_picked] <= mm_from_m(run.config.gripper.tool_reach) + ROUNDING_MM).all()


def assert_commands_are_allowed(config, record):
    """Assert that robots turn and walk by no more than their limits."""
    turn, forward = map(of_first_world, record.command)
    assert np.abs(turn).max() <= np.radians(config.drive.max_turn) * ROUNDING
    assert np.abs(forward).max() <= mm_from_rd(config.step_length) * ROUNDING


def corners(poses, half_edges):
    """Return the corners of robots (2, N, 4) [mm].

    Args:
        poses: x, y and yaw of the robots (N, 3) [mm, mm, rad].
        half_edges: half their lengths ahead and aside [mm].
    """
    x, y, yaw = poses.T[..., None]
    ahead = half_edges[0] * np.array([1, 1, -1, -1])
    aside = half_edges[1] * np.array([1, -1, 1, -1])
    corner_x = x + np.cos(yaw) * ahead - np.sin(yaw) * aside
    corner_y = y + np.sin(yaw) * ahead + np.cos(yaw) * aside
    return np.array([corner_x, corner_y])


def assert_robots_are_within_walls(run, record):
    """Assert that the corners of all robots are within the walls, or hardly beyond them."""
    poses = of_first_world(record.poses)
    assert np.isfinite(poses).all()
    farthest = np.abs(corners(poses, run.robot.half_edges)).max()
    assert farthest <= mm_from_rd(run.config.arena.size) / 2 + OUTSIDE_MM


# Memory.


def soak(n_robots, steps, out):
    """Record a run, assert what holds at each step, and return the memory after each part [MB]."""
    run = endless_run(n_robots, steps)
    recorder = Recorder(run, out / "clean.rrd", 0, out)
    before = run.start
    memory = []
    while not run.is_over:
        record = run.advance()
        recorder.add(record)
        assert_step_is_possible(run, before, record)
        before = record
        if run.step % part_length(steps) == 0:
            memory.append(memory_mb())
            print(f"{n_robots} robots, step {run.step}: {memory[-1]:.0f} MB", flush=True)
    recorder.save()
    run.raise_faults()
    with np.load(out / "trajectory.npz") as file:
        assert len(file["step"]) == run.step + 1
        assert file["pose"][-1].shape == (n_robots, 3)
    return memory


def part_length(steps):
    """Return the number of control steps between two measurements of memory."""
    return max(steps // N_PARTS, 1)


@pytest.mark.slow
def test_invariants_hold_at_each_step_of_a_short_run(tmp_path):
    assert len(soak(20, 200, tmp_path)) == N_PARTS


@pytest.mark.slow
@pytest.mark.parametrize(("n_robots", "steps"), [(20, 1_000_000), (283, 100_000)])
def test_memory_is_flat(n_robots, steps, tmp_path):
    memory = soak(n_robots, steps, tmp_path)
    first = len(memory) // 5
    later_steps = (len(memory) - 1 - first) * part_length(steps)
    growth = max(memory[first:]) - memory[first]
    assert growth < GROWTH_MB + INDEX_KB / 1e3 * later_steps, memory
