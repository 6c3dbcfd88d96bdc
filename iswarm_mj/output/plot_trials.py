"""Figures of the gripper's experiments: voltages that pick up balls and release them.

They follow the paper's Figs. 8, 9 and 11. Bands are the paper's, in runs with its materials and tip;
dashed lines follow from the force laws without dynamics, at the medians of the works of adhesion.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from iswarm_mj.gripper.laws.detachment import RELEASE_GAP
from iswarm_mj.gripper.reference import (
    PAPER_GRASP,
    PAPER_HUMIDITY,
    PAPER_NO_CONTACT,
    PAPER_RELEASE,
)
from iswarm_mj.output.palette import BLUE, GREEN, ORANGE, PURPLE, RED
from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.trial_laws import Laws, described_parameters
from iswarm_mj.output.trial_shapes import UM
from iswarm_mj.utils.arrays import Quantity

Rows = Sequence[Mapping[str, Any]]
"""Rows of a table, as values by the names of columns."""

COLOURS = (BLUE, ORANGE, GREEN, PURPLE)
_MARKERS = ("o", "s", "^", "D")
_SIZE = (5.2, 4.2)
_LAW_LABEL = "force laws, no dynamics"
_PAPER_HUMIDITIES = (PAPER_HUMIDITY - 3.0, PAPER_HUMIDITY + 3.0)
"""Humidities of the paper's bands of voltages, by the accuracy of its chamber [%]."""
_MS = 1e3
"""Milliseconds per second."""
_MAX_VECTOR_POINTS = 2000
"""Number of points above which they are rasterized in the SVG file."""
_FITTED_GRASP = """\
Fitted: W_TO to the paper's release band, W_OS to its grasp band at 10 % RH given D_eff,
their spreads to the widths of the bands."""
_FITTED_RELEASE = """\
Fitted: W_TO and its spread, to the paper's release band at 10 % RH.
Not fitted: that a landed ball stays."""
_FITTED_GAP = f"Fitted: D_eff, such that no ball is lifted below {PAPER_NO_CONTACT:g} V"
_FITTED = {
    "grasp": _FITTED_GRASP,
    "release": _FITTED_RELEASE,
    "no_contact": f"{_FITTED_GAP} from gaps of 1 µm and more.",
}
"""Data to which the constants behind the figure of each experiment are fitted."""


def draw_figures(rows: Rows, settings: Mapping[str, Any], out: Path) -> None:
    """Draw grasp voltages, release voltages and attempts without contact, as far as there are rows.

    Args:
        rows: rows of the table of trials, SI units. Faulty ones are left out, and the figure says
            how many.
        settings: settings of the run, behind the lines of the force laws and in the captions, see
            `Laws` and `described_parameters`.
        out: directory of the PNG and SVG files.
    """
    laws = Laws(settings)
    grasps = _of_experiment(rows, "grasp")
    releases = _of_experiment(rows, "release")
    attempts = _of_experiment(rows, "no_contact")

    # One figure for the paper's humidity, one for all, and one for each gap of a release.
    paper_grasps = [row for row in grasps if row["relative_humidity"] == PAPER_HUMIDITY]
    rows_of_figure: dict[str, Rows] = {"grasp_voltage": paper_grasps}
    if len(grasps) > len(paper_grasps):
        rows_of_figure["grasp_voltage_humidity"] = grasps
    for gap in sorted({row["gap"] for row in releases}):
        suffix = "" if gap == RELEASE_GAP else f"_{gap * UM:g}um"
        rows_of_gap = [row for row in releases if row["gap"] == gap]
        rows_of_figure[f"release_voltage{suffix}"] = rows_of_gap

    for name, rows_to_draw in rows_of_figure.items():
        if rows_to_draw:
            origin = _origin(rows_to_draw[0]["experiment"], settings, laws)
            _draw_voltages(out / name, rows_to_draw, laws, origin)
    if attempts:
        _draw_attempts(out / "no_contact", attempts, laws, _origin("no_contact", settings, laws))


def _origin(experiment: str, settings: Mapping[str, Any], laws: Laws) -> str:
    """Return the beginning of a caption: to which data the run is fitted, or its parameters."""
    if laws.is_of_paper and not settings.get("beyond_the_fit"):
        return _FITTED[experiment]
    return described_parameters(settings)


def _of_experiment(rows: Rows, experiment: str) -> Rows:
    """Return the rows of one experiment."""
    return [row for row in rows if row["experiment"] == experiment]


