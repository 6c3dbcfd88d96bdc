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
from iswarm_mj.utils.errors import ConfigError

LARGEST_BATCH = {"mujoco": 1024, "mjx": 16384}
"""Trials that run at once."""


class EngineChoice(NamedTuple):
    """The engine in which benches run."""

    name: str = "mujoco"
    """"mujoco", in C with the plugins, or "mjx"."""
    impl: str = "jax"
    """Implementation of MJX, "jax" or "warp"."""
    threads: int = 0
    """Threads of the C engine, 0 for one a core; results do not depend on it."""


C_ENGINE = EngineChoice()


class Gaps(NamedTuple):
    """Gaps at which each trial is repeated."""

    release: tuple[float, ...] = (RELEASE_GAP,)
    """Between ball and plate at the release [m]."""
    no_contact: tuple[float, ...] = ()
    """Between tool and ball in attempts without contact [m]."""


PAPER_GAPS = Gaps()


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
    engine: EngineChoice = C_ENGINE,
    gaps: Gaps = PAPER_GAPS,
    progress: Callable[[int], object] = lambda done: None,
) -> Outcomes:
    """Run each trial: attempts without contact, staircase of grasps, and releases of the lifted ball.

    Args:
        trials: N trials.
        protocol: motion and voltage of the tool.
        engine: where to run.
        gaps: of releases and of attempts without contact.
        progress: called with the number of trials that have finished since the last call.

    Raises:
        ConfigError: unknown engine.
    """
    make = bench_maker(engine)
    size = LARGEST_BATCH[engine.name]
    parts = []
    for first in range(0, len(trials), size):
        batch = trials[first : first + size]
        parts.append(_run(make, batch, protocol, gaps))
        progress(len(batch))
    return Outcomes(
        _joined([part.grasp for part in parts]),
        {gap: _joined([part.release[gap] for part in parts]) for gap in gaps.release},
        {gap: _joined([part.no_contact[gap] for part in parts]) for gap in gaps.no_contact},
        parts[0].timestep,
    )


def bench_maker(engine: EngineChoice) -> Callable[[Sequence[Trial], float], Bench]:
    """Constructor of benches in an engine, from trials and the initial gap between tool and ball [m].

    Raises:
        ConfigError: unknown engine.
    """
    if engine.name == "mujoco":
        from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench

        return partial(MujocoBench, threads=engine.threads)
    if engine.name == "mjx":
        from iswarm_mj.gripper.bench.engine_mjx import MjxBench

        return partial(MjxBench, impl=engine.impl)
    raise ConfigError("engine", engine.name, "mujoco or mjx")


def _run(
    make: Callable[[Sequence[Trial], float], Bench], trials: Sequence[Trial], protocol: Protocol, gaps: Gaps
) -> Outcomes:
    bench, count = make(trials, protocol.start_gap), len(trials)
    start = bench.save()
    attempts = {}
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
