"""What becomes of a run in result.json, and how the files of earlier runs make way."""

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


def clear(out: Path) -> None:
    """Remove the results of an earlier run, its further worlds and what it left half written.

    Args:
        out: directory of the results, which this process has locked.

    Raises:
        UserError: a file cannot be removed; or another process writes into the directory of a
            further world, and nothing is removed.
    """
    further = [*filter(Path.is_dir, out.glob("world-*"))]
    with ExitStack() as locks:
        for place in further:
            locks.enter_context(locked(place))
        for place, name in product((out, *further), (RESULT, TRAJECTORY, RECORDING, OTHER_RECORDING)):
            remove(place / name)
            remove_parts(place, name)
    for place in further:
        with suppress(OSError):
            place.rmdir()  # it holds something else


def about(run: Run) -> dict[str, Any]:
    """Return what a run was, as JSON has it: version, settings, engine, genome, configuration and robot.

    It does not depend on which worlds are recorded.
    """
    own = asdict(run.settings)
    del own["record_worlds"]
    values = {
        "version": __version__,
        **run.identity,
        "settings": own,
        **run.rules,
        "config": asdict(run.config),
        "robot": {"file": run.robot_file, **asdict(cast(Any, run.robot))},
    }
    return json.loads(json.dumps(values, default=str))


def result(run: Run, wall_s: float) -> dict[str, Any]:
    """Return the content of result.json: settings, measures, configuration. With several worlds, measures are lists.

    Args:
        run: up to where it is.
        wall_s: how long it took.
    """
    settings, metrics = run.settings, run.metrics()
    measures = [run.measures(world) for world in range(settings.n_worlds)]
    measured = run.task.measured
    units = {name: quantity.unit for name, quantity in measured.items() if quantity.unit}

    def each(values: list[Any]) -> Any:
        return values[0] if settings.n_worlds == 1 else values

    task, counts, scored = run.task, ("collisions", "finished_at"), {}
    if is_scored(task):
        scores = [task.fitness(m, run.config, settings.n_robots, settings.steps) for m in measures]
        counts, scored = Measures._fields, {"n_dust": run.config.arena.n_dust, "fitness": each(scores)}

    return {
        "seed": settings.seed,
        "n_worlds": settings.n_worlds,
        "n_robots": settings.n_robots,
        "max_steps": settings.steps,
        "stop_at": run.goal,
        "steps": run.step,
        **{name: each([getattr(m, name) for m in measures]) for name in counts},
        **scored,
        "metrics": {name: each([_number(value) for value in values]) for name, values in metrics.items()},
        **({"units": units} if units else {}),
        "wall_s": round(wall_s, 3),
        "seconds": {
            "first_call": round(run.first_call_s, 3),  # which compiles, and is part of none of the others
            "control_step": None if run.step_s is None else round(run.step_s, 6),
        }
        | {stage: round(sum(laps), 3) for stage, laps in run.watch.laps.items()},
        **about(run),
        "devices": run.devices,
        "faults": [str(fault) for fault in run.faults],
    }


def _number(value: Any) -> Any:
    """A metric in JSON; null for what is no number, such as the mean of nothing."""
    plain = np.asarray(value).item()
    return plain if np.isfinite(plain) else None


def write_result(out: Path, content: dict[str, Any]) -> None:
    """Write result.json."""
    with atomic_write(out / RESULT) as part:
        part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
