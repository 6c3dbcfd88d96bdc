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
"""A corner of a robot that others press against a wall stands beyond it by at most this."""
GROWTH_MB = 50
"""Memory may grow by this much after the first fifth of a run: the C library keeps what a block
took."""
INDEX_KB = 0.3
"""And by this much a step: Rerun keeps an index of what it wrote until the file ends."""
PARTS = 200
"""After which the memory is told."""


def swarm(n_robots, steps):
    """A recorded run that never ends early, since one ball sticks for ever."""
    config, genome = SwarmConfig(), PRESETS["type1"]
    start = start_of(config, n_robots, 0, 0)
    works = start.task.work_object_substrate.copy()
    works[0] = 10.0
    start = start._replace(task=start.task._replace(work_object_substrate=works))
    worlds = [World(genome, n_robots, start=start)]
    return Run(
        Scenario(
            config,
            strategy=genome,
            robots=n_robots,
            engine=PlanarSettings(1),
            worlds=worlds,
            steps=steps,
        )
    )


def check(run, before, record):
    """Invariants of one control step.

    Args:
        run: of the swarm.
        before: record of the step before.
        record: of the step, with axes (1, 1).
    """
    config, robot = run.config, run.robot
    balls, last = (r.swarm.task for r in (record, before))
    held, delivered, holder = (
        np.asarray(a)[0, 0] for a in (balls.is_held, balls.is_delivered, balls.holder)
    )
    position, was_held = np.asarray(balls.position)[0, 0], np.asarray(last.is_held)[0, 0]
    assert not (held & delivered).any() and held.sum() + delivered.sum() + (
        ~held & ~delivered
    ).sum() == len(held)
    assert len(np.unique(holder[held])) == held.sum()
    assert (
        (delivered | ~np.asarray(last.is_delivered)[0, 0]).all()
        and not held[0]
        and not delivered[0]
    )
    assert (
        np.abs(position[delivered]).max(initial=0) <= mm_from_rd(config.arena.dump_size) / 2 + 1e-4
    )
    poses = before.poses[0, 0]
    tips = np.asarray(probe_tips(poses.astype(np.float32), np.asarray(robot.probe_tip, np.float32)))
    reach = np.linalg.norm(tips[holder] - np.asarray(last.position)[0, 0], axis=1)[held & ~was_held]
    assert (reach <= mm_from_m(config.gripper.tool_reach) + 1e-4).all()
    turn, forward = (np.asarray(a)[0, 0] for a in record.command)
    assert np.abs(turn).max() <= np.radians(config.drive.max_turn) * (1 + 1e-6)
    assert np.abs(forward).max() <= mm_from_rd(config.step_length) * (1 + 1e-6)
    now = record.poses[0, 0]
    assert np.isfinite(now).all()
    corners = np.array([(x, y) for x in (-1, 1) for y in (-1, 1)]) * robot.half_edges[:2]
    cos, sin = np.cos(now[:, 2, None]), np.sin(now[:, 2, None])
    x = now[:, 0, None] + cos * corners[:, 0] - sin * corners[:, 1]
    y = now[:, 1, None] + sin * corners[:, 0] + cos * corners[:, 1]
    assert max(np.abs(x).max(), np.abs(y).max()) <= mm_from_rd(config.arena.size) / 2 + OUTSIDE_MM


def soak(n_robots, steps, out):
    """Memory after each part of a run [MB]."""
    run = swarm(n_robots, steps)
    recorder, before = Recorder(run, out / "clean.rrd", 0, out), run.start
    part, memory = max(steps // PARTS, 1), []
    while not run.is_over:
        record = run.advance()
        recorder.add(record)
        check(run, before, record)
        before = record
        if run.step % part == 0:
            memory.append(memory_mb())
            print(f"{n_robots} robots, step {run.step}: {memory[-1]:.0f} MB", flush=True)
    recorder.save()
    run.raise_faults()
    with np.load(out / "trajectory.npz") as file:
        assert len(file["step"]) == run.step + 1 and file["pose"][-1].shape == (n_robots, 3)
    return memory


def test_a_short_run_keeps_its_memory(tmp_path):
    """The invariants hold at each step."""
    assert len(soak(20, 200, tmp_path)) == PARTS


@pytest.mark.slow
@pytest.mark.parametrize(("n_robots", "steps"), [(20, 1_000_000), (283, 100_000)])
def test_memory_is_flat(n_robots, steps, tmp_path):
    memory = soak(n_robots, steps, tmp_path)
    first = len(memory) // 5
    later_steps = (len(memory) - 1 - first) * max(steps // PARTS, 1)
    assert max(memory[first:]) - memory[first] < GROWTH_MB + INDEX_KB / 1e3 * later_steps, memory
