"""All experiments by their names: source, title, runs, figures, tables."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from iswarm_mj.paper.analysis import measures as m
from iswarm_mj.paper.analysis.findings import NOT_IN_PAPER
from iswarm_mj.paper.analysis.plots import draw_bars, draw_effects
from iswarm_mj.paper.analysis.statements import TRIALS
from iswarm_mj.paper.studies import infer, observed, plans, support
from iswarm_mj.paper.studies.experiment import Experiment
from iswarm_mj.search.rows import Rows, by, select


def _bars(
    columns: Sequence[str], label: str, name: Callable[..., str], *measures: m.Measure
) -> Any:
    """What draws the bars of a study, see `draw_bars`."""
    return lambda rows, path: draw_bars(rows, columns, label, name, path, measures or m.MEASURES)


def _with(flag: bool) -> str:
    return "with" if flag else "without"


def _message(setting: str, flag: bool) -> str:
    lines = setting.replace(" bit", "\nbit").replace(", all photodiodes", "\nall")
    return f"{lines}\n{_with(flag)}"


def _grip(voltage: float, resolution: str) -> str:
    return f"{voltage:g} V\n{'trials' if resolution == TRIALS else 'balance'}"


def _resolved_grasps(rows: Rows, path: Path) -> None:
    """By the voltage in the dampest air, a figure for each type."""
    damp = max(row["relative_humidity"] for row in rows)
    label, measures = (
        f"voltage while lifting, at {damp:g} % RH",
        (m.TIME, m.ATTEMPTS, m.FAILED, m.STUCK),
    )
    for name, mine in by(select(rows, relative_humidity=damp), "type").items():
        at = path.with_name(f"{path.name}_{name}")
        draw_bars(mine, ["grasp_voltage", "resolution"], label, _grip, at, measures)


_UNTIL = "until 66 of 72 balls or 1200 steps"
_LISTED = (
    Experiment(
        *("hop-count", "Fig. 15", f"with and without hop counts, 12 runs each, {_UNTIL}"),
        plans.hop_count,
        _bars(["use_hop_count"], "hop counts", _with),
        ("use_hop_count",),
        m.MEASURES,
    ),
    Experiment(
        *("density", "Fig. 17", f"densities from 0.05 to 0.4, 12 runs each, {_UNTIL}"),
        plans.density,
        _bars(["density"], "density of robots", "{:g}".format),
        ("density",),
        m.MEASURES,
        few=2,
    ),
    Experiment(
        *(
            "types",
            "Fig. 16, Table 2",
            "times and fitness of both evolved types over 96 runs, with drawings",
        ),
        plans.types,
        _bars(["type"], "type", str, m.FITNESS, m.TIME, m.COLLISIONS, m.AGGREGATION),
        ("type",),
        (m.TIME, m.FITNESS, m.AGGREGATION),
        extra=observed.record,
        repeats=24,
        steps=200,
        limit=m.STEPS,
    ),
    Experiment(
        *("sensitivity", NOT_IN_PAPER),
        "each choice that the paper leaves open, one at a time about the default, 10 runs each",
        plans.sensitivity,
        draw_effects,
        repeats=10,
    ),
    Experiment(
        *(
            "robustness",
            NOT_IN_PAPER,
            f"0 to 50 % of the robots dead, or left out, 12 runs each, {_UNTIL}",
        ),
        plans.robustness,
        _bars(
            ["fraction", "kind"], "failed robots", lambda part, kind: f"{100 * part:.0f} %\n{kind}"
        ),
        ("fraction", "kind"),
        (m.TIME, m.DUST),
    ),
    Experiment(
        *(
            "time-step",
            NOT_IN_PAPER,
            f"both types at 2 to 100 physics steps a second, 24 runs each, {_UNTIL}",
        ),
        plans.time_step,
        _bars(["type", "rate"], "physics steps a second", "{}\n{}".format),
        ("type", "rate"),
        (m.TIME, m.COLLISIONS, m.OVERLAP, m.STEP_TIME),
        extra=observed.observe,
        repeats=24,
    ),
    Experiment(
        *("message-time", "section 4.1, Fig. 15"),
        "hop counts on and off where messages take time, at three baud rates, 12 runs each",
        plans.message_time,
        _bars(["setting", "use_hop_count"], "messages, hop counts", _message),
        ("setting", "use_hop_count"),
        (m.TIME, m.DUST, m.COLLISIONS),
    ),
    Experiment(
        *("resolved-grasps", NOT_IN_PAPER),
        "grasps by trials and by the balance of the forces, three humidities and voltages, 24 pairs of runs each",
        plans.resolved_grasps,
        _resolved_grasps,
        ("type", "relative_humidity", "grasp_voltage", "resolution"),
        (m.TIME, m.ATTEMPTS, m.FAILED, m.STUCK, m.BROKEN, m.LOST),
        repeats=24,
        few=2,
        steps=100,
    ),
    Experiment(
        *("infer", "section 4.6"),
        f"{infer.COMBINATIONS} combinations of readings on Figs. 15 and 17 and both types",
        infer.settings,
        support.draw,
        judge=support.findings,
        repeats=1,
        few=1,
        steps=100,
    ),
)
EXPERIMENTS = {experiment.name: experiment for experiment in _LISTED}


def listing() -> str:
    """Names and titles, a line each."""
    width = max(map(len, EXPERIMENTS))
    return "\n".join(f"{e.name:{width}}  {e.source}: {e.title}" for e in EXPERIMENTS.values())
