"""Writes result.json, and removes the files of earlier runs."""

import json
from contextlib import ExitStack, suppress
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np

from iswarm_mj._version import __version__
from iswarm_mj.output.trajectory import OTHER_RECORDING, RECORDING, RESULT, TRAJECTORY
from iswarm_mj.simulation.run import Run
from iswarm_mj.tasks.base import is_scored
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.files import atomic_write, remove, remove_parts

FILES = (RESULT, TRAJECTORY, RECORDING, OTHER_RECORDING)
"""Names of all files that a run writes into a directory."""


def clear(out: Path) -> None:
    """Remove the results of an earlier run, its further worlds and its incomplete files.

    Args:
        out: directory of the results, which this process has locked.

    Raises:
        UserError: a file cannot be removed; or another process writes into the directory of a
            further world, and nothing is removed.
    """
    further_worlds = [*filter(Path.is_dir, out.glob("world-*"))]
    with ExitStack() as locks:
        for directory in further_worlds:
            locks.enter_context(locked(directory))
        for directory, name in product((out, *further_worlds), FILES):
            remove(directory / name)
            remove_parts(directory, name)
    for directory in further_worlds:
        with suppress(OSError):  # a directory with other files stays
            directory.rmdir()


def about(run: Run) -> dict[str, Any]:
    """Return the description of a run: version, settings, engine, genome, configuration, robot.

    It has only values of JSON, and does not depend on which worlds are recorded.
    """
    settings = asdict(run.settings)
    del settings["record_worlds"]
    values = {
        "version": __version__,
        **run.identity,
        "settings": settings,
        **run.rules,
        "config": asdict(run.config),
        "robot": {"file": run.robot_file, **asdict(cast(Any, run.robot))},
    }
    if run.tip is not None:
        values["gripper_tip"] = {"sha256": run.tip.digest}
    return json.loads(json.dumps(values, default=str))


def result(run: Run, wall_s: float) -> dict[str, Any]:
    """Return the content of result.json: settings, measures, configuration.

    With several worlds, measures are lists.

    Args:
        run: a run, at any step.
        wall_s: duration of the run [s].
    """
    settings = run.settings
    quantities = run.task.measured.items()
    units = {name: quantity.unit for name, quantity in quantities if quantity.unit}
    return {
        "seed": settings.seed,
        "n_worlds": settings.n_worlds,
        "n_robots": settings.n_robots,
        "max_steps": settings.steps,
        "stop_at": run.goal,
        "steps": run.step,
        **_measures(run),
        "metrics": _metrics(run),
        **({"units": units} if units else {}),
        "wall_s": round(wall_s, 3),
        "seconds": _seconds(run),
        **about(run),
        "devices": run.devices,
        "faults": [str(fault) for fault in run.faults],
    }


def _listed(run: Run, values: list[Any]) -> Any:
    """Return a list of values of all worlds, or the value of a single world."""
    return values[0] if run.settings.n_worlds == 1 else values


def _measures(run: Run) -> dict[str, Any]:
    """Return what is counted in every task and, for tasks with a score, everything of balls."""
    settings = run.settings
    measures = [run.measures(world) for world in range(settings.n_worlds)]
    task = run.task
    names = Measures._fields if is_scored(task) else ("collisions", "finished_at")
    content = {}
    for name in names:
        values = [getattr(of_world, name) for of_world in measures]
        content[name] = _listed(run, values)
    if is_scored(task):
        scores = [
            task.fitness(of_world, run.config, settings.n_robots, settings.steps)
            for of_world in measures
        ]
        content["n_dust"] = run.config.arena.n_dust
        content["fitness"] = _listed(run, scores)
    return content


def _metrics(run: Run) -> dict[str, Any]:
    """Return the metrics of the task."""
    metrics = {}
    for name, values in run.metrics().items():
        finite = [_finite_or_none(value) for value in values]
        metrics[name] = _listed(run, finite)
    return metrics


def _seconds(run: Run) -> dict[str, float | None]:
    """Return the durations of the first call, which compiles, a later step, and its stages."""
    durations: dict[str, float | None] = {
        "first_call": round(run.first_call_s, 3),  # not contained in the others
        "control_step": None if run.step_s is None else round(run.step_s, 6),
    }
    for stage, laps in run.watch.laps.items():
        durations[stage] = round(sum(laps), 3)
    return durations


def _finite_or_none(value: Any) -> Any:
    """Return a metric as JSON holds it; None for NaN, such as the mean of nothing."""
    plain = np.asarray(value).item()
    return plain if np.isfinite(plain) else None


def write_result(out: Path, content: dict[str, Any]) -> None:
    """Write result.json."""
    with atomic_write(out / RESULT) as part:
        part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
