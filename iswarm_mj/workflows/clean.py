"""Runs a task with any engine, with files, progress and a summary."""

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
from iswarm_mj.simulation.failures import Failures
from iswarm_mj.simulation.run import Run
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.cleaning import Cleaning
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.progress import Progress
from iswarm_mj.utils.signals import completing, saved
from iswarm_mj.workflows.recorder import Recorder, advance_and_record

MAX_LISTED = 10
"""Maximum number of worlds whose numbers the summary lists; of more it shows mean and range."""


def run_swarm(run: Run, out: Path, grasps: int = 0) -> dict[str, Any]:
    """Take a run to its end, write its results, and print a summary.

    From the start on, result.json is that of this run. Until the run has ended, it says
    "interrupted": true; if an exception or a signal ends the run, it and the files of recorded
    worlds contain everything up to then.

    Args:
        run: a run at its start.
        out: directory of result.json and of the first recorded world; each further world has a
            directory world-N in it.
        grasps: maximum number of attempts whose trials are recorded with the arena.

    Returns:
        The content of result.json.

    Raises:
        UserError: `out` cannot be written to, or is in use.
        SimulationFault: a world could not continue; the results of all others are in `out`.
    """
    with locked(out):
        with ExitStack() as stack:
            mark = {"interrupted": True}
            save = partial(_save, run, out, time.perf_counter(), mark)
            recorders = _begin(run, out, grasps, save, stack)
            _advance(run, recorders)
            mark.clear()  # before `stack` saves for the last time
        content = json.loads((out / RESULT).read_bytes())
    print(summary(content, out))
    run.raise_faults()
    return content


def _save(run: Run, out: Path, started: float, mark: dict[str, bool]) -> None:
    """Write result.json, with the mark of an interrupted run.

    Args:
        run: the run.
        out: directory of result.json.
        started: time of `time.perf_counter` at which the run began [s].
        mark: entries that mark the run as interrupted.
    """
    try:
        content = results.result(run, time.perf_counter() - started)
    except RuntimeError:
        # A program that still runs has taken the state of the worlds: keep what was known before.
        content = json.loads((out / RESULT).read_bytes())
        content["steps"] = run.step
        for name in (*Measures._fields, "fitness", "metrics"):
            if name in content:
                content[name] = None
    results.write_result(out, content | mark)


def _begin(
    run: Run, out: Path, grasps: int, save: Callable[[], None], stack: ExitStack
) -> list[Recorder]:
    """Remove the results of an earlier run, write a first result.json, and record the start.

    Args:
        run: the run.
        out: directory of the results.
        grasps: see `run_swarm`.
        save: function that writes result.json.
        stack: stack of what happens at the end of the run: results are saved, and locks released.
    """
    recorded = [run.worlds[world].index for world in run.settings.record_worlds]
    further_directories = [out / f"world-{number}" for number in recorded[1:]]
    directories = [out, *further_directories][: len(recorded)]
    if recorded:
        from iswarm_mj.output.frames import check_memory_names
        from iswarm_mj.output.rerun_format import check_recordings

        # Refuse before results of an earlier run are removed.
        check_memory_names(run.recorded)
        check_recordings()
    # Signals wait, or there could be a result.json of a run without a recording.
    with completing():
        results.clear(out)
        for directory in further_directories:
            stack.enter_context(locked(directory))
        save()
        stack.enter_context(saved(save))
        name = RECORDING if type(run.task) is Cleaning else OTHER_RECORDING
        recorders = []
        for index, directory in enumerate(directories):
            recorder = Recorder(run, directory / name, index, directory, grasps)
            recorders.append(recorder)
            stack.enter_context(saved(recorder.save))
    return recorders


def _advance(run: Run, recorders: Sequence[Recorder]) -> None:
    """Take all steps, with a progress bar on a terminal."""
    n_worlds = len(run.worlds)
    goal = "" if run.goal is None else f" of {run.goal * n_worlds}"
    plural = "s" if n_worlds > 1 else ""
    waiting = (
        f"preparing the control step of {run.settings.n_robots} robots in {n_worlds} world{plural} "
        f"({run.identity['engine']}), which is compiled once for each size"
    )
    with Progress(run.settings.steps, "step", waiting=waiting) as bar:
        steps_before = 0
        for _ in advance_and_record(run, recorders):
            bar.update(run.step - steps_before)
            steps_before = run.step
            bar.say(f"progress {int(run.progress().sum())}{goal}")


