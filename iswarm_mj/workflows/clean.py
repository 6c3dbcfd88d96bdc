"""The main job, for every engine: a run of a task with its files, its progress and its summary."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

from iswarm_mj.output import results
from iswarm_mj.output.trajectory import OTHER_RECORDING, RECORDING
from iswarm_mj.simulation.distributed import ALONE, Hosts
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.tasks.protocol import ScoredTask
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.files import make_output_directory
from iswarm_mj.utils.interruption import BUSY, postponed, saved
from iswarm_mj.utils.lock import locked
from iswarm_mj.utils.progress import Progress
from iswarm_mj.workflows.recorder import AS_USUAL, Recorder, Shown
from iswarm_mj.workflows.unfinished import Unfinished

MAX_LISTED = 10
"""Worlds whose numbers the summary lists; of more it states averages and ranges."""


class Outcome(NamedTuple):
    """What the worlds of all processes came to."""

    step: int
    """Control steps taken."""
    devices: list[str]
    """That computed."""
    measures: list[Measures]
    """Of each world."""
    metrics: dict[str, list[Any]]
    """Of the task in each world."""
    faults: list[str]
    """Of worlds that could not go on, by their numbers."""


def clean(
    run: Run, settings: RunSettings, out: Path, hosts: Hosts = ALONE, shown: Shown = AS_USUAL
) -> dict[str, Any] | None:
    """Run the swarm, write its results into `out`, print a summary; return the content of result.json.

    Of several processes the first writes and prints, and alone returns something. From the start on, result.json is
    that of this run: until it has ended, it says "interrupted": true, and if an exception or a signal ends the run, it
    and the files of recorded worlds contain what there was.

    Args:
        run: at its start, with this process's share of the worlds.
        settings: of the run of all processes.
        out: result.json and the first recorded world go here, each further one into world-N.
        hosts: the processes that share the worlds.
        shown: what recordings show; the viewer is for the first recorded world.

    Raises:
        UserError: `out` cannot be written to, or is in use.
        SimulationFault: a world could not go on; the results of all others are in `out`.
    """
    if hosts.index == 0:
        with locked(out):
            content, faults = _write(run, settings, out, hosts, shown)
        print(summary(content, out))
    else:
        _advance(run, [], hosts)
        content, faults = None, _gather(run, hosts).faults
        hosts.gathered("written", None)
    run.raise_faults()
    if faults:
        raise SimulationFault("; ".join(faults))
    return content


def _write(run: Run, settings: RunSettings, out: Path, hosts: Hosts, shown: Shown) -> tuple[dict[str, Any], list[str]]:
    """Take all steps and write everything; return the content of result.json, and what went wrong."""
    started = time.perf_counter()
    with ExitStack() as stack:
        unfinished, recorders = _begin(run, settings, out, hosts, shown, stack)
        _advance(run, recorders, hosts)
        for recorder in recorders:
            recorder.save()
        outcome = _gather(run, hosts)
        content = results.result(
            run, settings, outcome.measures, outcome.metrics, outcome.step, time.perf_counter() - started
        )
        content |= {"devices": outcome.devices, "faults": outcome.faults}
        with postponed(), BUSY:
            results.write_result(out, content)
            unfinished.has_ended = True
        hosts.gathered("written", None)
    return content, outcome.faults


def _begin(
    run: Run, settings: RunSettings, out: Path, hosts: Hosts, shown: Shown, stack: ExitStack
) -> tuple[Unfinished, list[Recorder]]:
    """Remove what an earlier run left, announce this one and record its start; `stack` saves it if it is ended."""
    recorded = [run.worlds[world].index for world in run.settings.record_worlds]
    places = [out if k == 0 else out / f"world-{world}" for k, world in enumerate(recorded)] or [out]
    if recorded:
        from iswarm_mj.output.rerun_format import check_recordings

        check_recordings()
    with postponed(), BUSY:  # or a run would be announced of which nothing is recorded
        results.clear(out)
        results.clear_worlds(out)
        for place in places:
            make_output_directory(place)
        unfinished = Unfinished(run, settings, out, hosts)
        stack.enter_context(saved(unfinished.save))
        name = RECORDING if isinstance(run.task, ScoredTask) else OTHER_RECORDING
        recorders = []
        for index in range(len(recorded)):
            own = shown if index == 0 else shown._replace(viewer=None)
            recorders.append(Recorder(run, places[index] / name, index, places[index], settings, own))
            stack.enter_context(saved(recorders[-1].save))
    return unfinished, recorders


def _advance(run: Run, recorders: Sequence[Recorder], hosts: Hosts) -> None:
    """Take all steps, with a progress bar on a terminal."""
    goal = "" if run.goal is None else f" of {run.goal * len(run.worlds)}"
    robots = f"{run.settings.n_robots} robots in {len(run.worlds)} world{'s' * (len(run.worlds) > 1)}"
    what = f"compiling the control step of {robots} ({run.identity['engine']}), kept for the next run of this size"
    with Progress(run.settings.steps, "step", waiting=what, hidden=hosts.index > 0) as bar:
        while not run.is_over:
            before = run.step
            with postponed():  # or what was computed would not be recorded
                record = run.advance()
                if record is not None:
                    for recorder in recorders:
                        recorder.add(record)
            hosts.look()
            bar.update(run.step - before)
            if hosts.index == 0 and bar.is_due():
                bar.say(f"progress {int(run.progress().sum())}{goal}")
        if hosts.count > 1:
            bar.say("waiting for the other processes")


def _gather(run: Run, hosts: Hosts) -> Outcome:
    """Bring together what the worlds of all processes came to."""
    metrics = run.metrics()
    each = [{name: values[k].item() for name, values in metrics.items()} for k in range(len(run.worlds))]
    measures = [(world.index, run.measures(k), each[k]) for k, world in enumerate(run.worlds)]
    shares = hosts.gathered("results", (run.step, run.devices, measures, [str(fault) for fault in run.faults]))
    found = {index: (Measures(*values), own) for _, _, worlds, _ in shares for index, values, own in worlds}
    ordered = [found[index] for index in sorted(found)]
    return Outcome(
        step=max(step for step, *_ in shares),
        devices=[device for _, devices, _, _ in shares for device in devices],
        measures=[values for values, _ in ordered],
        metrics={name: [own[name] for _, own in ordered] for name in metrics},
        faults=[fault for *_, faults in shares for fault in faults],
    )


def summary(content: Mapping[str, Any], out: Path) -> str:
    """Readable summary of result.json, also of an interrupted run and of one that an earlier version wrote."""

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

    wall_s, steps = content["wall_s"], content["steps"]
    how = "; averages and ranges" if content["n_worlds"] > MAX_LISTED else ""
    goal = "no goal" if content["stop_at"] is None else f"goal {content['stop_at']}"
    lines = [("robots", f"{content['n_robots']} in {content['n_worlds']} world(s), seed {content['seed']}{how}")]
    is_cleaning = "delivered" in content
    if is_cleaning:
        lines += [("delivered", f"{show('delivered')} of {content['n_dust']} balls; picked up {show('picked')}")]
    else:
        lines += [("task", content["task"]["class"])]
        units = content.get("units", {})
        lines += [
            (name.replace("_", " "), show(name, content["metrics"], "z.3g", units.get(name, "")))
            for name in content["metrics"]
        ]
    lines += [("finished at", f"step {show('finished_at')} ({goal}; ran {steps} steps)")]
    lines += [("carriage", show("mean_carriage_steps", unit="steps on average"))] if is_cleaning else []
    lines += [("collisions", show("collisions"))]
    lines += [("fitness", show("fitness"))] if is_cleaning else []
    lines += [
        ("time", f"{wall_s:.1f} s, " + _speed(content)),
        ("results", str(out)),
    ]
    return "\n".join(f"{name:>12}  {text}" for name, text in lines)


def _speed(content: Mapping[str, Any]) -> str:
    """Time of a control step without what is compiled in the first call."""
    first, each = (content.get("seconds", {}).get(name) for name in ("first_call", "control_step"))
    if first is None or each is None:
        return "compilation included"
    return f"{1e3 * each:.1f} ms per control step after {first:.1f} s for the first call, which compiles"
