"""Figures of the gripper's experiments: the voltages that lift balls and let them go (the paper's Figs. 8, 9 and 11).

Bands are the paper's; dashed lines follow from the force laws without dynamics, at the medians of the works of
adhesion.
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
from iswarm_mj.gripper.reference import PAPER_GRASP, PAPER_HUMIDITY, PAPER_NO_CONTACT, PAPER_RELEASE
from iswarm_mj.output.palette import BLUE, GREEN, ORANGE, PURPLE, RED
from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.trial_shapes import UM
from iswarm_mj.utils.arrays import Quantity

Rows = Sequence[Mapping[str, Any]]

HUES = (BLUE, ORANGE, GREEN, PURPLE)
_MARKS = ("o", "s", "^", "D")
_SIZE = (5.2, 4.2)
_MS = 1e3
_MANY = 2000
"""Number of points above which they are rasterized in the SVG file."""
_FITTED = {
    "grasp": (
        "Fitted: W_TO to the paper's release band, W_OS to its grasp band at 10 % RH given D_eff,\n"
        "their spreads to the widths of the bands."
    ),
    "release": (
        "Fitted: W_TO and its spread, to the paper's release band at 10 % RH.\nNot fitted: that a landed ball stays."
    ),
    "no_contact": (
        f"Fitted: D_eff, such that no ball is lifted below {PAPER_NO_CONTACT:g} V from gaps of 1 µm and more."
    ),
}


class Laws:
    """Least voltages without dynamics, at the medians of the works of adhesion. SI."""

    def __init__(self, settings: Mapping[str, Any]):
        """Take the constants of the `calibration` in a run's settings; those of `detachment` where it has none."""
        names = ("WORK_TOOL_OBJECT", "WORK_OBJECT_SUBSTRATE", "CONTACT_GAP", "PROBE_RADIUS")
        own = settings.get("calibration", {})
        self._tool, self._plate, self._gap, self._probe = (own.get(n, getattr(detachment, n)) for n in names)

    def grasp(self, radius: Quantity, percent: float, gap: Quantity = 0.0) -> Quantity:
        """Least voltage that lifts a ball at a humidity [%]; across a gap the tool's adhesion does not help."""
        factor = humidity_factor(percent)
        adhesion = np.where(np.asarray(gap) <= 0, self._tool * factor, 0.0)
        return grasp_voltage(radius, adhesion, self._plate * factor, np.maximum(gap, self._gap), self._probe)

    def release(self, radius: Quantity, percent: float, gap: Quantity = RELEASE_GAP) -> Quantity:
        """Least voltage that drops a held ball at a humidity [%]."""
        return release_voltage(radius, self._tool * humidity_factor(percent), gap, self._probe)


def draw_figures(rows: Rows, settings: Mapping[str, Any], out: Path) -> None:
    """Draw what the rows have, as PNG and SVG: grasp voltages, release voltages, attempts without contact.

    Args:
        rows: of the table of trials, SI. Those that are faulty are left out, and the figure says how many.
        settings: of the run; its `calibration`, constants of `detachment` by their names, is behind the lines of the
            force laws. Absent ones are those of `detachment` itself.
        out: directory.
    """
    laws = Laws(settings)
    grasp, release, attempts = (
        [row for row in rows if row["experiment"] == name] for name in ("grasp", "release", "no_contact")
    )
    at_10 = [row for row in grasp if row["relative_humidity"] == PAPER_HUMIDITY]
    groups = {"grasp_voltage": at_10, "grasp_voltage_humidity": grasp if len(grasp) > len(at_10) else []}
    for gap in sorted({row["gap"] for row in release}):
        name = "release_voltage" if gap == RELEASE_GAP else f"release_voltage_{gap * UM:g}um"
        groups[name] = [row for row in release if row["gap"] == gap]
    for name, group in groups.items():
        if group:
            _draw_voltages(out / name, group, laws)
    if attempts:
        _draw_attempts(out / "no_contact", attempts, laws)


def _draw_voltages(path: Path, rows: Rows, laws: Laws) -> None:
    """Draw the least voltages of grasp or of release trials against the radius, a colour for each humidity.

    Args:
        path: of the files, without suffix.
        rows: at least one, of one experiment and gap.
        laws: for the lines.
    """
    name, gap = rows[0]["experiment"], rows[0]["gap"]
    law, band = (laws.grasp, PAPER_GRASP) if name == "grasp" else (laws.release, PAPER_RELEASE)
    humidities = sorted({row["relative_humidity"] for row in rows})
    with figure(path, size=_SIZE) as (axes,):
        if PAPER_HUMIDITY in humidities and (name == "grasp" or gap == RELEASE_GAP):
            label = f"paper, {PAPER_HUMIDITY:g} % RH: {band[0]:g} to {band[1]:g} V"
            axes.axhspan(*band, color="0.5", alpha=0.18, lw=0, label=label)
        for i, percent in enumerate(humidities):
            group = [row for row in _sound(rows) if row["relative_humidity"] == percent]
            if group:
                _draw_group(axes, group, law, HUES[i % len(HUES)], _MARKS[i % len(_MARKS)])
        axes.set(xlabel="radius of the ball [µm]", ylabel=f"{name} voltage [V]")
        low, high = axes.get_ylim()
        axes.set_ylim(max(0.0, low - 0.15 * (high - low)), high + 0.15 * (high - low))
        title = f"{name.capitalize()} voltage at {', '.join(f'{percent:g}' for percent in humidities)} % RH"
        title += f", gap {gap * UM:g} µm" if name == "release" else ""
        caption = _FITTED[name] + ("\nHumidity: the empirical factor on both works." if len(humidities) > 1 else "")
        counts = Counter((row["radius"], row["relative_humidity"]) for row in _sound(rows))
        caption += " Not fitted: that the radius does not matter." * (len({radius for radius, _ in counts}) > 1)
        least, most = min(counts.values(), default=0), max(counts.values(), default=0)
        span = " to ".join(map(str, sorted({least, most})))
        caption += f"\nn = {span} trials at each radius and humidity; test statistics: findings.csv."
        _finish(axes, title, rows, caption + (_landings(rows) if name == "release" else ""))


