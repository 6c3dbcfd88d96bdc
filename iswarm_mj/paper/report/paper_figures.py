"""Figures of ours that have the paper's values beside them: Figs. 8, 9, 14 to 17, Tables 1 and 2.

The paper's values are those of its text, captions and axes, redrawn as marks; its plots were not
digitised. Each figure is written as SVG for light and for dark pages.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from PIL import Image

from iswarm_mj.gripper.reference import PAPER_FIG_6, PAPER_GRASP, PAPER_HUMIDITY
from iswarm_mj.output.palette import FLOOR
from iswarm_mj.output.plot_style import Theme, write_themed
from iswarm_mj.paper.analysis import measures as m
from iswarm_mj.paper.analysis.choice_effects import ChoiceEffect, effects_of_choices
from iswarm_mj.paper.analysis.evolution import RISE, Evolution, evolutions
from iswarm_mj.paper.analysis.measures import Measure, values
from iswarm_mj.paper.report.results import Result
from iswarm_mj.search.rows import Rows, by, select
from iswarm_mj.strategy.genome import TYPE1, TYPE2, Genome
from iswarm_mj.utils.arrays import Array

UM = 1e6
"""Micrometres per metre."""
_FIG_6_RADIUS = 23.0
"""Radius of the ball in the paper's Fig. 6 [um]."""
_UNSUCCESSFUL_FITNESS = 2860
"""Greatest fitness of a swarm that does not deliver all dust, by section 4.6 [points]."""
_SCOUTS_OF_CLEAN = (0.16, 0.12)
"""Mean and standard deviation of the fraction of scouts in the paper's successful swarms."""
_FORGETTING_OF_CLEAN = (0.28, 0.13)
"""Mean and standard deviation of p(vector-forget) in the paper's successful swarms."""
_TITLE_HEIGHT = 90
"""Height of the title above the arena in a picture of a swarm [pixel]."""
_LEGEND_HEIGHT = 110
"""Height of scale and legend below the arena in a picture of a swarm [pixel]."""
_HALF = (4.6, 2.7)
"""Size of a figure with one panel [inch]."""

Results = Mapping[str, Result]
"""Tables of results by their names."""


class PaperFigure(NamedTuple):
    """A figure or table of the paper, and ours beside it."""

    name: str
    """Name of the files."""
    title: str
    """Name in the paper, and what it is about."""
    needs: tuple[str, ...]
    """Names of the results that it is drawn from."""
    draw: Callable[[Results, list[Axes], Theme], None]
    """Draws it on axes."""
    layout: Mapping[str, Any]
    """Rows, columns and size of the axes."""

    def write(self, results: Results, directory: Path) -> None:
        """Write the files into a directory."""

        def draw(axes: list[Axes], theme: Theme) -> None:
            self.draw(results, axes, theme)

        write_themed(directory / self.name, draw, **self.layout)


# --- Figs. 8 and 9: grasp voltages ---


def _draw_grasps(results: Results, axes: list[Axes], theme: Theme) -> None:
    """Draw Fig. 8, grasp voltages over the radius at the paper's humidity."""
    (panel,) = axes
    grasps = _grasps_at(results, PAPER_HUMIDITY)
    panel.axhspan(*PAPER_GRASP, color=theme.paper, alpha=0.25, lw=0, label="paper: 20 to 30 V")
    panel.plot(
        _FIG_6_RADIUS, PAPER_FIG_6, "D", color=theme.paper, ms=7, label="paper: the ball of Fig. 6"
    )

    radii = [row["radius"] * UM for row in grasps]
    voltages = [row["voltage"] for row in grasps]
    panel.plot(radii, voltages, ".", color=theme.pale, ms=5, label="ours: each trial")
    _draw_mean_voltages(panel, grasps, "o-", theme.ours, "ours: mean")
    panel.set(xlabel="radius of the ball [µm]", ylabel="grasp voltage [V]", ylim=(0, 42))
    _legend_above(panel)


