"""Figures of the gripper's experiments: voltages that pick up balls and release them.

They follow the paper's Figs. 8, 9 and 11. Bands are the paper's; dashed lines follow from the force
laws without dynamics, at the medians of the works of adhesion.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from iswarm_mj.gripper.laws import detachment
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.detachment import RELEASE_GAP, grasp_voltage, release_voltage
from iswarm_mj.gripper.reference import (
    PAPER_GRASP,
    PAPER_HUMIDITY,
    PAPER_NO_CONTACT,
    PAPER_RELEASE,
)
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.output.palette import BLUE, GREEN, ORANGE, PURPLE, RED
from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.trial_shapes import UM
from iswarm_mj.utils.arrays import Quantity

Rows = Sequence[Mapping[str, Any]]
"""Rows of a table, as values by the names of columns."""

COLOURS = (BLUE, ORANGE, GREEN, PURPLE)
_MARKERS = ("o", "s", "^", "D")
_SIZE = (5.2, 4.2)
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


class Laws:
    """Least voltages without dynamics, at the medians of the works of adhesion. SI units."""

    def __init__(self, settings: Mapping[str, Any]):
        """Take the constants from a run's settings.

        Args:
            settings: settings of a run; `calibration` has constants of `detachment` by name, which
                replace those of the module, and `tip` is the file of a tip's table.
        """
        calibration = settings.get("calibration", {})

        def constant(name: str) -> float:
            return calibration.get(name, getattr(detachment, name))

        # Works of adhesion [J/m^2].
        self._work_tool = constant("WORK_TOOL_OBJECT")
        self._work_plate = constant("WORK_OBJECT_SUBSTRATE")
        self._contact_gap = constant("CONTACT_GAP")
        self._probe_radius = constant("PROBE_RADIUS")
        self._tip = settings.get("tip")

    def grasp_voltage_of(self, radius: Quantity, humidity: float, gap: Quantity = 0.0) -> Quantity:
        """Return the least voltage that picks up a ball [V].

        Args:
            radius: radius of the ball [m].
            humidity: relative humidity [%].
            gap: gap between tool and ball [m], across which the tool's adhesion does not help.
        """
        factor = humidity_factor(humidity)
        is_touching = np.asarray(gap) <= 0
        work_tool = np.where(is_touching, self._work_tool * factor, 0.0)
        work_plate = self._work_plate * factor
        effective_gap = np.maximum(gap, self._contact_gap)
        if self._tip is not None:
            tip = read_table(self._tip)

            def voltage_of(radius: float, work_tool: float, gap: float) -> float:
                work = work_tool * tip.adhesion_share(radius)
                return tip.grasp_voltage(radius, work, float(work_plate), gap)

            return np.vectorize(voltage_of)(radius, work_tool, effective_gap)
        return grasp_voltage(radius, work_tool, work_plate, effective_gap, self._probe_radius)

    def release_voltage_of(
        self, radius: Quantity, humidity: float, gap: Quantity = RELEASE_GAP
    ) -> Quantity:
        """Return the least voltage that makes the tool drop a ball [V].

        Args:
            radius: radius of the ball [m].
            humidity: relative humidity [%].
            gap: gap between ball and plate [m].
        """
        work_tool = self._work_tool * humidity_factor(humidity)
        if self._tip is not None:
            tip = read_table(self._tip)
            work = float(work_tool)

            def voltage_of(radius: float, gap: float) -> float:
                return tip.release_voltage(radius, work * tip.adhesion_share(radius), gap)

            return np.vectorize(voltage_of)(radius, gap)
        return release_voltage(radius, work_tool, gap, self._probe_radius)


def draw_figures(rows: Rows, settings: Mapping[str, Any], out: Path) -> None:
    """Draw grasp voltages, release voltages and attempts without contact, as far as there are rows.

    Args:
        rows: rows of the table of trials, SI units. Faulty ones are left out, and the figure says
            how many.
        settings: settings of the run; its `calibration` is behind the lines of the force laws, see
            `Laws`.
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
            _draw_voltages(out / name, rows_to_draw, laws)
    if attempts:
        _draw_attempts(out / "no_contact", attempts, laws)


def _of_experiment(rows: Rows, experiment: str) -> Rows:
    """Return the rows of one experiment."""
    return [row for row in rows if row["experiment"] == experiment]


def _draw_voltages(path: Path, rows: Rows, laws: Laws) -> None:
    """Draw the least voltages of grasps or of releases against the radius of the ball.

    Each humidity has a colour.

    Args:
        path: path of the files, without suffix.
        rows: at least one row, all of one experiment and gap.
        laws: force laws for the lines.
    """
    experiment = rows[0]["experiment"]
    is_grasp = experiment == "grasp"
    law = laws.grasp_voltage_of if is_grasp else laws.release_voltage_of
    humidities = sorted({row["relative_humidity"] for row in rows})
    valid = _without_faulty(rows)

    with figure(path, size=_SIZE) as (axes,):
        if PAPER_HUMIDITY in humidities:
            _draw_paper_band(axes, experiment, rows[0]["gap"])
        for number, humidity in enumerate(humidities):
            rows_at_humidity = [row for row in valid if row["relative_humidity"] == humidity]
            if rows_at_humidity:
                colour = COLOURS[number % len(COLOURS)]
                marker = _MARKERS[number % len(_MARKERS)]
                _draw_humidity(axes, rows_at_humidity, law, colour, marker)
        axes.set(xlabel="radius of the ball [µm]", ylabel=f"{experiment} voltage [V]")

        # Room above and below, but no negative voltages.
        low, high = axes.get_ylim()
        margin = 0.15 * (high - low)
        axes.set_ylim(max(0.0, low - margin), high + margin)

        _finish(axes, _title(rows, humidities), rows, _caption(rows, humidities))


