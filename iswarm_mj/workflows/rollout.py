"""Rollouts of any strategy in many worlds at once: one call, arrays with a world axis."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.constraints import check, check_kind, is_whole
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.files import check_name
from iswarm_mj.utils.signals import saved
from iswarm_mj.workflows.recorder import Recorder, advanced


class Rollout(NamedTuple):
    """Results of B worlds, as NumPy arrays with the worlds first; see `tasks.measures.Measures`."""

    delivered: np.ndarray
    """(B,) balls at the dump at the end; undefined, like `picked` and carriage, for tasks without a dump."""
    picked: np.ndarray
    """(B,) balls picked up at least once."""
    collisions: np.ndarray
    """(B,) pairs of robots in contact that were not in contact one control step earlier, summed over the steps."""
    mean_carriage_steps: np.ndarray
    """(B,) mean control steps for which a delivered ball was carried; NaN where none was delivered."""
    is_finished: np.ndarray
    """(B,) bool, the goal was reached, in cleaning all balls delivered; the world stands still from then on."""
    finished_at: np.ndarray
    """(B,) control step after which the goal was reached; 0 where it was not."""
    steps: np.ndarray
    """(C,) control steps after which progress was counted."""
    delivered_after: np.ndarray
    """(B, C) progress of the task after these steps, in cleaning balls at the dump."""
    poses: np.ndarray | None
    """(W, 1 + steps, N, 3) x, y [mm] and yaw [rad] of the worlds in `poses_of`, from the start on; None without any."""
    faults: list[SimulationFault]
    """Faults of worlds; their measures count up to the fault."""
    metrics: dict[str, np.ndarray]
    """(B,) metrics of the task at the end, by their names."""


def rollout(
    scenario: Scenario,
    *,
    every: int = 10,
    poses_of: Sequence[int] = (),
    record: str | Path | None = None,
) -> Rollout:
    """Simulate all worlds of a scenario to their ends, and return what became of each as arrays.

    Programs are compiled for each configuration, class of strategy, number of robots and `every`, but not for values of
    the strategy's arrays.

    Args:
        scenario: what is simulated. On a CPU `PlanarSettings()` and `MujocoSettings()` are much faster than
            `MjxSettings()`, which is for GPUs.
        every: control steps between counts of progress; the last step is always counted.
        poses_of: numbers of the W worlds whose poses are kept.
        record: file, `*.rrd`, for a recording of the first of these worlds, or of world 0; open it with `rerun`.

    Raises:
        UserError: parts of the scenario do not fit each other, or the recording cannot be written.
    """
    check_kind("scenario", scenario, Scenario)
    check_kind("record", record, (str, Path, NoneType))
    if record is not None:
        check_name(record, ".rrd", setting="record")
    check("every", every, "a whole number between 1 and 10000", is_whole(every) and 1 <= every <= 10_000)
    _check_poses_of(poses_of, scenario.n_worlds)

    every = int(every)
    recorded = tuple(poses_of)
    if record is not None and not recorded:
        recorded = (0,)
    in_chunks = replace(scenario, engine=scenario.engine.in_chunks(every))
    run = Run(in_chunks, record_worlds=recorded)

    steps = run.settings.steps
    counted = np.minimum(np.arange(every, steps + every, every), steps)
    delivered = np.tile(run.progress()[:, None].astype(int), len(counted))
    poses = [np.asarray(run.start.poses)]
    recorders = [] if record is None else [Recorder(run, Path(record))]
    with saved(recorders[0].save) if recorders else nullcontext():
        for taken in advanced(run, recorders):
            if taken is not None:
                poses.append(np.asarray(taken.poses))
            delivered[:, counted >= run.step] = run.progress()[:, None]

    measures = [run.measures(world) for world in range(len(run.worlds))]
    return Rollout(
        delivered=np.array([m.delivered for m in measures]),
        picked=np.array([m.picked for m in measures]),
        collisions=np.array([m.collisions for m in measures]),
        mean_carriage_steps=np.array([m.mean_carriage_steps for m in measures], float),  # NaN for None
        is_finished=np.array([m.finished_at is not None for m in measures]),
        finished_at=np.array([m.finished_at or 0 for m in measures]),
        steps=counted,
        delivered_after=delivered,
        poses=_all_poses(poses, steps) if poses_of else None,
        faults=run.faults,
        metrics=run.metrics(),
    )


def _check_poses_of(worlds: Any, n_worlds: int) -> None:
    """Raise a ConfigError unless these are numbers of different worlds."""
    check_kind("poses_of", worlds, (list, tuple, range))
    are_known = all(is_whole(world) and world in range(n_worlds) for world in worlds)
    are_distinct = are_known and len(set(worlds)) == len(worlds)
    check("poses_of", tuple(worlds), f"distinct worlds from 0 to {n_worlds - 1}", are_distinct)


def _all_poses(blocks: Sequence[np.ndarray], steps: int) -> np.ndarray:
    """Return the poses of W worlds (W, 1 + steps, N, 3) from those of blocks of steps (T, W, N, 3).

    After the last block the robots rest.
    """
    poses = np.concatenate(blocks).swapaxes(0, 1).astype(np.float32)
    rest = np.repeat(poses[:, -1:], 1 + steps - poses.shape[1], axis=1)
    return np.concatenate([poses, rest], axis=1)
