"""Batches of trials, in any engine."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.base import Bench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.ramps import Attempt, Release, no_contact, release
from iswarm_mj.gripper.bench.staircase import Grasp, hang, staircase
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import RELEASE_GAP
from iswarm_mj.utils.errors import UserError

LARGEST_BATCH = {"mujoco": 1024, "mjx": 16384}
"""Trials at once."""


class Outcomes(NamedTuple):
    """What N trials showed."""

    grasp: Grasp
    release: dict[float, Release]
    """By the gap to the plate [m]; of balls that were not lifted nothing is known."""
    no_contact: dict[float, Attempt]
    """By the gap to the tool [m]."""
    timestep: float
    """[s]"""
    steps: int
    """Physics steps of all trials together."""


def run_trials(
    trials: Sequence[Trial],
    protocol: Protocol,
    engine: str = "mujoco",
    impl: str = "jax",
    threads: int = 0,
    release_gaps: Sequence[float] = (RELEASE_GAP,),
    no_contact_gaps: Sequence[float] = (),
    progress: Callable[[int], object] = lambda done: None,
) -> Outcomes:
    """Run each trial: attempts without contact, staircase of grasps, and releases of the lifted ball.

    Args:
        trials: N of them.
        protocol: what the tool does.
        engine: "mujoco", in C with the plugins, or "mjx".
        impl: "jax" or "warp", of MJX.
        threads: of the C engine, 0 for one a core; results do not depend on it.
        release_gaps: between ball and plate [m].
        no_contact_gaps: between tool and ball [m].
        progress: called with the number of trials that were finished.
    """
    make = bench_maker(engine, impl, threads)
    size = LARGEST_BATCH[engine]
    parts = []
    for first in range(0, len(trials), size):
        batch = trials[first : first + size]
        parts.append(_run(make, batch, protocol, release_gaps, no_contact_gaps))
        progress(len(batch))
    return Outcomes(
        _joined([part.grasp for part in parts]),
        {gap: _joined([part.release[gap] for part in parts]) for gap in release_gaps},
        {gap: _joined([part.no_contact[gap] for part in parts]) for gap in no_contact_gaps},
        parts[0].timestep,
        sum(part.steps for part in parts),
    )


def bench_maker(engine: str, impl: str, threads: int) -> Callable[[Sequence[Trial], float], Bench]:
    """What makes benches in an engine.

    Raises:
        UserError: there is no such engine.
    """
    if engine == "mujoco":
        from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench

        return partial(MujocoBench, threads=threads)
    if engine == "mjx":
        from iswarm_mj.gripper.bench.engine_mjx import MjxBench

        return partial(MjxBench, impl=impl)
    raise UserError(f"The engine was {engine}; it must be mujoco or mjx: choose one.")


def _run(
    make: Callable[[Sequence[Trial], float], Bench],
    trials: Sequence[Trial],
    protocol: Protocol,
    release_gaps: Sequence[float],
    no_contact_gaps: Sequence[float],
) -> Outcomes:
    bench, count = make(trials, protocol.start_gap), len(trials)
    start = bench.save()
    apart = {}
    for gap in no_contact_gaps:
        bench.restore(start)
        apart[gap] = no_contact(bench, protocol, gap, count)
    bench.restore(start)
    grasp = staircase(bench, protocol, count)
    lifted, held = bench.save(), np.isfinite(grasp.voltage) & ~grasp.faulty
    dropped = {}
    for gap in release_gaps:
        bench.restore(lifted)
        hang(bench, protocol, gap, held)
        dropped[gap] = release(bench, protocol, held, gap)
    return Outcomes(grasp, dropped, apart, bench.timestep, bench.steps)


def _joined(parts):
    """Named tuples of arrays, one after the other."""
    return type(parts[0])(*map(np.concatenate, zip(*parts, strict=True)))
