"""The types of very fit swarms (Fig. 16, Table 2): fitness, aggregation, pictures and videos."""

import io
import subprocess
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.experiments.analysis.findings import (
    FITTED,
    NOT_COMPARABLE,
    NOT_IN_PAPER,
    PREDICTED,
    Claim,
    Finding,
    Rows,
    in_words,
    number,
    percent,
    rule_of,
    span,
    verdict_of,
)
from iswarm_mj.experiments.analysis.measures import TIME, finished, select, values
from iswarm_mj.experiments.analysis.paper import NEARLY, PAPER_FITNESS, PAPER_TIME, SHORTEST, STEPS
from iswarm_mj.experiments.analysis.plots import draw_samples
from iswarm_mj.experiments.analysis.statistics import Interval, compare, difference, interval, mean, median, share
from iswarm_mj.experiments.analysis.verdicts import EQUAL, RARE, all_of, enough, mostly, within
from iswarm_mj.experiments.runner.experiment import Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.output.plot_swarm import draw_swarm
from iswarm_mj.output.saved import load
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.units import ROBOT_DIAMETER
from iswarm_mj.workflows.clean import clean

REPEATS = 24
COMPARED = 96
"""Runs of each of the paper's types: their times scatter by a fifth, and 24 runs could not show that two are equal."""
RECORDED = 6
"""Runs of each type whose trajectories are looked at."""
NEAR = 3.5
"""A robot is at a dust area if it is in it or within this distance of it, the sensory radius [rd]."""

CLEAN = Claim(
    "Both types clean the whole arena within 800 steps", "Table 2, section 4.6", "fitness above 2860: yes", PREDICTED
)
TIMES = Claim(
    "Both types take as long as the paper's to clean the arena",
    "Table 2, section 4.6",
    f"{PAPER_TIME['type1']} and {PAPER_TIME['type2']} steps at most, by their fitness",
    NOT_COMPARABLE,
)
ALIKE = Claim(
    "Both types take equally long to clean the arena", "Table 2, Fig. 16", "equivalent: 310 and 311 steps", PREDICTED
)
FITNESS = Claim(
    "Both types have the paper's fitness", "Table 2, Fig. 16", "7771 (type 1) and 7766 (type 2) points", NOT_COMPARABLE
)
AS_FIT = Claim("Both types are equally fit", "section 4.6.1, Table 2", "equivalent: 7771 and 7766 points", PREDICTED)
LEAST = Claim(
    f"No run of both types finishes in less than {SHORTEST} steps", "section 4.6", "shortest in theory: 250", PREDICTED
)
GATHER = Claim(
    "Empty robots gather around the dust areas more in type 2 than in type 1",
    "Fig. 16",
    "more intensive in type 2",
    PREDICTED,
)


def entries(plan: Plan) -> list[Entry]:
    """Runs of all presets, each at its own density."""
    listed, steps = [], 200 if plan.quick else STEPS
    for place, (name, genome) in enumerate(PRESETS.items()):
        repeats = 3 if plan.quick else COMPARED if name in PAPER_FITNESS else REPEATS
        n_robots = robots_for(plan.config.arena, genome.density_of_robots)
        for repeat in range(repeats):
            job = Job(plan.config, genome, n_robots, run_seed(plan.seed, place, repeat), steps)
            listed.append(Entry({"type": name, "repeat": repeat}, job))
    return listed


def findings(rows: Rows) -> list[Finding]:
    """Cleanness, finishing times, fitness and aggregation of the paper's types, and other presets against them."""
    types = {name: select(rows, type=name) for name in PAPER_FITNESS}
    if not all(types.values()):
        return [claim.not_run() for claim in (CLEAN, TIMES, ALIKE, LEAST, FITNESS, AS_FIT, GATHER)]
    found = [_clean(types), _times(types), _alike(types), _least(types), _fitness(types), _as_fit(types)]
    found.append(_gathering(*types.values()))
    for name in PRESETS:
        runs = select(rows, type=name)
        if name not in types and runs:
            found += [_better(name, runs, other) for other in types.values()]
    return found


def aggregation(frames: Mapping[str, np.ndarray]) -> float:
    """Share of the empty workers that are at a dust area, meant over the steps until half of the balls are delivered.

    Args:
        frames: arrays of a trajectory.
    """
    n_dust = frames["ball_position"].shape[1]
    until = max(1, int(np.searchsorted(frames["delivered"], n_dust / 2)))
    xy, reach = frames["pose"][:until, :, None, :2], NEAR * ROBOT_DIAMETER
    areas = frames["scene_dust_areas"]
    outside = np.maximum(areas[:, :2] - xy, xy - areas[:, 2:]).max(axis=-1)
    is_empty = ~frames["is_loaded"][:until] & ~frames["scene_is_scout"]
    is_there = (outside <= reach).any(axis=-1) & is_empty
    return float(np.mean(is_there.sum(axis=1) / np.maximum(1, is_empty.sum(axis=1))))