def _draw_voltages(path: Path, rows: Rows, laws: Laws, origin: str) -> None:
    """Draw the least voltages of grasps or of releases against the radius of the ball.

    Each humidity has a colour. Balls of one radius at several humidities are drawn against the
    humidity instead.

    Args:
        path: path of the files, without suffix.
        rows: at least one row, all of one experiment and gap.
        laws: force laws for the lines.
        origin: beginning of the caption.
    """
    experiment = rows[0]["experiment"]
    is_grasp = experiment == "grasp"
    law = laws.grasp_voltage_of if is_grasp else laws.release_voltage_of
    humidities = sorted({row["relative_humidity"] for row in rows})
    valid = _without_faulty(rows)

    radii = sorted({row["radius"] for row in rows})
    is_over_humidity = len(radii) == 1 and len(humidities) > 1
    has_band = PAPER_HUMIDITY in humidities and laws.is_of_paper

    with figure(path, size=_SIZE) as (axes,):
        if is_over_humidity:
            if has_band:
                _draw_paper_band(axes, experiment, rows[0]["gap"], _PAPER_HUMIDITIES)
            _draw_over_humidity(axes, valid, law)
            axes.set_xlabel("relative humidity [%]")
        else:
            if has_band:
                _draw_paper_band(axes, experiment, rows[0]["gap"])
            for number, humidity in enumerate(humidities):
                rows_at_humidity = [row for row in valid if row["relative_humidity"] == humidity]
                if rows_at_humidity:
                    colour = COLOURS[number % len(COLOURS)]
                    marker = _MARKERS[number % len(_MARKERS)]
                    _draw_over_radius(axes, rows_at_humidity, law, colour, marker)
            axes.set_xlabel("radius of the ball [µm]")
            if len(radii) == 1:
                middle = radii[0] * UM
                axes.set(xlim=(middle - 1, middle + 1), xticks=[middle])
        axes.set_ylabel(f"{experiment} voltage [V]")

        # Room above and below, but no negative voltages.
        low, high = axes.get_ylim()
        margin = 0.15 * (high - low)
        axes.set_ylim(max(0.0, low - margin), high + margin)

        caption = _caption(rows, humidities, origin)
        title = _title(rows, humidities)
        if is_over_humidity:
            title += f", radius {radii[0] * UM:g} µm"
        _finish(axes, title, rows, caption)


def _draw_paper_band(
    axes: Axes,
    experiment: str,
    gap: float,
    humidities: tuple[float, float] | None = None,
) -> None:
    """Draw the paper's band of voltages, if it measured the experiment at this gap.

    Args:
        axes: axes to draw on.
        experiment: "grasp" or "release".
        gap: gap of the release [m].
        humidities: range of humidities over which the band goes [%]; the whole width of the axes
            by default.
    """
    if experiment == "grasp":
        low, high = PAPER_GRASP
    elif gap == RELEASE_GAP:
        low, high = PAPER_RELEASE
    else:
        return
    label = f"paper, {PAPER_HUMIDITY:g} % RH: {low:g} to {high:g} V"
    style: Any = {"color": "0.5", "alpha": 0.18, "lw": 0, "label": label}
    if humidities is None:
        axes.axhspan(low, high, **style)
    else:
        axes.fill_between(humidities, low, high, **style)


def _title(rows: Rows, humidities: Sequence[float]) -> str:
    """Return the title of a figure of voltages."""
    experiment = rows[0]["experiment"]
    listed = ", ".join(f"{humidity:g}" for humidity in humidities)
    title = f"{experiment.capitalize()} voltage at {listed} % RH"
    if experiment == "release":
        title += f", gap {rows[0]['gap'] * UM:g} µm"
    return title


def _caption(rows: Rows, humidities: Sequence[float], origin: str) -> str:
    """Return the caption of a figure of voltages: its beginning, and the number of trials."""
    experiment = rows[0]["experiment"]
    caption = origin
    if len(humidities) > 1:
        caption += "\nHumidity: the empirical factor on both works."

    n_trials = Counter((row["radius"], row["relative_humidity"]) for row in _without_faulty(rows))
    n_radii = len({radius for radius, _ in n_trials})
    if n_radii > 1 and origin in _FITTED.values():
        caption += " Not fitted: that the radius does not matter."
    fewest = min(n_trials.values(), default=0)
    most = max(n_trials.values(), default=0)
    span = f"{fewest}" if fewest == most else f"{fewest} to {most}"
    caption += f"\nn = {span} trials at each radius and humidity."
    if experiment == "release":
        caption += _landings(rows)
    return caption