def _draw_humidities(results: Results, axes: list[Axes], theme: Theme) -> None:
    """Draw Fig. 9, mean grasp voltages over the radius at 10, 30 and 50 % relative humidity."""
    (panel,) = axes
    panel.axhspan(*PAPER_GRASP, color=theme.paper, alpha=0.25, lw=0, label="paper: at 10 % RH")
    for humidity, mark in ((50.0, "^-"), (30.0, "s-"), (PAPER_HUMIDITY, "o-")):
        colour = theme.pale if humidity == PAPER_HUMIDITY else theme.ours
        label = f"ours: at {humidity:g} % RH"
        _draw_mean_voltages(panel, _grasps_at(results, humidity), mark, colour, label)

    # The paper gives no numbers at 30 and 50 %, but a direction.
    arrow = {"arrowstyle": "->", "color": theme.paper, "lw": 1.5}
    panel.annotate("", (14.5, 39.0), (14.5, 30.0), arrowprops=arrow)
    panel.annotate("paper: above, no numbers", (14.8, 37.5), color=theme.paper, fontsize=8)
    panel.set(xlabel="radius of the ball [µm]", ylabel="grasp voltage [V]", ylim=(0, 42))
    panel.set_xlim(14.0, 25.6)
    _legend_above(panel)


def _grasps_at(results: Results, humidity: float) -> Rows:
    """Return the grasps at a relative humidity [%] that have a voltage."""
    grasps = select(results["grasp"].rows, experiment="grasp", faulty=False)
    return [row for row in select(grasps, relative_humidity=humidity) if row["voltage"] is not None]


def _draw_mean_voltages(panel: Axes, grasps: Rows, mark: str, colour: str, label: str) -> None:
    """Draw the mean voltage at each radius."""
    voltages_at = {
        radius * UM: values(rows, m.VOLTAGE).mean()
        for radius, rows in sorted(by(grasps, "radius").items())
    }
    panel.plot(list(voltages_at), list(voltages_at.values()), mark, color=colour, ms=5, label=label)


def _legend_above(panel: Axes, left: float = 0.0, columns: int = 2) -> None:
    """Add a legend above the axes, whose left end is at a share of their width."""
    corner: Any = {"loc": "lower left", "bbox_to_anchor": (left, 1.0), "borderaxespad": 0.2}
    panel.legend(ncols=columns, fontsize=8, columnspacing=1.0, handletextpad=0.5, **corner)


# --- Fig. 14: the evolution ---


def _draw_evolution(results: Results, axes: list[Axes], theme: Theme) -> None:
    """Draw Fig. 14: the best fitness of generations, and forgetting against scouts."""
    table = results["evolve-paper"]
    samples = evolutions(table.rows, table.settings["config"]["arena"]["n_dust"])
    _draw_best_fitness(axes[0], samples, theme)
    _draw_trade_off(axes[1], [sample for sample in samples if sample.fittest], theme)


def _draw_best_fitness(panel: Axes, samples: Sequence[Evolution], theme: Theme) -> None:
    """Draw the best fitness of each generation: median and range over the evolutions."""
    n_generations = min(len(sample.bests) for sample in samples)
    bests = np.array([sample.bests[:n_generations] for sample in samples])
    generations = np.arange(1, n_generations + 1)
    span = {"color": theme.pale, "alpha": 0.6, "lw": 0}
    panel.fill_between(generations, bests.min(axis=0), bests.max(axis=0), **span)
    median = np.median(bests, axis=0)
    label = "ours: best of a generation"
    panel.plot(generations, median, color=theme.ours, lw=1.5, label=label)

    panel.axhline(m.PAPER_FITNESS["type1"], color=theme.paper, lw=1.5, label="paper: fittest run")
    label = "paper: most unless all is clean"
    panel.axhline(_UNSUCCESSFUL_FITNESS, color=theme.paper, lw=1, ls="--", label=label)
    panel.axvspan(1, RISE, color=theme.paper, alpha=0.12, lw=0, label="paper: steady rise")
    panel.set(xlabel="generation", ylabel="fitness [points]", ylim=(0, 10500))
    panel.set_xlim(1, n_generations)
    _legend_above(panel)


