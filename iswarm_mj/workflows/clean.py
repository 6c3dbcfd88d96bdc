"""The main job, for every engine: a run of a task with its files, its progress and its summary."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

from iswarm_mj.output import results
from iswarm_mj.output.trajectory import OTHER_RECORDING, RECORDING, RESULT
from iswarm_mj.simulation.run import Run
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.base import is_scored
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.progress import Progress
from iswarm_mj.utils.signals import completing, saved
from iswarm_mj.workflows.recorder import Recorder, advanced

MAX_LISTED = 10
"""Worlds whose numbers the summary lists; of more it states averages and ranges."""


def run_swarm(run: Run, out: Path, grasps: int = 0) -> dict[str, Any]:
    """Take a run to its end, write its results into `out`, print a summary; return the content of result.json.

    From the start on, result.json is that of this run: until it has ended, it says "interrupted": true, and if an
    exception or a signal ends the run, it and the files of recorded worlds contain what there was.

    Args:
        run: at its start.
        out: result.json and the first recorded world go here, each further one into world-N.
        grasps: attempts at most whose trials are recorded beside the arena.

    Raises:
        UserError: `out` cannot be written to, or is in use.
        SimulationFault: a world could not go on; the results of all others are in `out`.
    """
    with locked(out):
        with ExitStack() as stack:
            mark = {"interrupted": True}
            save = partial(_save, run, out, time.perf_counter(), mark)
            _advance(run, _begin(run, out, grasps, save, stack))
            mark.clear()
        content = json.loads((out / RESULT).read_bytes())
    print(summary(content, out))
    run.raise_faults()
    return content


def _save(run: Run, out: Path, started: float, mark: dict[str, bool]) -> None:
    """Write result.json, with the mark of an interrupted run."""
    try:
        content = results.result(run, time.perf_counter() - started)
    except RuntimeError:  # a program that runs has taken the state of the worlds
        content = json.loads((out / RESULT).read_bytes()) | {"steps": run.step}
        content |= dict.fromkeys({*Measures._fields, "fitness", "metrics"} & content.keys())
    results.write_result(out, content | mark)


def _begin(run: Run, out: Path, grasps: int, save: Callable[[], None], stack: ExitStack) -> list[Recorder]:
    """Remove what an earlier run left, announce this one and record its start; `stack` saves it at its end."""
    recorded = [run.worlds[world].index for world in run.settings.record_worlds]
    places = [out, *(out / f"world-{world}" for world in recorded[1:])]
    if recorded:
        from iswarm_mj.output.rerun_format import check_recordings

        check_recordings()
    with completing():  # or a run would be announced of which nothing is recorded
        results.clear(out)
        for place in places[1:]:
            stack.enter_context(locked(place))
        save()
        stack.enter_context(saved(save))
        name, recorders = RECORDING if is_scored(run.task) else OTHER_RECORDING, []
        for index, place in enumerate(places[: len(recorded)]):
            recorders.append(Recorder(run, place / name, index, place, grasps))
            stack.enter_context(saved(recorders[-1].save))
    return recorders


def _advance(run: Run, recorders: Sequence[Recorder]) -> None:
    """Take all steps, with a progress bar on a terminal."""
    goal = "" if run.goal is None else f" of {run.goal * len(run.worlds)}"
    robots = f"{run.settings.n_robots} robots in {len(run.worlds)} world{'s' * (len(run.worlds) > 1)}"
    what = f"preparing the control step of {robots} ({run.identity['engine']}), which is compiled once for each size"
    with Progress(run.settings.steps, "step", waiting=what) as bar:
        before = 0
        for _ in advanced(run, recorders):
            bar.update(run.step - before)
            before = run.step
            bar.say(f"progress {int(run.progress().sum())}{goal}")


def summary(content: Mapping[str, Any], out: Path) -> str:
    """Readable summary of result.json, also of an interrupted run."""

    def show(name: str, group: Mapping[str, Any] = content, form: str = "z.1f", unit: str = "") -> str:
        values = group[name] if isinstance(group[name], list) else [group[name]]
        known = [v for v in values if v is not None]
        unit = f" {unit}" if unit and known else ""
        if len(values) <= MAX_LISTED:
            shown = ("-" if v is None else f"{v:{form}}" if isinstance(v, float) else str(v) for v in values)
            return ", ".join(shown) + unit
        if not known:
            return "-"
        few = "" if len(known) == len(values) else f" in {len(known)} worlds"
        return f"{fmean(known):{form}} ({min(known):z.5g} to {max(known):z.5g}){unit}{few}"

    how = "; averages and ranges" if content["n_worlds"] > MAX_LISTED else ""
    goal = "no goal" if content["stop_at"] is None else f"goal {content['stop_at']}"
    metrics, units = content.get("metrics") or {}, content.get("units", {})
    is_cleaning = "delivered" in content and (not metrics or "delivered" in metrics)  # not another task with its balls
    first, each = (content.get("seconds", {}).get(name) for name in ("first_call", "control_step"))
    speed = "compilation included"
    if first is not None and each is not None:
        speed = f"{1e3 * each:.1f} ms per control step after {first:.1f} s for the first call, with its programs"

    def balls(name: str, text: Callable[[], str]) -> list[tuple[str, str]]:
        return [(name, text())] if is_cleaning else []

    lines = [
        ("robots", f"{content['n_robots']} in {content['n_worlds']} world(s), seed {content['seed']}{how}"),
        ("strategy", strategy_of(content)),
        ("task", content["task"].get("class", "Cleaning")),
        *balls("delivered", lambda: f"{show('delivered')} of {content['n_dust']} balls; picked up {show('picked')}"),
        *(
            (name.replace("_", " "), show(name, metrics, "z.3g", units.get(name, "")))
            for name in metrics
            if not (is_cleaning and name in ("delivered", "picked"))
        ),
        ("finished at", f"step {show('finished_at')} ({goal}; ran {content['steps']} steps)"),
        *balls("carriage", lambda: show("mean_carriage_steps", unit="steps on average")),
        ("collisions", show("collisions")),
        *balls("fitness", lambda: show("fitness")),
        ("time", f"{content['wall_s']:.1f} s, {speed}"),
        ("results", str(out)),
    ]
    return "\n".join(f"{name:>12}  {text}" for name, text in lines)


def strategy_of(content: Mapping[str, Any]) -> str:
    """Return the name of the strategy, by result.json: of its class, or of the preset of the paper's."""
    own = content.get("strategy")
    if isinstance(own, Mapping):
        return own["class"]
    return next((name for name, preset in PRESETS.items() if asdict(preset) == content.get("genome")), "own genome")