def _draw_group(axes: Axes, rows: Rows, law: Callable[..., Quantity], hue: str, mark: str) -> None:
    """Draw the repeats, their mean where each has a voltage, and the law, for one humidity."""
    percent, by_radius = rows[0]["relative_humidity"], {}
    for row in sorted(rows, key=lambda row: row["radius"]):
        by_radius.setdefault(row["radius"], []).append(row["voltage"])
    done, undone = _split(rows)
    melted = [row for row in done if row["melted"]]
    _points(axes, done, "radius", "voltage", marker=mark, mec=hue, alpha=0.6, ms=4, label="each trial")
    _points(axes, undone, "radius", "limit_voltage", marker="$↑$", mec=hue, ms=8, label="not up to this voltage")
    _points(axes, melted, "radius", "voltage", marker="x", mec=RED, ms=7, label="melted")
    means = [(radius * UM, np.mean(values)) for radius, values in by_radius.items() if None not in values]
    if means:
        axes.plot(*zip(*means, strict=True), "-" + mark, color=hue, ms=6, lw=1.3, label=f"{percent:g} % RH, mean")
    radii = list(by_radius)
    x = np.linspace(radii[0], radii[-1], 61) if len(radii) > 1 else radii[0] * np.array([0.98, 1.02])
    axes.plot(x * UM, law(x, percent, rows[0]["gap"]), "--", color=hue, lw=1, label="force laws, no dynamics")


def _points(axes: Axes, rows: Rows, x: str, y: str, **style: Any) -> None:
    """Draw a hollow mark for each row, if there are any."""
    if rows:
        many = len(rows) > _MANY
        axes.plot(column(rows, x) * UM, column(rows, y), ls="none", mfc="none", rasterized=many, **style)


def _draw_attempts(path: Path, rows: Rows, laws: Laws) -> None:
    """Draw attempts to lift a ball across a gap: where it was lifted, or up to which voltage it was not.

    Args:
        path: of the files, without suffix.
        rows: at least one.
        laws: for the lines, each the least over the radii.
    """
    with figure(path, size=_SIZE) as (axes,):
        label = f"paper: no lift below {PAPER_NO_CONTACT:g} V"
        axes.axhspan(0, PAPER_NO_CONTACT, color="0.5", alpha=0.18, lw=0, label=label)
        lifted, left = _split(_sound(rows))
        label = f"not lifted up to here ({len(left)})"
        _points(axes, left, "gap", "limit_voltage", marker="^", mec=HUES[0], label=label)
        _points(axes, lifted, "gap", "voltage", marker="o", mec=HUES[1], label=f"lifted ({len(lifted)})")
        gaps, radii = column(rows, "gap"), column(rows, "radius")
        x, radius = np.linspace(0.5 * gaps.min(), 1.2 * gaps.max(), 101), np.linspace(radii.min(), radii.max(), 11)
        for i, percent in enumerate(sorted({row["relative_humidity"] for row in rows})):
            least = laws.grasp(radius[:, None], percent, x).min(axis=0)
            axes.plot(x * UM, least, "--", color=HUES[i % len(HUES)], lw=1, label=f"force laws, {percent:g} % RH")
        axes.set(xlabel="gap between tool and ball at the start [µm]", ylabel="voltage [V]")
        axes.set_ylim(0, 2 * max(PAPER_NO_CONTACT, *column(rows, "limit_voltage")))
        _finish(axes, "Attempts without contact", rows, _FITTED["no_contact"])


def column(rows: Rows, name: str) -> np.ndarray:
    """Numbers of one column (n,)."""
    return np.array([row[name] for row in rows], float)


def _sound(rows: Rows) -> Rows:
    return [row for row in rows if not row["faulty"]]


def _split(rows: Rows) -> tuple[Rows, Rows]:
    """Rows with a voltage, and those without."""
    return [row for row in rows if row["voltage"] is not None], [row for row in rows if row["voltage"] is None]


def _landings(rows: Rows) -> str:
    """Describe flight and landing of the released balls; empty if none was released."""
    let_go, _ = _split(_sound(rows))
    landed = [row for row in let_go if row["landed"]]
    if not let_go:
        return ""
    text = f"\n{len(landed)} of {len(let_go)} released balls landed"
    if landed:
        time, speed = np.median(column(landed, "flight_time")), np.median(column(landed, "landing_speed"))
        text += f"; medians: flight {time * _MS:.2f} ms, landing at {speed:.2f} m/s"
    return text + "."


def _finish(axes: Axes, title: str, rows: Rows, caption: str) -> None:
    """Add the title and, below the axes, the caption and the legend."""
    faulty = len(rows) - len(_sound(rows))
    axes.set_title(title)
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(
        [handles[labels.index(label)] for label in dict.fromkeys(labels)],
        [*dict.fromkeys(labels)],
        loc="upper left",
        bbox_to_anchor=(-0.12, -0.16),
        ncols=3,
        columnspacing=1.2,
        title=caption + (f"\n{faulty} faulty trials are left out." if faulty else ""),
        alignment="left",
        fontsize=7,
        title_fontsize=7,
    )