def _draw_trade_off(panel: Axes, samples: Sequence[Evolution], theme: Theme) -> None:
    """Draw forgetting against scouts: a line through the fittest swarms of each evolution."""
    for sample in samples:
        _draw_trend(panel, sample, theme)
    panel.plot([], [], color=theme.ours, lw=1.2, label="ours: trend of the 250 fittest")

    # The paper's two types, and the means of its swarms that clean the arena.
    types = {"1": TYPE1, "2": TYPE2}
    scouts = [genome.fraction_scouts for genome in types.values()]
    forgetting = [genome.p_vector_forget for genome in types.values()]
    label = "paper: types 1 and 2"
    panel.plot(scouts, forgetting, "D--", color=theme.paper, ms=6, label=label)
    for name, genome in types.items():
        place = (genome.fraction_scouts, genome.p_vector_forget)
        panel.annotate(name, place, (5, 3), textcoords="offset points", color=theme.paper)
    scouts_mean, scouts_spread = _SCOUTS_OF_CLEAN
    forgetting_mean, forgetting_spread = _FORGETTING_OF_CLEAN
    panel.errorbar(
        scouts_mean,
        forgetting_mean,
        xerr=scouts_spread,
        yerr=forgetting_spread,
        fmt="s",
        color=theme.paper,
        ms=4,
        label="paper: clean swarms, SD",
    )
    panel.set(xlabel="fraction of scouts", ylabel="p(vector-forget)", xlim=(0, 1), ylim=(0, 1))
    _legend_above(panel)


def _draw_trend(panel: Axes, sample: Evolution, theme: Theme) -> None:
    """Draw the mean of the fittest swarms of an evolution, and least squares through 90 % of them.

    There is no line where the fittest have all the same share of scouts.
    """
    scouts = np.array([row["fraction_scouts"] for row in sample.fittest])
    forgetting = np.array([row["p_vector_forget"] for row in sample.fittest])
    if np.ptp(scouts) > 0:
        slope, _ = np.polyfit(scouts, forgetting, 1)
        ends = np.quantile(scouts, [0.05, 0.95])
        line = forgetting.mean() + slope * (ends - scouts.mean())
        panel.plot(ends, line, color=theme.ours, lw=1.2)
    panel.plot(scouts.mean(), forgetting.mean(), "o", color=theme.ours, ms=3)


# --- Figs. 15 and 17: bars ---


def _draw_hop_counts(results: Results, axes: list[Axes], theme: Theme) -> None:
    """Draw Fig. 15: four measures with and without hop counts."""
    groups = by(results["hop-count"].rows, "use_hop_count")
    rows_of_bar = {"with": groups[True], "without": groups[False]}
    for panel, measure, letter in zip(axes, m.MEASURES, "abcd", strict=True):
        _draw_medians(panel, rows_of_bar, measure, theme)
        panel.set_title(f"({letter}) {measure.label}", loc="left")
        # The paper's text says which bar is lower.
        lower = 1 if measure.is_better_larger else 0
        top = 1.3 * max(values(rows, measure).max() for rows in rows_of_bar.values())
        panel.set_ylim(0, top)
        panel.text(lower, 0.9 * top, "paper: lower", color=theme.paper, ha="center", fontsize=8)
        panel.plot(lower, 0.85 * top, "v", color=theme.paper, ms=5)


