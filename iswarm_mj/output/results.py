"""What a cleaning run writes: result.json, trajectory.npz, clean.rrd. Each appears whole or not at all."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj import __version__
from iswarm_mj.output.trajectory import ABOUT, RECORDING, RESULT, TRAJECTORY, Frames, Scene
from iswarm_mj.simulation.metrics import Measures, fitness
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.utils.files import atomic_write, remove, remove_parts


def clear(out: Path) -> None:
    """Remove the results of an earlier run, and what was left of files that were being written."""
    for name in (RESULT, TRAJECTORY, RECORDING):
        remove(out / name)
        remove_parts(out, name)


def clear_worlds(out: Path) -> None:
    """Remove what an earlier run left of its further worlds."""
    for place in out.glob("world-*"):
        clear(place)
        with suppress(OSError):
            place.rmdir()  # it holds something else, or is no directory


def about(run: Run, settings: RunSettings) -> dict[str, Any]:
    """Return what a run was, as JSON has it: version, settings, engine, genome, configuration and robot.

    It does not depend on which worlds are recorded.
    """
    own = asdict(settings)
    del own["record_worlds"]
    values = {
        "version": __version__,
        **run.identity,
        "settings": own,
        **run.rules,
        "config": asdict(run.config),
        "robot": {"file": None if run.robot_file is None else str(run.robot_file), **asdict(run.robot)},
    }
    return json.loads(json.dumps(values))


def result(run: Run, settings: RunSettings, measures: Sequence[Measures], steps: int, wall_s: float) -> dict[str, Any]:
    """Return the content of result.json: settings, measures, configuration. With several worlds, measures are lists.

    Args:
        run: of this process.
        settings: of the run of all processes.
        measures: of all worlds.
        steps: control steps taken.
        wall_s: how long it took.
    """
    scores = [fitness(m, settings.n_robots, run.config.arena.n_dust, settings.steps) for m in measures]

    def each(values: list[Any]) -> Any:
        return values[0] if settings.n_worlds == 1 else values

    return {
        "seed": settings.seed,
        "n_worlds": settings.n_worlds,
        "n_robots": settings.n_robots,
        "n_dust": run.config.arena.n_dust,
        "max_steps": settings.steps,
        "stop_at": run.goal,
        "steps": steps,
        **{name: each([getattr(m, name) for m in measures]) for name in Measures._fields},
        "fitness": each(scores),
        "wall_s": round(wall_s, 3),
        "seconds": {
            "first_call": round(run.first_call_s, 3),  # which compiles, and is part of none of the others
            "control_step": None if run.step_s is None else round(run.step_s, 6),
        }
        | {stage: round(sum(laps), 3) for stage, laps in run.watch.laps.items()},
        **about(run, settings),
    }


def write_result(out: Path, content: dict[str, Any]) -> None:
    """Write result.json."""
    with atomic_write(out / RESULT) as part:
        part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def write_trajectory(out: Path, scene: Scene, frames: Frames, about: Mapping[str, Any]) -> None:
    """Write trajectory.npz: the arrays of `Frames`, with the prefix scene_ those of `Scene`, and `about` as JSON."""
    arrays: dict[str, Any] = frames.arrays()
    arrays |= {f"scene_{name}": np.asarray(value) for name, value in scene._asdict().items()}
    arrays[ABOUT] = np.bytes_(json.dumps(about).encode())
    with atomic_write(out / TRAJECTORY) as part, part.open("wb") as file:
        np.savez(file, **arrays)
