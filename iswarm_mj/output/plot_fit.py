"""Figures of a fit: the data with predictive bands, and the profiles of the parameters."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from iswarm_mj.gripper.fitting.fit import Fit
from iswarm_mj.gripper.fitting.table import Measurements
from iswarm_mj.gripper.fitting.text import number, unit_of
from iswarm_mj.output.palette import BLUE, DARK, GREEN, ORANGE, PURPLE
from iswarm_mj.output.plot_style import figure

_UM = 1e-6
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE)
_N_PLACES = 7
"""Number of places along a band."""
_N_PROFILE = 21
"""Number of values along a profile."""
_LARGEST_RISE = 10.0
"""Largest rise of twice the logarithm of the likelihood that is drawn."""
_MOST_POINTS = 2000
"""Largest number of points that is drawn."""
_LABELS = {
    "grasp": "grasp voltage [V]",
    "release": "release voltage [V]",
    "no_contact": "voltage without contact [V]",
    "pull_off_tool": "pull-off from the tool [nN]",
    "pull_off_plate": "pull-off from the plate [nN]",
}
"""Kinds that are drawn: those which depend on radius and humidity."""


class _Group(NamedTuple):
    """Rows that share all but the quantity along the axis."""

    kind: str
    variable: str
    """Quantity along the axis: "radius" or "humidity"."""
    fixed: float
    """The other quantity: humidity [%] or radius [m]."""
    gap: float
    """Gap of the rows [m]."""
    rows: Measurements


def draw_data(fitted: Fit, path: Path) -> None:
    """Draw the measurements over radius and over humidity with the bands of the fit.

    The dark band is the 95 % interval of the median, the light one holds 95 % of the balls. Only
    the largest group of a panel has bands.

    Args:
        fitted: the fit.
        path: path of the files, without suffix.
    """
    kinds = [kind for kind in dict.fromkeys(fitted.measurements.kind.tolist()) if kind in _LABELS]
    if not kinds:
        return
    caption = (
        "Points: measurements, with ranges and bounds as lines and arrows. Line and dark band: "
        "median by the fitted laws and its 95 % interval.\nLight band: 95 % of single balls."
    )
    with figure(path, rows=len(kinds), columns=2, size=(4.2, 2.9), caption=caption) as axes:
        for index, kind in enumerate(kinds):
            for column, variable in enumerate(("radius", "humidity")):
                panel = axes[2 * index + column]
                groups = _groups(fitted.measurements, kind, variable)
                for place, group in enumerate(groups[: len(_COLOURS)]):
                    _draw_group(panel, fitted, group, _COLOURS[place], with_bands=place == 0)
                unit = "radius [µm]" if variable == "radius" else "relative humidity [%]"
                panel.set_xlabel(unit)
                panel.set_ylabel(_LABELS[kind])
                panel.legend(fontsize=7)


def _groups(rows: Measurements, kind: str, variable: str) -> list[_Group]:
    """Return the rows of a kind by the quantity that is not along the axis; largest groups first.

    Only the gap that most of the rows have is drawn.
    """
    other = "humidity" if variable == "radius" else "radius"
    of_kind = rows.chosen(rows.kind == kind)
    gaps, counts = np.unique(of_kind.gap, return_counts=True)
    gap = gaps[np.argmax(counts)].item()
    of_kind = of_kind.chosen(of_kind.gap == gap)
    values, counts = np.unique(getattr(of_kind, other), return_counts=True)
    groups = []
    for index in np.argsort(-counts, kind="stable"):
        chosen = of_kind.chosen(getattr(of_kind, other) == values[index])
        groups.append(_Group(kind, variable, values[index].item(), gap, chosen))
    return groups


def _draw_group(panel: Axes, fitted: Fit, group: _Group, colour: str, *, with_bands: bool) -> None:
    """Draw one group of rows and its median, and the bands."""
    along = getattr(group.rows, group.variable)
    is_radius = group.variable == "radius"
    axis_unit = _UM if is_radius else 1.0
    margin = 2e-6 if is_radius else 5.0
    lowest = max(along.min() - margin, 5e-6 if is_radius else 0.0)
    highest = min(along.max() + margin, 100.0 if not is_radius else 1e-4)
    places = np.linspace(lowest, highest, _N_PLACES)
    if not is_radius:
        places = np.union1d(places, [10.0]) if lowest < 10 < highest else places

    # Margins may exceed the range of the laws.
    radii = places if is_radius else np.full(len(places), group.fixed)
    places = places[[fitted.has_laws(group.kind, radius, group.gap) for radius in radii.tolist()]]

    predictions = []
    for place in places.tolist():
        radius, humidity = (place, group.fixed) if is_radius else (group.fixed, place)
        predictions.append(fitted.predict(group.kind, radius, humidity, group.gap))
    unit, _ = unit_of(group.kind)

    def curve(values: list[float]) -> np.ndarray:
        return np.array(values) / unit

    label = f"{group.fixed:g} % RH" if is_radius else f"{group.fixed / _UM:g} µm"
    x = places / axis_unit
    low = curve([entry.median.low for entry in predictions])
    high = curve([entry.median.high for entry in predictions])
    balls_low = curve([entry.balls_low for entry in predictions])
    balls_high = curve([entry.balls_high for entry in predictions])
    panel.plot(x, curve([p.median.value for p in predictions]), color=colour, label=label)
    if with_bands:
        panel.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0)
        panel.fill_between(x, balls_low, balls_high, color=colour, alpha=0.12, linewidth=0)

    rows = group.rows.chosen(slice(0, _MOST_POINTS))
    x_rows = getattr(rows, group.variable) / axis_unit
    known = rows.is_known
    panel.plot(x_rows[known], rows.high[known] / unit, "o", color=colour, markersize=4)
    has_both = ~known & np.isfinite(rows.high) & (rows.low > 0)
    panel.vlines(
        x_rows[has_both],
        rows.low[has_both] / unit,
        rows.high[has_both] / unit,
        color=colour,
        linewidth=2,
    )
    above = ~np.isfinite(rows.high)
    panel.plot(x_rows[above], rows.low[above] / unit, "^", color=colour, fillstyle="none")
    below = ~known & (rows.low == 0) & np.isfinite(rows.high)
    panel.plot(x_rows[below], rows.high[below] / unit, "v", color=colour, fillstyle="none")


def draw_profiles(fitted: Fit, path: Path) -> None:
    """Draw the profile of each parameter, with its interval and prior.

    Args:
        fitted: the fit.
        path: path of the files, without suffix.
    """
    maximum = fitted.maximum
    names = fitted.model.free
    columns = 2
    n_rows = -(-len(names) // columns)
    caption = (
        "Rise of twice the negative logarithm of likelihood times prior, all other parameters "
        "free. Dashed: limit of the 95 % interval.\nGrey: the prior alone."
    )
    with figure(path, rows=n_rows, columns=columns, size=(4.2, 2.4), caption=caption) as axes:
        for index, (panel, name) in enumerate(zip(axes, names, strict=False)):
            parameter = fitted.model.parameters[name]
            interval = fitted.estimates[name].interval
            middle = maximum.places[index]
            ends = [parameter.place_of(max(end, 1e-30)) for end in (interval.low, interval.high)]
            reach = 1.4 * np.clip([ends[0] - middle, ends[1] - middle], -4, 4)
            reach = np.where(np.isnan(reach), [-1.4 * 4, 1.4 * 4], reach)  # ends not found
            places = np.linspace(middle + reach[0], middle + reach[1], _N_PROFILE)
            rise = maximum.profile(name, places)
            values = np.array([parameter.value_at(place) for place in places]) / parameter.scale
            prior = places**2 - min(places**2)
            panel.plot(values, prior, color=DARK, alpha=0.35, linewidth=1)
            panel.plot(values, rise, color=BLUE)
            panel.axhline(maximum.cut, color=DARK, linestyle="--", linewidth=0.8)
            panel.set_ylim(0, _LARGEST_RISE)
            if interval.high > 4 * interval.low:
                panel.set_xscale("log")
                panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=7))
                panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                panel.xaxis.set_minor_formatter(NullFormatter())
            unit = f" [{parameter.unit}]" if parameter.unit else ""
            panel.set_xlabel(f"{parameter.text}{unit}", fontsize=8)
            best = number(interval.value / parameter.scale)
            panel.set_title(f"{parameter.symbol} = {best}", fontsize=8)
        for panel in axes[len(names) :]:
            panel.set_visible(False)