def _draw_densities(results: Results, axes: list[Axes], theme: Theme) -> None:
    """Draw Fig. 17: four measures over the density, with the paper's best densities."""
    groups = sorted(by(results["density"].rows, "density").items())
    rows_of_bar = {f"{density:g}"[1:]: rows for density, rows in groups}
    densities = [density for density, _ in groups]
    for panel, measure, letter in zip(axes, m.MEASURES, "abcd", strict=True):
        is_cleaning = measure is m.DUST
        low, high = m.CLEANING_DENSITIES if is_cleaning else m.BEST_DENSITIES
        first, last = np.interp([low, high], densities, range(len(densities)))
        label = "paper: cleans all" if is_cleaning else "paper: lowest"
        style: Any = {"color": theme.paper, "alpha": 0.25, "lw": 0, "label": label}
        panel.axvspan(first - 0.5, last + 0.5, **style)
        _draw_medians(panel, rows_of_bar, measure, theme)
        panel.set_title(f"({letter}) {measure.label}", loc="left")
        if is_cleaning:
            panel.set_ylim(0, 95)
        panel.legend(loc="upper left", fontsize=8)
    for panel in axes[2:]:
        panel.set_xlabel("density of robots")


def _draw_medians(
    panel: Axes, rows_of_bar: Mapping[str, Rows], measure: Measure, theme: Theme
) -> None:
    """Draw bars up to the median, lines up to the third quartile, and a dot for each run."""
    for place, rows in enumerate(rows_of_bar.values()):
        sample = values(rows, measure)
        median, third_quartile = np.quantile(sample, [0.5, 0.75])
        panel.bar(place, median, 0.7, color=theme.pale)
        error = [[0], [third_quartile - median]]
        panel.errorbar(place, median, error, color=theme.ink, capsize=3, lw=1)
        shifts = np.linspace(-0.25, 0.25, len(sample))
        panel.plot(place + shifts, sample, ".", color=theme.ours, ms=2.5)
    panel.set_xticks(range(len(rows_of_bar)), list(rows_of_bar))
    panel.grid(axis="x", visible=False)
    panel.set_ylim(bottom=0)


# --- Fig. 16: the two types ---


def _draw_types(results: Results, axes: list[Axes], theme: Theme) -> None:
    """Draw Fig. 16: a swarm of each type, their times, and how they gather at dust areas."""
    table = results["types"]
    for panel, name in zip(axes[:2], m.PAPER_TIME, strict=True):
        _draw_picture(panel, table.path.with_name(f"{name}.png"))
        panel.set_title(f"{name.replace('type', 'type ')}, simulated", loc="left")

    groups = by(table.rows, "type")
    rows_of_type = {name: groups[name] for name in m.PAPER_TIME}
    for place, paper_time in enumerate(m.PAPER_TIME.values()):
        label = "paper's fittest" if place == 0 else ""
        axes[2].plot(place + 0.42, paper_time, "D", color=theme.paper, ms=6, label=label)
    for panel, measure in ((axes[2], m.TIME), (axes[3], m.AGGREGATION)):
        _draw_medians(panel, rows_of_type, measure, theme)
    axes[2].set_title("time to clean [steps]", loc="left")
    axes[2].set_ylim(0, 900)
    axes[2].legend(loc="upper left", fontsize=8)
    axes[3].set_title("empty robots at dust [share]", loc="left")
    axes[3].set_ylim(0, 0.7)
    axes[3].plot(1, 0.6, "^", color=theme.paper, ms=5)
    axes[3].text(0.9, 0.6, "paper: higher ", color=theme.paper, ha="right", va="center", fontsize=8)


def _draw_picture(panel: Axes, path: Path) -> None:
    """Draw the arena of a picture that the experiment on types made, white as the floor."""
    panel.set_axis_off()
    if not path.is_file():
        panel.text(0.5, 0.5, f"{path.name} is missing", ha="center", fontsize=8)
        return

    with Image.open(path) as picture:
        width, height = picture.size
        corners = (0, _TITLE_HEIGHT, width, height - _LEGEND_HEIGHT)
        arena = picture.convert("RGB").crop(corners)
    arena.thumbnail((300, 300))
    panel.imshow(np.asarray(arena) / 255 * to_rgb(FLOOR), interpolation="none")