def _draw_paper_band(axes: Axes, experiment: str, gap: float) -> None:
    """Draw the paper's band of voltages, if it measured the experiment at this gap [m]."""
    if experiment == "grasp":
        low, high = PAPER_GRASP
    elif gap == RELEASE_GAP:
        low, high = PAPER_RELEASE
    else:
        return
    label = f"paper, {PAPER_HUMIDITY:g} % RH: {low:g} to {high:g} V"
    axes.axhspan(low, high, color="0.5", alpha=0.18, lw=0, label=label)


def _title(rows: Rows, humidities: Sequence[float]) -> str:
    """Return the title of a figure of voltages."""
    experiment = rows[0]["experiment"]
    listed = ", ".join(f"{humidity:g}" for humidity in humidities)
    title = f"{experiment.capitalize()} voltage at {listed} % RH"
    if experiment == "release":
        title += f", gap {rows[0]['gap'] * UM:g} µm"
    return title


def _caption(rows: Rows, humidities: Sequence[float]) -> str:
    """Return the caption of a figure of voltages: what is fitted, and the number of trials."""
    experiment = rows[0]["experiment"]
    caption = _FITTED[experiment]
    if len(humidities) > 1:
        caption += "\nHumidity: the empirical factor on both works."

    n_trials = Counter((row["radius"], row["relative_humidity"]) for row in _without_faulty(rows))
    n_radii = len({radius for radius, _ in n_trials})
    if n_radii > 1:
        caption += " Not fitted: that the radius does not matter."
    fewest = min(n_trials.values(), default=0)
    most = max(n_trials.values(), default=0)
    span = f"{fewest}" if fewest == most else f"{fewest} to {most}"
    caption += f"\nn = {span} trials at each radius and humidity."
    if experiment == "release":
        caption += _landings(rows)
    return caption


def _draw_humidity(
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
    _draw_each_trial(axes, rows, colour, marker)
    _draw_means(axes, rows, f"{humidity:g} % RH, mean", colour, marker)

    # The law.
    radii = sorted({row["radius"] for row in rows})
    law_radii = radii[0] * np.array([0.98, 1.02])  # a short line for a single radius
    if len(radii) > 1:
        law_radii = np.linspace(radii[0], radii[-1], 61)
    law_voltages = law(law_radii, humidity, gap)
    label = "force laws, no dynamics"
    axes.plot(law_radii * UM, law_voltages, "--", color=colour, lw=1, label=label)


def _draw_each_trial(axes: Axes, rows: Rows, colour: str, marker: str) -> None:
    """Draw a point for each trial; arrows where no voltage did, crosses where the ball melted."""
    with_voltage, without_voltage = _split_by_voltage(rows)
    melted = [row for row in with_voltage if row["melted"]]
    _draw_points(
        axes,
        with_voltage,
        x="radius",
        y="voltage",
        marker=marker,
        mec=colour,
        alpha=0.6,
        ms=4,
        label="each trial",
    )
    _draw_points(
        axes,
        without_voltage,
        x="radius",
        y="limit_voltage",
        marker="$↑$",
        mec=colour,
        ms=8,
        label="not up to this voltage",
    )
    _draw_points(axes, melted, x="radius", y="voltage", marker="x", mec=RED, ms=7, label="melted")


def _draw_means(axes: Axes, rows: Rows, label: str, colour: str, marker: str) -> None:
    """Draw the mean voltage at each radius at which all trials have one."""
    voltages_by_radius: dict[float, list[Any]] = {}
    for row in sorted(rows, key=lambda row: row["radius"]):
        voltages_by_radius.setdefault(row["radius"], []).append(row["voltage"])
    means = [
        (radius * UM, np.mean(voltages))
        for radius, voltages in voltages_by_radius.items()
        if None not in voltages
    ]
    if means:
        x, y = zip(*means, strict=True)
        axes.plot(x, y, "-" + marker, color=colour, ms=6, lw=1.3, label=label)


def _draw_points(axes: Axes, rows: Rows, x: str, y: str, **style: Any) -> None:
    """Draw a hollow mark for each row, if there are any.

    Args:
        axes: axes to draw on.
        rows: rows of the table of trials.
        x: column along the abscissa [m].
        y: column along the ordinate.
        style: further arguments of `Axes.plot`.
    """
    if rows:
        axes.plot(
            column_array(rows, x) * UM,
            column_array(rows, y),
            ls="none",
            mfc="none",
            rasterized=len(rows) > _MAX_VECTOR_POINTS,
            **style,
        )


def _draw_attempts(path: Path, rows: Rows, laws: Laws) -> None:
    """Draw attempts to pick up a ball across a gap: the voltage that did, or up to which none did.

    Args:
        path: path of the files, without suffix.
        rows: at least one row.
        laws: force laws for the lines, which are each the least over the radii.
    """
    lifted, left = _split_by_voltage(_without_faulty(rows))
    with figure(path, size=_SIZE) as (axes,):
        label = f"paper: no lift below {PAPER_NO_CONTACT:g} V"
        axes.axhspan(0, PAPER_NO_CONTACT, color="0.5", alpha=0.18, lw=0, label=label)
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
        axes.set_ylim(0, 2 * max(PAPER_NO_CONTACT, *column_array(rows, "limit_voltage")))
        _finish(axes, "Attempts without contact", rows, _FITTED["no_contact"])


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
