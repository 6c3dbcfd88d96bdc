"""Rollouts of any strategy in many worlds at once: one call, arrays with a world axis."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.constraints import check, check_kind, is_whole
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.files import check_name
from iswarm_mj.utils.signals import saved
from iswarm_mj.workflows.recorder import Recorder, advance_and_record

MAX_EVERY = 10_000
"""Maximum number of control steps between counts of progress."""


class Rollout(NamedTuple):
    """Results of B worlds as NumPy arrays, see `tasks.measures.Measures`."""

    delivered: np.ndarray
    """(B,) balls at the dump at the end; undefined for tasks without a dump, like `picked` and
    `mean_carriage_steps`."""
    picked: np.ndarray
    """(B,) balls picked up at least once."""
    collisions: np.ndarray
    """(B,) pairs of robots in contact that were not in contact one control step earlier, summed
    over the steps."""
    mean_carriage_steps: np.ndarray
    """(B,) mean control steps for which a delivered ball was carried; NaN where none was
    delivered."""
    is_finished: np.ndarray
    """(B,) bool, the goal was reached, in cleaning all balls delivered; the world stands still
    from then on."""
    finished_at: np.ndarray
    """(B,) control step after which the goal was reached; NaN where it was not."""
    steps: np.ndarray
    """(C,) control steps after which progress was counted."""
    delivered_after: np.ndarray
    """(B, C) progress of the task after these steps, in cleaning balls at the dump."""
    poses: np.ndarray | None
    """(W, 1 + steps, N, 3) x, y [mm] and yaw [rad] of the worlds in `poses_of`, from the start on;
    None without any."""
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
    """Simulate all worlds of a scenario to their ends, and return their results as arrays.

    Programs are compiled for each configuration, class of strategy, number of robots and `every`,
    but not for values of the strategy's arrays.

    Args:
        scenario: scenario that is simulated. On a CPU `PlanarSettings()` and `MujocoSettings()`
            are much faster than `MjxSettings()`, which is for GPUs.
        every: control steps between counts of progress; the last step is always counted.
        poses_of: numbers of the W worlds whose poses are kept.
        record: file, `*.rrd`, for a recording of the first of these worlds, or of world 0; open it
            with `rerun`.

    Raises:
        UserError: parts of the scenario do not fit each other, or the recording cannot be written.
    """
    check_kind("scenario", scenario, Scenario)
    check_kind("record", record, (str, Path, NoneType))
    if record is not None:
        check_name(record, ".rrd", setting="record")
    rule = f"a whole number between 1 and {MAX_EVERY}"
    check("every", every, rule, is_whole(every) and 1 <= every <= MAX_EVERY)
    _check_poses_of(poses_of, scenario.n_worlds)

    # Compiled engines take `every` steps with one program.
    every = int(every)
    recorded = tuple(poses_of)
    if record is not None and not recorded:
        recorded = (0,)
    in_chunks = replace(scenario, engine=scenario.engine.in_chunks(every))
    run = Run(in_chunks, record_worlds=recorded)

    recorder = None if record is None else Recorder(run, Path(record))
    progress = _Progress(run, every)
    poses = [np.asarray(run.start.poses)]
    with nullcontext() if recorder is None else saved(recorder.save):
        for step_record in advance_and_record(run, [] if recorder is None else [recorder]):
            if step_record is not None:
                poses.append(np.asarray(step_record.poses))
            progress.count(run)
    return _results(run, progress, _all_poses(poses, run.settings.steps) if poses_of else None)


def _check_poses_of(worlds: Any, n_worlds: int) -> None:
    """Raise a ConfigError unless these are numbers of different worlds."""
    check_kind("poses_of", worlds, (list, tuple, range))
    are_known = all(is_whole(world) and world in range(n_worlds) for world in worlds)
    are_distinct = are_known and len(set(worlds)) == len(worlds)
    check("poses_of", tuple(worlds), f"distinct worlds from 0 to {n_worlds - 1}", are_distinct)


class _Progress:
    """Progress of the worlds of a run after every few control steps."""

    steps: Int[np.ndarray, "C"]
    """Control steps after which it is counted."""
    values: Int[np.ndarray, "B C"]
    """Progress after these steps; after steps still to come, the progress so far."""

    def __init__(self, run: Run, every: int):
        """Begin with the progress at the start."""
        n_steps = run.settings.steps
        self.steps = np.minimum(np.arange(every, n_steps + every, every), n_steps)
        self.values = np.tile(run.progress()[:, None].astype(int), len(self.steps))

    def count(self, run: Run) -> None:
        """Take in the progress after the steps so far."""
        self.values[:, self.steps >= run.step] = run.progress()[:, None]


def _all_poses(blocks: Sequence[np.ndarray], n_steps: int) -> Float[np.ndarray, "W T N 3"]:
    """Return the poses of the start and of all steps.

    Args:
        blocks: poses of consecutive steps (T, W, N, 3); after the last block the robots rest.
        n_steps: number of steps.
    """
    poses = np.concatenate(blocks).swapaxes(0, 1).astype(np.float32)
    n_missing = 1 + n_steps - poses.shape[1]
    at_rest = np.repeat(poses[:, -1:], n_missing, axis=1)
    return np.concatenate([poses, at_rest], axis=1)


def _results(run: Run, progress: _Progress, poses: np.ndarray | None) -> Rollout:
    """Return the results of a run at its end."""
    measures = [run.measures(world) for world in range(len(run.worlds))]
    carriage = [of_world.mean_carriage_steps for of_world in measures]
    finished_at = [of_world.finished_at for of_world in measures]
    return Rollout(
        delivered=np.array([of_world.delivered for of_world in measures]),
        picked=np.array([of_world.picked for of_world in measures]),
        collisions=np.array([of_world.collisions for of_world in measures]),
        mean_carriage_steps=np.array(carriage, float),  # NaN for None
        is_finished=np.array([step is not None for step in finished_at]),
        finished_at=np.array(finished_at, float),  # NaN for None
        steps=progress.steps,
        delivered_after=progress.values,
        poses=poses,
        faults=run.faults,
        metrics=run.metrics(),
    )