# --- Tables 1 and 2 ---


class TableOneRow(NamedTuple):
    """A line of the paper's Table 1."""

    name: str
    """Name, as printed."""
    printed: str
    """Value, as printed."""
    value: float
    """Value in the unit of the setting."""
    setting: str
    """Setting of the configuration; empty for what the robot's model and its messages have."""


TABLE_1 = (
    TableOneRow("Arena-size", "49 × 49 rd", 49.0, "arena.size"),
    TableOneRow("Dust-particles", "72", 72, "arena.n_dust"),
    TableOneRow("Robot-speed", "0.5 rd/step", 0.5, "drive.step_length"),
    TableOneRow("Error-distance-measure", "10 %", 0.1, "optics.error_distance_measure"),
    TableOneRow("Error-in-communication", "10 %", 0.1, "optics.error_in_communication"),
    TableOneRow("Communication-radius", "3.5 rd", 3.5, "optics.communication_radius"),
    TableOneRow("Number-of-LEDs", "4", 4, ""),
    TableOneRow("Inter-LED-angle", "90°", 90.0, ""),
    TableOneRow("LED-beam-aperture", "60°", 60.0, "optics.led_beam_aperture"),
    TableOneRow("P(communication-break)", "0.1", 0.1, "optics.p_communication_break"),
    TableOneRow("Communication-capacity", "32 bit", 32, ""),
)
"""Lines of Table 1; the second "Dust-in-arena" repeats the first."""


def _draw_table_1(results: Results, axes: list[Axes], theme: Theme) -> None:
    """Draw Table 1: its values, and what another value does to the time to the goal."""
    (panel,) = axes
    effects: dict[str, list[ChoiceEffect]] = {}
    for effect in effects_of_choices(results["sensitivity"].rows):
        effects.setdefault(effect.choice, []).append(effect)

    for place, row in enumerate(TABLE_1):
        panel.plot(0, place, "D", color=theme.paper, ms=6)
        effects_of_row = effects.get(row.setting, [])
        for height, effect in zip(
            _heights_in_row(len(effects_of_row)), effects_of_row, strict=True
        ):
            _draw_effect(panel, place + height, effect, theme)

    # Marks without places, for the legend alone.
    panel.plot([], [], "D", color=theme.paper, ms=6, label="paper and ours")
    panel.plot([], [], "o-", color=theme.ours, ms=4, label="ours, another value")
    panel.set_yticks(range(len(TABLE_1)), [f"{row.name}: {row.printed}" for row in TABLE_1])
    panel.set_ylim(len(TABLE_1) - 0.4, -0.6)
    panel.set_xlabel("change of the mean time [steps]")
    _legend_above(panel, left=-0.6)


def _heights_in_row(number: int) -> Float[Array, "number"]:
    """Return heights for a number of marks in a row of height 1, from -0.22 to 0.22 about 0."""
    return np.linspace(-0.22, 0.22, number) if number > 1 else np.zeros(number)


def _draw_effect(panel: Axes, height: float, effect: ChoiceEffect, theme: Theme) -> None:
    """Draw the interval of an effect on the mean time, with the value that has it."""
    estimate, low, high = effect.change
    panel.plot([low, high], [height, height], color=theme.ours, lw=1.3)
    panel.plot(estimate, height, "o", color=theme.ours, ms=4)
    panel.text(high + 3, height, f"{float(effect.value):g}", va="center", fontsize=7)


_NAME_OF_PARAMETER = {
    "density_of_robots": "Density-of-robots",
    "fraction_scouts": "Fraction-scouts",
    "p_vector_forget": "p(vector-forget)",
    "use_hop_count": "Use-hop-count",
    "priority_coll_avoid_dist": "Priority-coll-avoid-dist [sr]",
    "empty_coll_avoid_dist": "Empty-coll-avoid-dist [sr]",
    "loaded_coll_avoid_dist": "Loaded-coll-avoid-dist [sr]",
    "priority_signal_scouts": "Priority-signal-scouts",
    "priority_signal_loaded": "Priority-signal-loaded",
    "weight_find_dust": "Weight-find-dust",
    "weight_find_dump": "Weight-find-dump",
}
"""Names of the parameters in Table 2 by those of the genome's fields."""