def record(plan: Plan, out: Path, rows: list[dict[str, Any]]) -> None:
    """Record the first runs of each type; add their aggregation to the rows; draw and film the first one."""
    for row in rows:
        row["aggregation"] = None
    for row in rows:
        if row["repeat"] >= (1 if plan.quick else RECORDED):
            continue
        directory = out / f"{row['type']}-{row['repeat']}"
        settings = RunSettings(row["n_robots"], row["max_steps"], row["seed"], stop_at=plan.goal)
        with redirect_stdout(io.StringIO()):
            clean(Run(plan.config, PRESETS[row["type"]], settings), settings, directory)
        frames = load(directory).arrays
        row["aggregation"] = aggregation(frames)
        if row["repeat"] == 0:
            _show(row["type"], directory, frames, out, plan.quick)


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw fitness, time and aggregation of each type, a dot a run."""
    names = list(dict.fromkeys(row["type"] for row in rows))
    columns = {
        "fitness [points]": lambda row: row["fitness"],
        "time to deliver all balls [steps]": TIME.value,
        "share of the empty workers at dust areas": lambda row: row["aggregation"],
    }
    samples = {
        label: {name: [v for row in select(rows, type=name) if (v := value(row)) is not None] for name in names}
        for label, value in columns.items()
    }
    return [draw_samples(samples, out / "types")]


def _clean(types: Mapping[str, Rows]) -> Finding:
    """Whether most runs of each type deliver all balls."""
    ours = ", ".join(f"{finished(runs)} of {len(runs)} runs of {name}" for name, runs in types.items())
    rule = (
        f"all balls within {STEPS} steps; holds if the exact 95 % interval of the share of such runs lies above one "
        "half for both, does not if one lies below"
    )
    return CLEAN.found(ours, rule, all_of(mostly(finished(runs), len(runs)) for runs in types.values()))


def _times(types: Mapping[str, Rows]) -> Finding:
    """Whether each type's median finishing time is the paper's, within a tenth of it."""
    found = {name: interval(values(runs, TIME), median) for name, runs in types.items()}
    ours = "; ".join(
        f"{name}: median {span(time, 'steps')}, {100 * (time.estimate / PAPER_TIME[name] - 1):+.0f} %"
        for name, time in found.items()
    )
    rule, verdict = _as_the_papers(types, found, PAPER_TIME, EQUAL)
    return TIMES.found(ours, f"runs that do not finish counted as {STEPS} steps; {rule}", verdict)


def _alike(types: Mapping[str, Rows]) -> Finding:
    """Whether the finishing times of both types are equivalent."""
    one, two = (values(runs, TIME) for runs in types.values())
    apart, margin = difference(one, two), EQUAL * (np.median(one) + np.median(two)) / 2
    ours = f"median {number(float(np.median(one)))} and {number(float(np.median(two)))} steps"
    rule = (
        f"equivalence test: holds if the interval lies within ±{number(margin)} steps, {100 * EQUAL:.0f} % of the "
        "medians, does not if it lies outside"
    )
    verdict = enough(within(apart, -margin, margin), len(one), len(two))
    return ALIKE.found(ours, f"{in_words(compare(one, two), 'steps')}; {rule}", verdict)


def _least(types: Mapping[str, Rows]) -> Finding:
    """Whether runs of each type that finish before the paper's theoretical shortest time are rare."""
    early = {name: sum((row["finished_at"] or STEPS) < SHORTEST for row in runs) for name, runs in types.items()}
    shares = {name: share(count, len(types[name]), "exact") for name, count in early.items()}
    ours = ", ".join(f"{count} of {len(types[name])} runs of {name} do" for name, count in early.items())
    rule = (
        f"{', '.join(f'{name}: {percent(found)}' for name, found in shares.items())}, exact; holds if both intervals "
        f"lie below {100 * RARE:.0f} %, does not if one lies above"
    )
    return LEAST.found(ours, rule, all_of(enough(within(shares[name], high=RARE), len(types[name])) for name in types))


def _fitness(types: Mapping[str, Rows]) -> Finding:
    """Whether each type's mean fitness is the paper's, within 5 %."""
    found = {name: interval([row["fitness"] for row in runs]) for name, runs in types.items()}
    ours = "; ".join(
        f"{name}: mean {span(points, 'points', 4)}, {100 * (points.estimate / PAPER_FITNESS[name] - 1):+.1f} %, best "
        f"{max(row['fitness'] for row in types[name]):.0f}"
        for name, points in found.items()
    )
    return FITNESS.found(ours, *_as_the_papers(types, found, PAPER_FITNESS, NEARLY))


