"""All experiments by their names: source, title, runs, figures, tables."""

from collections.abc import Callable, Sequence
from pathlib import Path

from iswarm_mj.paper.analysis import measures as m
from iswarm_mj.paper.analysis.findings import NOT_IN_PAPER
from iswarm_mj.paper.analysis.plots import draw_bars, draw_effects
from iswarm_mj.paper.analysis.varied_values import TRIALS
from iswarm_mj.paper.studies import settings
from iswarm_mj.paper.studies.experiment import Experiment
from iswarm_mj.paper.studies.observed_runs import observe_time_steps, record_types
from iswarm_mj.paper.studies.reading_combinations import N_COMBINATIONS, combination_settings
from iswarm_mj.paper.studies.reading_support import support_findings
from iswarm_mj.paper.studies.reading_support_plot import draw_support
from iswarm_mj.search.rows import Rows, by, select


def _bars(
    columns: Sequence[str],
    label: str,
    name: Callable[..., str],
    measures: Sequence[m.Measure] = m.MEASURES,
) -> Callable[[Rows, Path], None]:
    """Return a function that draws the bars of an experiment, see `draw_bars`."""

    def draw(rows: Rows, path: Path) -> None:
        draw_bars(rows, columns, label, name, path, measures)

    return draw


def _with_or_without(use_hop_count: bool) -> str:
    """Return the name of a bar with or without hop counts."""
    return "with" if use_hop_count else "without"


def _message_bar(setting: str, use_hop_count: bool) -> str:
    """Return the name of a bar of the study of message times."""
    lines = setting.replace(" bit", "\nbit").replace(", all photodiodes", "\nall")
    return f"{lines}\n{_with_or_without(use_hop_count)}"


def _robustness_bar(fraction: float, kind: str) -> str:
    """Return the name of a bar of the study of failed robots."""
    return f"{100 * fraction:.0f} %\n{kind}"


def _grasp_bar(voltage: float, resolution: str) -> str:
    """Return the name of a bar of the study of grasps."""
    return f"{voltage:g} V\n{'trials' if resolution == TRIALS else 'balance'}"


def _draw_resolved_grasps(rows: Rows, path: Path) -> None:
    """Draw bars by the voltage in the dampest air, a figure for each type."""
    dampest = max(row["relative_humidity"] for row in rows)
    for swarm, swarm_rows in by(select(rows, relative_humidity=dampest), "type").items():
        draw_bars(
            swarm_rows,
            columns=["grasp_voltage", "resolution"],
            label=f"voltage while lifting, at {dampest:g} % RH",
            name=_grasp_bar,
            path=path.with_name(f"{path.name}_{swarm}"),
            measures=(m.TIME, m.ATTEMPTS, m.FAILED, m.STUCK),
        )


_UNTIL = "until 66 of 72 balls or 1200 steps"
_ALL = (
    Experiment(
        name="hop-count",
        source="Fig. 15",
        title=f"with and without hop counts, 12 runs each, {_UNTIL}",
        settings=settings.hop_count_settings,
        figure=_bars(["use_hop_count"], "hop counts", _with_or_without),
        columns=("use_hop_count",),
        measures=m.MEASURES,
    ),
    Experiment(
        name="density",
        source="Fig. 17",
        title=f"densities from 0.05 to 0.4, 12 runs each, {_UNTIL}",
        settings=settings.density_settings,
        figure=_bars(["density"], "density of robots", "{:g}".format),
        columns=("density",),
        measures=m.MEASURES,
        quick_repeats=2,
    ),
    Experiment(
        name="types",
        source="Fig. 16, Table 2",
        title="times and fitness of both evolved types over 96 runs, with drawings",
        settings=settings.type_settings,
        figure=_bars(
            ["type"], "type", str, measures=(m.FITNESS, m.TIME, m.COLLISIONS, m.AGGREGATION)
        ),
        columns=("type",),
        measures=(m.TIME, m.FITNESS, m.AGGREGATION),
        observe=record_types,
        repeats=24,
        limit=m.EVOLUTION_STEPS,
        quick_limit=200,
    ),
    Experiment(
        name="sensitivity",
        source=NOT_IN_PAPER,
        title="each choice that the paper leaves open, one at a time about the default, 10 runs "
        "each",
        settings=settings.sensitivity_settings,
        figure=draw_effects,
        repeats=10,
    ),
    Experiment(
        name="robustness",
        source=NOT_IN_PAPER,
        title=f"0 to 50 % of the robots dead, or left out, 12 runs each, {_UNTIL}",
        settings=settings.robustness_settings,
        figure=_bars(["fraction", "kind"], "failed robots", _robustness_bar),
        columns=("fraction", "kind"),
        measures=(m.TIME, m.DUST),
    ),
    Experiment(
        name="time-step",
        source=NOT_IN_PAPER,
        title=f"both types at 2 to 100 physics steps a second, 24 runs each, {_UNTIL}",
        settings=settings.time_step_settings,
        figure=_bars(["type", "rate"], "physics steps a second", "{}\n{}".format),
        columns=("type", "rate"),
        measures=(m.TIME, m.COLLISIONS, m.OVERLAP, m.STEP_TIME),
        observe=observe_time_steps,
        repeats=24,
    ),
    Experiment(
        name="message-time",
        source="section 4.1, Fig. 15",
        title="hop counts on and off where messages take time, at three baud rates, 12 runs each",
        settings=settings.message_time_settings,
        figure=_bars(["setting", "use_hop_count"], "messages, hop counts", _message_bar),
        columns=("setting", "use_hop_count"),
        measures=(m.TIME, m.DUST, m.COLLISIONS),
    ),
    Experiment(
        name="resolved-grasps",
        source=NOT_IN_PAPER,
        title="grasps by trials and by the balance of the forces, three humidities and voltages, "
        "24 pairs of runs each",
        settings=settings.resolved_grasps_settings,
        figure=_draw_resolved_grasps,
        columns=("type", "relative_humidity", "grasp_voltage", "resolution"),
        measures=(m.TIME, m.ATTEMPTS, m.FAILED, m.STUCK, m.BROKEN, m.LOST),
        repeats=24,
        quick_repeats=2,
        quick_limit=100,
    ),
    Experiment(
        name="infer",
        source="section 4.6",
        title=f"{N_COMBINATIONS} combinations of readings on Figs. 15 and 17 and both types",
        settings=combination_settings,
        figure=draw_support,
        judge=support_findings,
        repeats=1,
        quick_repeats=1,
        quick_limit=100,
    ),
)
EXPERIMENTS = {experiment.name: experiment for experiment in _ALL}
"""All experiments by their names, in the order of lists and reports."""


def listing() -> str:
    """Return names and titles, a line each."""
    width = max(map(len, EXPERIMENTS))
    return "\n".join(
        f"{name:{width}}  {experiment.source}: {experiment.title}"
        for name, experiment in EXPERIMENTS.items()
    )