def summary(content: Mapping[str, Any], out: Path) -> str:
    """Return a readable summary of result.json, also of an interrupted run."""
    metrics = content.get("metrics") or {}
    # Other tasks may have balls, too, but do not measure deliveries.
    is_cleaning = "delivered" in content and (not metrics or "delivered" in metrics)

    lines = [
        ("robots", _robots_text(content)),
        ("strategy", strategy_of(content)),
        ("task", content["task"].get("class", "Cleaning")),
    ]
    lines += _effective_flags(content)
    if is_cleaning:
        delivered = f"{_numbers_text(content['delivered'])} of {content['n_dust']} balls"
        lines.append(("delivered", f"{delivered}; picked up {_numbers_text(content['picked'])}"))
    for name, values in metrics.items():
        is_shown_already = is_cleaning and name in ("delivered", "picked")
        if not is_shown_already:
            unit = content.get("units", {}).get(name, "")
            lines.append((name.replace("_", " "), _numbers_text(values, "z.3g", unit)))
    lines.append(("finished at", _end_text(content)))
    if is_cleaning:
        carriage = _numbers_text(content["mean_carriage_steps"], unit="steps on average")
        lines.append(("carriage", carriage))
    lines.append(("collisions", _numbers_text(content["collisions"])))
    if is_cleaning:
        lines.append(("fitness", _numbers_text(content["fitness"])))
    lines.append(("time", f"{content['wall_s']:.1f} s, {_speed_text(content)}"))
    lines.append(("results", str(out)))
    return "\n".join(f"{name:>12}  {text}" for name, text in lines)


def _effective_flags(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return lines on robots that fail and on the tip, for runs that have them."""
    lines = []
    failing = content["settings"].get("failing")
    if failing is not None:
        failures = Failures.parse(failing)
        n_failing = round(failures.share * content["n_robots"])
        robots = f"{n_failing} of {content['n_robots']} robots"
        lines.append(("failing", f"{robots} after step {failures.step}"))
    tip = content["config"]["gripper"].get("tip")
    if tip:
        lines.append(("tip", str(tip)))
    return lines


def _numbers_text(values: Any, form: str = "z.1f", unit: str = "") -> str:
    """Return the numbers of all worlds or, of more than `MAX_LISTED`, their mean and range.

    Args:
        values: number of each world, or of the only one; None where it is undefined.
        form: format of floats.
        unit: unit that follows the numbers.
    """
    values = values if isinstance(values, list) else [values]
    known = [value for value in values if value is not None]
    unit = f" {unit}" if unit and known else ""
    if len(values) <= MAX_LISTED:
        return ", ".join(_number_text(value, form) for value in values) + unit
    if not known:
        return "-"
    mean_and_range = f"{fmean(known):{form}} ({min(known):z.5g} to {max(known):z.5g})"
    worlds = "" if len(known) == len(values) else f" in {len(known)} worlds"
    return mean_and_range + unit + worlds


def _number_text(value: Any, form: str) -> str:
    if value is None:
        return "-"
    return f"{value:{form}}" if isinstance(value, float) else str(value)


def _robots_text(content: Mapping[str, Any]) -> str:
    n_worlds = content["n_worlds"]
    text = f"{content['n_robots']} in {n_worlds} world(s), seed {content['seed']}"
    return f"{text}; averages and ranges" if n_worlds > MAX_LISTED else text


def _end_text(content: Mapping[str, Any]) -> str:
    goal = "no goal" if content["stop_at"] is None else f"goal {content['stop_at']}"
    finished_at = _numbers_text(content["finished_at"])
    return f"step {finished_at} ({goal}; ran {content['steps']} steps)"


def _speed_text(content: Mapping[str, Any]) -> str:
    """Return the durations of a control step and of the first call."""
    seconds = content.get("seconds", {})
    first_call = seconds.get("first_call")
    control_step = seconds.get("control_step")
    if first_call is None or control_step is None:
        return "compilation included"
    milliseconds = 1e3 * control_step
    start = f"{first_call:.1f} s for the first call, with its programs"
    return f"{milliseconds:.1f} ms per control step after {start}"


def strategy_of(content: Mapping[str, Any]) -> str:
    """Return the name of a run's strategy: its class or, of the paper's strategy, the preset.

    Args:
        content: content of result.json.
    """
    strategy = content.get("strategy")
    if isinstance(strategy, Mapping):
        return strategy["class"]
    for name, preset in PRESETS.items():
        if asdict(preset) == content.get("genome"):
            return name
    return "own genome"
