"""Figures of a fit: the data with predictive bands, and the profiles of the parameters."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
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
_FARTHEST_END = 4.0
"""Largest distance of an interval's end from the estimate up to which a profile follows it."""
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

    The filled band is the 95 % interval of the median. Between the dashed lines are 95 % of the
    balls if the estimates are exact, so that either may be the wider one. Only the largest group of
    a panel has them.

    Args:
        fitted: the fit.
        path: path of the files, without suffix.
    """
    kinds = [kind for kind in dict.fromkeys(fitted.measurements.kind.tolist()) if kind in _LABELS]
    if not kinds:
        return
    caption = (
        "Points: measurements, with ranges and bounds as lines and arrows. Line and band: median by "
        "the fitted laws and its 95 % interval.\nDashed: 95 % of single balls if the estimates are "
        "exact; the band is wider where the table says little of the median."
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
    _draw_predictions(panel, fitted, group, colour, with_bands=with_bands)
    _draw_measurements(panel, group, colour)


def _draw_predictions(
    panel: Axes, fitted: Fit, group: _Group, colour: str, *, with_bands: bool
) -> None:
    """Draw the median over the range of a group, and the bands."""
    is_radius = group.variable == "radius"
    places = _places_of(fitted, group)

    predictions = []
    for place in places.tolist():
        radius, humidity = (place, group.fixed) if is_radius else (group.fixed, place)
        predictions.append(fitted.predict(group.kind, radius, humidity, group.gap))

    unit, _ = unit_of(group.kind)
    x = places / _axis_unit(group)
    median = np.array([prediction.median.value for prediction in predictions]) / unit
    label = f"{group.fixed:g} % RH" if is_radius else f"{group.fixed / _UM:g} µm"
    panel.plot(x, median, color=colour, label=label)
    if not with_bands:
        return

    median_low = np.array([prediction.median.low for prediction in predictions]) / unit
    median_high = np.array([prediction.median.high for prediction in predictions]) / unit
    band = panel.fill_between(x, median_low, median_high, color=colour, alpha=0.25, linewidth=0)
    balls_low = np.array([prediction.balls_low for prediction in predictions]) / unit
    balls_high = np.array([prediction.balls_high for prediction in predictions]) / unit
    (edge,) = panel.plot(x, balls_low, "--", color=colour, linewidth=1)
    panel.plot(x, balls_high, "--", color=colour, linewidth=1)

    # One legend a row of panels, since those over the radius have no room for it.
    if not is_radius:
        band.set_label("95 % interval of the median")
        edge.set_label("95 % of balls")


def _axis_unit(group: _Group) -> float:
    """Return the unit of the horizontal axis of a group: of radii [m], or 1 for humidities [%]."""
    return _UM if group.variable == "radius" else 1.0


def _places_of(fitted: Fit, group: _Group) -> np.ndarray:
    """Return radii [m] or humidities [%] at which predictions are drawn, beyond the rows' ends."""
    measured = getattr(group.rows, group.variable)
    if group.variable == "radius":
        lowest = max(measured.min() - 2e-6, 5e-6)
        highest = min(measured.max() + 2e-6, 1e-4)
        places = np.linspace(lowest, highest, _N_PLACES)
        radii = places
    else:
        lowest = max(measured.min() - 5.0, 0.0)
        highest = min(measured.max() + 5.0, 100.0)
        places = np.linspace(lowest, highest, _N_PLACES)
        if lowest < 10 < highest:
            places = np.union1d(places, [10.0])  # where the humidity's law has an edge
        radii = np.full(len(places), group.fixed)

    # Margins may exceed the range of the laws.
    return places[[fitted.has_laws(group.kind, radius, group.gap) for radius in radii.tolist()]]


def _draw_measurements(panel: Axes, group: _Group, colour: str) -> None:
    """Draw the rows of a group: values as points, ranges as lines, bounds as arrows."""
    unit, _ = unit_of(group.kind)
    rows = group.rows.chosen(slice(0, _MOST_POINTS))
    x = getattr(rows, group.variable) / _axis_unit(group)
    low = rows.low / unit
    high = rows.high / unit

    is_value = rows.is_known
    has_high = np.isfinite(high)
    is_range = ~is_value & has_high & (low > 0)
    is_below = ~is_value & has_high & (low == 0)
    is_above = ~has_high

    panel.plot(x[is_value], high[is_value], "o", color=colour, markersize=4)
    panel.vlines(x[is_range], low[is_range], high[is_range], color=colour, linewidth=2)
    panel.plot(x[is_above], low[is_above], "^", color=colour, fillstyle="none")
    panel.plot(x[is_below], high[is_below], "v", color=colour, fillstyle="none")


def draw_profiles(fitted: Fit, path: Path) -> None:
    """Draw the profile of each parameter, with its interval and prior.

    Args:
        fitted: the fit.
        path: path of the files, without suffix.
    """
    names = fitted.model.free
    columns = 2
    n_rows = -(-len(names) // columns)
    caption = (
        "Rise of twice the negative logarithm of likelihood times prior, all other parameters "
        "free. Dashed: limit of the 95 % interval.\nGrey: the prior alone."
    )
    with figure(path, rows=n_rows, columns=columns, size=(4.2, 2.4), caption=caption) as axes:
        for panel, name in zip(axes, names, strict=False):
            _draw_profile(panel, fitted, name)
        for panel in axes[len(names) :]:
            panel.set_visible(False)


def _places_of_profile(fitted: Fit, name: str) -> Float[np.ndarray, "K"]:
    """Return places of a parameter, evenly spaced beyond both ends of its interval.

    An end that was not found, or is far away, counts as `_FARTHEST_END`.
    """
    parameter = fitted.model.parameters[name]
    interval = fitted.estimates[name].interval
    middle = fitted.maximum.places[fitted.model.free.index(name)]
    low, high = (parameter.place_of(max(end, 1e-30)) for end in (interval.low, interval.high))

    below = -_FARTHEST_END if np.isnan(low) else max(low - middle, -_FARTHEST_END)
    above = _FARTHEST_END if np.isnan(high) else min(high - middle, _FARTHEST_END)
    return np.linspace(middle + 1.4 * below, middle + 1.4 * above, _N_PROFILE)


def _draw_profile(panel: Axes, fitted: Fit, name: str) -> None:
    """Draw the profile of one parameter, with its interval and prior."""
    maximum = fitted.maximum
    parameter = fitted.model.parameters[name]
    interval = fitted.estimates[name].interval

    places = _places_of_profile(fitted, name)
    values = np.array([parameter.value_at(place) for place in places]) / parameter.scale

    prior = places**2 - min(places**2)
    panel.plot(values, prior, color=DARK, alpha=0.35, linewidth=1)
    panel.plot(values, maximum.profile(name, places), color=BLUE)
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