def _as_the_papers(
    types: Mapping[str, Rows], found: Mapping[str, Interval], paper: Mapping[str, float], margin: float
) -> tuple[str, str]:
    """Rule and verdict on whether both types have the paper's values within a share of them."""
    verdicts = [
        enough(within(value, (1 - margin) * paper[name], (1 + margin) * paper[name]), len(types[name]))
        for name, value in found.items()
    ]
    rule = (
        f"n = {_sizes(types)}; holds if both intervals lie within {100 * margin:.0f} % of the paper's, does not if one "
        "lies outside; the paper's are of the fittest run of each type among the 1200 of an evolution, ours are fresh "
        "runs of its parameters"
    )
    return rule, all_of(verdicts)


def _as_fit(types: Mapping[str, Rows]) -> Finding:
    """Whether the mean fitness of both types is equivalent."""
    one, two = ([row["fitness"] for row in runs] for runs in types.values())
    apart, margin = difference(one, two, mean), NEARLY * PAPER_FITNESS["type1"]
    rule = (
        f"n = {_sizes(types)}; difference of the means {span(apart, 'points')}; equivalence test: holds if the "
        f"interval lies within ±{margin:.0f} points, {100 * NEARLY:.0f} % of the paper's {PAPER_FITNESS['type1']}, "
        "does not if it lies outside"
    )
    verdict = enough(within(apart, -margin, margin), len(one), len(two))
    return AS_FIT.found(f"mean {np.mean(one):.0f} and {np.mean(two):.0f} points", rule, verdict)


def _sizes(types: Mapping[str, Rows]) -> str:
    return " + ".join(str(len(runs)) for runs in types.values())


def _gathering(one: Rows, two: Rows) -> Finding:
    first, second = ([row["aggregation"] for row in runs if row["aggregation"] is not None] for runs in (one, two))
    if not first or not second:
        return GATHER.not_run()
    result = compare(second, first)
    ours = (
        f"median {100 * np.median(second):.0f} % of the empty workers in type 2, {100 * np.median(first):.0f} % in "
        f"type 1, within {NEAR:g} rd of a dust area until half of the balls are delivered"
    )
    return GATHER.found(ours, f"{in_words(result)}; {rule_of(True)}", verdict_of(result, True))


def _better(name: str, runs: Rows, other: Rows) -> Finding:
    """Whether another preset is fitter than one of the paper's types."""
    rival = other[0]["type"]
    # Fitted: an evolution selected it by this fitness, in this simulator, if not with these seeds.
    claim = Claim(f"The preset {name} is fitter than {rival}", NOT_IN_PAPER, "-", FITTED)
    first, second = ([row["fitness"] for row in group] for group in (runs, other))
    result = compare(first, second)
    ours = f"mean {number(float(np.mean(first)), 4)} against {number(float(np.mean(second)), 4)} points"
    return claim.found(ours, f"{in_words(result, 'points')}; {rule_of(True)}", verdict_of(result, True))


def _show(name: str, directory: Path, frames: Mapping[str, np.ndarray], out: Path, quick: bool) -> None:
    """Drawing, MuJoCo's picture and video of a recorded run, when half of the balls are delivered."""
    n_dust, last = frames["ball_position"].shape[1], int(frames["step"][-1])
    step = min(last, int(np.searchsorted(frames["delivered"], n_dust / 2)))
    title = name.replace("type", "type ")
    draw_swarm(
        frames, step, f"{title}, step {step}, {frames['delivered'][step]} of {n_dust} balls delivered", out / name
    )
    picture = ["--step", str(step), "--camera", "oblique", "--width", "1280", "--height", "720"]
    _render("picture", [str(directory), *picture, "--out", str(out / f"{name}_mujoco.png")])
    length = ["--steps", "40", "--frames-per-step", "1"] if quick else []
    _render("video", [str(directory), "--title", title, *length, "--out", str(out / f"{name}.mp4")])


def _render(command: str, arguments: list[str]) -> None:
    """Run a command of iswarm that renders, in a process of its own: OpenGL is chosen when MuJoCo is imported."""
    done = subprocess.run([sys.executable, "-m", "iswarm_mj", command, *arguments], check=False)
    if done.returncode:
        print(f"the {command} was left out; all else is complete", file=sys.stderr)


EXPERIMENT = Experiment(
    name="types",
    title="times and fitness of both evolved types over 96 runs, pictures and videos of them at run time",
    source="Fig. 16, Table 2",
    entries=entries,
    findings=findings,
    draw=draw,
    extra=record,
)