def _draw_over_radius(
    axes: Axes, rows: Rows, law: Callable[..., Quantity], colour: str, marker: str
) -> None:
    """Draw the trials at one humidity, their means where all have a voltage, and the law.

    Args:
        axes: axes to draw on.
        rows: at least one row, all of one humidity and gap.
        law: law of the experiment, a method of `Laws`.
        colour: colour of the humidity.
        marker: marker of the humidity.
    """
    humidity = rows[0]["relative_humidity"]
    gap = rows[0]["gap"]
    _draw_each_trial(axes, rows, "radius", UM, colour, marker)
    _draw_means(axes, rows, "radius", UM, f"{humidity:g} % RH, mean", colour, marker)

    # The law.
    radii = sorted({row["radius"] for row in rows})
    law_radii = radii[0] * np.array([0.98, 1.02])  # a short line for a single radius
    if len(radii) > 1:
        law_radii = np.linspace(radii[0], radii[-1], 61)
    law_voltages = law(law_radii, humidity, gap)
    axes.plot(law_radii * UM, law_voltages, "--", color=colour, lw=1, label=_LAW_LABEL)


def _draw_over_humidity(axes: Axes, rows: Rows, law: Callable[..., Quantity]) -> None:
    """Draw the trials of one radius at their own humidities, their means, and the law.

    Args:
        axes: axes to draw on.
        rows: rows of one radius and gap.
        law: law of the experiment, a method of `Laws`.
    """
    if not rows:
        return
    colour = COLOURS[0]
    marker = _MARKERS[0]
    _draw_each_trial(axes, rows, "trial_humidity", 1.0, colour, marker)
    _draw_means(axes, rows, "relative_humidity", 1.0, "mean", colour, marker)

    trial_humidities = column_array(rows, "trial_humidity")
    humidities = np.linspace(trial_humidities.min(), trial_humidities.max(), 61)
    law_voltages = law(rows[0]["radius"], humidities, rows[0]["gap"])
    axes.plot(humidities, law_voltages, "--", color=colour, lw=1, label=_LAW_LABEL)


def _draw_each_trial(
    axes: Axes, rows: Rows, x: str, scale: float, colour: str, marker: str
) -> None:
    """Draw a point for each trial; arrows where no voltage did, crosses where the ball melted.

    Args:
        axes: axes to draw on.
        rows: rows of the table of trials.
        x: column along the abscissa.
        scale: factor of that column.
        colour: colour of points and arrows.
        marker: marker of the points.
    """
    with_voltage, without_voltage = _split_by_voltage(rows)
    melted = [row for row in with_voltage if row["melted"]]
    own_style = {"marker": marker, "mec": colour, "alpha": 0.6, "ms": 4, "label": "each trial"}
    _draw_points(axes, with_voltage, x, "voltage", scale, **own_style)
    limit_style = {"marker": "$↑$", "mec": colour, "ms": 8, "label": "not up to this voltage"}
    _draw_points(axes, without_voltage, x, "limit_voltage", scale, **limit_style)
    _draw_points(axes, melted, x, "voltage", scale, marker="x", mec=RED, ms=7, label="melted")


def _draw_means(
    axes: Axes, rows: Rows, x: str, scale: float, label: str, colour: str, marker: str
) -> None:
    """Draw the mean voltage at each place on the abscissa at which all trials have one."""
    voltages_by_place: dict[float, list[Any]] = {}
    for row in sorted(rows, key=itemgetter(x)):
        voltages_by_place.setdefault(row[x], []).append(row["voltage"])
    means = [
        (place * scale, np.mean(voltages))
        for place, voltages in voltages_by_place.items()
        if None not in voltages
    ]
    if means:
        places, voltages = zip(*means, strict=True)
        axes.plot(places, voltages, "-" + marker, color=colour, ms=6, lw=1.3, label=label)


def _draw_points(axes: Axes, rows: Rows, x: str, y: str, scale: float = UM, **style: Any) -> None:
    """Draw a hollow mark for each row, if there are any.

    Args:
        axes: axes to draw on.
        rows: rows of the table of trials.
        x: column along the abscissa.
        y: column along the ordinate.
        scale: factor of the column along the abscissa.
        style: further arguments of `Axes.plot`.
    """
    if rows:
        axes.plot(
            column_array(rows, x) * scale,
            column_array(rows, y),
            ls="none",
            mfc="none",
            rasterized=len(rows) > _MAX_VECTOR_POINTS,
            **style,
        )