def _draw_table_2(results: Results, axes: list[Axes], theme: Theme) -> None:
    """Draw Table 2: the best genome of each of our evolutions, and the paper's two types."""
    (panel,) = axes
    table = results["evolve-paper"]
    samples = evolutions(table.rows, table.settings["config"]["arena"]["n_dust"])
    shifts = np.linspace(-0.28, 0.28, len(samples))
    for place, field in enumerate(_NAME_OF_PARAMETER):
        bests = [float(getattr(sample.best, field)) for sample in samples]
        label = f"ours: {len(samples)} evolutions" if place == 0 else ""
        panel.plot(bests, place + shifts, ".", color=theme.ours, ms=4, label=label)
        for genome, mark, name in ((TYPE1, "D", "type 1"), (TYPE2, "s", "type 2")):
            _draw_paper_value(panel, genome, field, place, mark, name, theme)
    panel.set_yticks(range(len(_NAME_OF_PARAMETER)), list(_NAME_OF_PARAMETER.values()))
    panel.set_ylim(len(_NAME_OF_PARAMETER) - 0.4, -0.6)
    panel.set_xlim(-0.05, 1.05)
    panel.set_xlabel("value; 0 is false and 1 is true")
    _legend_above(panel, left=-0.6, columns=3)


def _draw_paper_value(
    panel: Axes, genome: Genome, field: str, place: int, mark: str, name: str, theme: Theme
) -> None:
    """Draw a value of one of the paper's types as an open mark."""
    label = f"paper: {name}" if place == 0 else ""
    style: Any = {"mfc": "none", "mec": theme.paper, "mew": 1.6, "ms": 7, "label": label}
    panel.plot(float(getattr(genome, field)), place, mark, **style)


FIGURES = (
    PaperFigure(
        "table-1",
        "Table 1: hardware and arena",
        ("sensitivity",),
        _draw_table_1,
        {"size": (4.6, 3.4)},
    ),
    PaperFigure(
        "table-2",
        "Table 2: what evolved",
        ("evolve-paper",),
        _draw_table_2,
        {"size": (4.6, 3.4)},
    ),
    PaperFigure(
        "fig-8", "Fig. 8: grasping at 10 % humidity", ("grasp",), _draw_grasps, {"size": _HALF}
    ),
    PaperFigure(
        "fig-9", "Fig. 9: grasping in moister air", ("grasp",), _draw_humidities, {"size": _HALF}
    ),
    PaperFigure(
        "fig-14",
        "Fig. 14: the evolution",
        ("evolve-paper",),
        _draw_evolution,
        {"rows": 2, "size": (4.6, 2.2)},
    ),
    PaperFigure(
        "fig-16",
        "Fig. 16: the two evolved types",
        ("types",),
        _draw_types,
        {"rows": 2, "columns": 2, "size": (2.3, 2.2)},
    ),
    PaperFigure(
        "fig-15",
        "Fig. 15: with and without hop counts",
        ("hop-count",),
        _draw_hop_counts,
        {"rows": 2, "columns": 2, "size": (2.3, 1.5)},
    ),
    PaperFigure(
        "fig-17",
        "Fig. 17: the best density",
        ("density",),
        _draw_densities,
        {"rows": 2, "columns": 2, "size": (2.3, 1.5)},
    ),
)
"""The paper's figures and tables that have results of ours, in the order of the page."""


def write_figures(results: Results, directory: Path) -> None:
    """Write the figures for which there are results into a directory, which is made for them."""
    for figure in FIGURES:
        if results.keys() >= set(figure.needs):
            directory.mkdir(exist_ok=True)
            figure.write(results, directory)
