"""Batches of trials."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import PAPER_GAPS, Gaps, Protocol
from iswarm_mj.gripper.bench.ramps import Attempt, Release, no_contact, release
from iswarm_mj.gripper.bench.staircase import Grasp, hang, staircase
from iswarm_mj.gripper.bench.trial import Trial

LARGEST_BATCH = 1024
"""Trials that run at once."""


class Outcomes(NamedTuple):
    """Outcomes of N trials."""

    grasp: Grasp
    release: dict[float, Release]
    """By the gap to the plate [m]; meaningless for balls that were not lifted."""
    no_contact: dict[float, Attempt]
    """By the gap to the tool [m]."""
    timestep: float
    """[s]"""


def run_trials(
    trials: Sequence[Trial],
    protocol: Protocol,
    gaps: Gaps = PAPER_GAPS,
    threads: int = 0,
    progress: Callable[[int], object] = lambda done: None,
) -> Outcomes:
    """Run each trial: attempts without contact, staircase of grasps, and releases of the lifted ball.

    Args:
        trials: N trials.
        protocol: motion and voltage of the tool.
        gaps: of releases and of attempts without contact.
        threads: 0 for one a core; results do not depend on it.
        progress: called with the number of trials that have finished since the last call.
    """
    parts = []
    for first in range(0, len(trials), LARGEST_BATCH):
        batch = trials[first : first + LARGEST_BATCH]
        parts.append(_run(MujocoBench(batch, protocol.start_gap, threads), len(batch), protocol, gaps))
        progress(len(batch))
    return Outcomes(
        _joined([part.grasp for part in parts]),
        {gap: _joined([part.release[gap] for part in parts]) for gap in gaps.release},
        {gap: _joined([part.no_contact[gap] for part in parts]) for gap in gaps.no_contact},
        parts[0].timestep,
    )


def _run(bench: MujocoBench, count: int, protocol: Protocol, gaps: Gaps) -> Outcomes:
    start, attempts = bench.save(), {}
    for gap in gaps.no_contact:
        bench.restore(start)
        attempts[gap] = no_contact(bench, protocol, gap, count)
    bench.restore(start)
    grasp = staircase(bench, protocol, count)
    lifted, held = bench.save(), np.isfinite(grasp.voltage) & ~grasp.faulty
    releases = {}
    for gap in gaps.release:
        bench.restore(lifted)
        hung = hang(bench, protocol, gap, held)
        releases[gap] = release(bench, protocol, held & hung, gap)
    return Outcomes(grasp, releases, attempts, bench.timestep)


def _joined(parts):
    """Named tuples of arrays, concatenated."""
    return type(parts[0])(*map(np.concatenate, zip(*parts, strict=True)))
