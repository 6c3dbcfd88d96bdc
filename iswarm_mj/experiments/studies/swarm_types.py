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
    ALPHA,
    FITTED,
    PREDICTED,
    UNDECIDED,
    Claim,
    Finding,
    Rows,
    in_words,
    number,
    span,
    verdict_of,
)
from iswarm_mj.experiments.analysis.measures import TIME, finished, select
from iswarm_mj.experiments.analysis.plots import draw_samples
from iswarm_mj.experiments.analysis.statistics import compare, difference, interval, mean, smallest_p
from iswarm_mj.experiments.runner.experiment import Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.output.plot_swarm import draw_swarm
from iswarm_mj.output.stage import load
from iswarm_mj.simulation.initial import robots_for
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.units import ROBOT_DIAMETER
from iswarm_mj.workflows.clean import clean

REPEATS, STEPS = 24, 800
RECORDED = 6
"""Runs of each type whose trajectories are looked at."""
NEAR = 3.5
"""A robot is at a dust area if it is in it or within this distance of it, the sensory radius [rd]."""
EQUAL = 0.1
"""Fitness is equivalent if the difference, with its interval, is less than this share of it."""

CLEAN = Claim(
    "Both types clean the whole arena within 800 steps", "Table 2, section 4.6", "fitness above 2860: yes", PREDICTED
)
FITNESS = Claim(
    "Both types have equivalent fitness", "Table 2, Fig. 16", "7771 (type 1) and 7766 (type 2) points", PREDICTED
)
GATHER = Claim(
    "Empty robots gather around the dust areas more in type 2 than in type 1",
    "Fig. 16",
    "more intensive in type 2",
    PREDICTED,
)


def entries(plan: Plan) -> list[Entry]:
    """Runs of all presets, each at its own density."""
    repeats = 3 if plan.quick else REPEATS
    listed = []
    for place, (name, genome) in enumerate(PRESETS.items()):
        n_robots = robots_for(plan.config.arena, genome.density_of_robots)
        for repeat in range(repeats):
            job = Job(plan.config, genome, n_robots, run_seed(plan.seed, place, repeat), STEPS)
            listed.append(Entry({"type": name, "repeat": repeat}, job))
    return listed


def findings(rows: Rows) -> list[Finding]:
    """Fitness and cleanness of the paper's types, aggregation, and other presets against them."""
    one, two = (select(rows, type=name) for name in ("type1", "type2"))
    if not one or not two:
        return [CLEAN.not_run(), FITNESS.not_run(), GATHER.not_run()]
    cleaned = [f"{finished(runs)} of {len(runs)} runs of {runs[0]['type']}" for runs in (one, two)]
    rule = f"all {one[0]['goal']} balls within {STEPS} steps; holds if at least half of the runs of each do"
    found = [CLEAN.found(", ".join(cleaned), rule, all(2 * finished(runs) >= len(runs) for runs in (one, two)))]
    found += [_fitness(one, two), _gathering(one, two)]
    for name in PRESETS:
        runs = select(rows, type=name)
        if name not in ("type1", "type2") and runs:
            found += [_better(name, runs, other) for other in (one, two)]
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
        settings = RunSettings(row["n_robots"], STEPS, row["seed"], stop_at=plan.goal)
        with redirect_stdout(io.StringIO()):
            clean(Run(plan.config, PRESETS[row["type"]], settings), settings, directory)
        frames = load(directory)[1]
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


def _fitness(one: Rows, two: Rows) -> Finding:
    first, second = ([row["fitness"] for row in runs] for runs in (one, two))
    apart, typical = difference(first, second, mean), np.mean(first + second)
    ours = (
        f"mean {span(interval(first))} and {span(interval(second))} points, best {max(first):.0f} and {max(second):.0f}"
    )
    tested = (
        f"difference of the means {span(apart, 'points')}; {in_words(compare(first, second), 'points')}; "
        f"holds if the interval lies within {100 * EQUAL:.0f} % of the mean fitness"
    )
    few = smallest_p(len(first), len(second)) >= ALPHA
    equal = bool(max(abs(apart.low), abs(apart.high)) < EQUAL * typical)
    return FITNESS.found(ours, tested, UNDECIDED if few else equal)


def _gathering(one: Rows, two: Rows) -> Finding:
    first, second = ([row["aggregation"] for row in runs if row["aggregation"] is not None] for runs in (one, two))
    if not first or not second:
        return GATHER.not_run()
    result = compare(second, first)
    ours = (
        f"median {100 * np.median(second):.0f} % of the empty workers in type 2, {100 * np.median(first):.0f} % in "
        f"type 1, within {NEAR:g} rd of a dust area until half of the balls are delivered"
    )
    return GATHER.found(ours, f"{in_words(result)}; holds if p < 0.01", verdict_of(result, True))


def _better(name: str, runs: Rows, other: Rows) -> Finding:
    """Whether another preset is fitter than one of the paper's types."""
    rival = other[0]["type"]
    # Fitted: an evolution selected it by this fitness, in this simulator, if not with these seeds.
    claim = Claim(f"The preset {name} is fitter than {rival}", "not in the paper", "-", FITTED)
    first, second = ([row["fitness"] for row in group] for group in (runs, other))
    result = compare(first, second)
    ours = f"mean {number(float(np.mean(first)), 4)} against {number(float(np.mean(second)), 4)} points"
    return claim.found(ours, f"{in_words(result, 'points')}; holds if p < 0.01", verdict_of(result, True))


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
    title="fitness of both evolved types over 24 runs, pictures and videos of them at run time",
    source="Fig. 16, Table 2",
    entries=entries,
    findings=findings,
    draw=draw,
    extra=record,
)