def _draw_attempts(path: Path, rows: Rows, laws: Laws, origin: str) -> None:
    """Draw attempts to pick up a ball across a gap: the voltage that did, or up to which none did.

    Args:
        path: path of the files, without suffix.
        rows: at least one row.
        laws: force laws for the lines, which are each the least over the radii.
        origin: beginning of the caption.
    """
    highest = max(column_array(rows, "limit_voltage"))
    lifted, left = _split_by_voltage(_without_faulty(rows))
    with figure(path, size=_SIZE) as (axes,):
        if laws.is_of_paper:
            label = f"paper: no lift below {PAPER_NO_CONTACT:g} V"
            axes.axhspan(0, PAPER_NO_CONTACT, color="0.5", alpha=0.18, lw=0, label=label)
            highest = max(highest, PAPER_NO_CONTACT)
        _draw_points(
            axes,
            left,
            x="gap",
            y="limit_voltage",
            marker="^",
            mec=COLOURS[0],
            label=f"not lifted up to here ({len(left)})",
        )
        _draw_points(
            axes,
            lifted,
            x="gap",
            y="voltage",
            marker="o",
            mec=COLOURS[1],
            label=f"lifted ({len(lifted)})",
        )
        _draw_least_voltages(axes, rows, laws)
        axes.set(xlabel="gap between tool and ball at the start [µm]", ylabel="voltage [V]")
        axes.set_ylim(0, 2 * highest)
        _finish(axes, "Attempts without contact", rows, origin)


def _draw_least_voltages(axes: Axes, rows: Rows, laws: Laws) -> None:
    """Draw for each humidity the least voltage over the radii of the rows, against the gap."""
    measured_gaps = column_array(rows, "gap")
    measured_radii = column_array(rows, "radius")
    gaps = np.linspace(0.5 * measured_gaps.min(), 1.2 * measured_gaps.max(), 101)
    radii = np.linspace(measured_radii.min(), measured_radii.max(), 11)

    humidities = sorted({row["relative_humidity"] for row in rows})
    for number, humidity in enumerate(humidities):
        voltages = laws.grasp_voltage_of(radii[:, None], humidity, gaps)
        least_voltages = voltages.min(axis=0)
        colour = COLOURS[number % len(COLOURS)]
        label = f"force laws, {humidity:g} % RH"
        axes.plot(gaps * UM, least_voltages, "--", color=colour, lw=1, label=label)


def column_array(rows: Rows, name: str) -> np.ndarray:
    """Return the numbers of one column (n,)."""
    return np.array([row[name] for row in rows], float)


def _without_faulty(rows: Rows) -> Rows:
    """Return the rows of trials without a fault."""
    return [row for row in rows if not row["faulty"]]


def _split_by_voltage(rows: Rows) -> tuple[Rows, Rows]:
    """Return the rows with a voltage, and those without."""
    with_voltage = [row for row in rows if row["voltage"] is not None]
    without_voltage = [row for row in rows if row["voltage"] is None]
    return with_voltage, without_voltage


def _landings(rows: Rows) -> str:
    """Describe flight and landing of the released balls; empty if none was released."""
    released, _ = _split_by_voltage(_without_faulty(rows))
    if not released:
        return ""
    landed = [row for row in released if row["landed"]]
    text = f"\n{len(landed)} of {len(released)} released balls landed"
    if landed:
        flight_time = np.median(column_array(landed, "flight_time"))
        speed = np.median(column_array(landed, "landing_speed"))
        text += f"; medians: flight {flight_time * _MS:.2f} ms, landing at {speed:.2f} m/s"
    return text + "."


def _finish(axes: Axes, title: str, rows: Rows, caption: str) -> None:
    """Add the title and, below the axes, the caption and the legend."""
    n_faulty = len(rows) - len(_without_faulty(rows))
    if n_faulty:
        caption += f"\n{n_faulty} faulty trials are left out."
    axes.set_title(title)

    # Each label once, with the first of its handles.
    handle_of: dict[str, Any] = {}
    for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
        handle_of.setdefault(label, handle)
    axes.legend(
        list(handle_of.values()),
        list(handle_of),
        loc="upper left",
        bbox_to_anchor=(-0.12, -0.16),
        ncols=3,
        columnspacing=1.2,
        title=caption,
        alignment="left",
        fontsize=7,
        title_fontsize=7,
    )
