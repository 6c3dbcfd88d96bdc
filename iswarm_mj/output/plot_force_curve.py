"""Figure of force-distance curves in the convention of AFMs.

Attraction is negative; curves have a snap-in and a pull-off.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from iswarm_mj.output.palette import BLUE, DARK, GREEN, ORANGE, PURPLE, YELLOW
from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.plot_trials import Rows, column_array
from iswarm_mj.output.trial_laws import described_parameters
from iswarm_mj.output.trial_shapes import NN, UM

_NM = 1e9
"""Nanometres per metre."""
_LARGEST_GAP = 30.0
"""Largest gap that is drawn [nm]."""
_GAP_MARGIN = 0.5
"""Margin left of the smallest gap, in addition to a tenth of that gap [nm]."""
_SMALLEST_PULL = 1.0
"""Smallest pull for which the magnified axis has room, as curves may not attract at all [nN]."""
_ROOM_BELOW = 1.15
_ROOM_ABOVE = 0.3
"""Room for attraction and repulsion on the magnified axis, in largest attractions."""
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, DARK)
_DASHES: tuple[Any, ...] = (
    "-",
    "--",
    ":",
    "-.",
    (0, (9, 2)),
    (0, (1, 4)),
    (0, (5, 1, 1, 1, 1, 1)),
    (0, (9, 1, 3, 1)),
)


class _Curve(NamedTuple):
    """A force-distance curve and its look."""

    voltage: float
    """Voltage [V]."""
    radius: float
    """Radius of the ball [m]."""
    rows: Rows
    colour: str
    dashes: Any


def snap_in(gap: np.ndarray, force: np.ndarray) -> tuple[float, float] | None:
    """Return gap and force at the last sample before first touch on approach.

    It is the sample from which the tool snaps into contact, or the first one if they touch already;
    None where tool and ball do not touch.

    Args:
        gap: gaps in the order of time, negative where the tool dents the ball.
        force: forces on the tool.
    """
    touches = gap <= 0
    if not touches.any():
        return None
    first_touch = int(np.argmax(touches))
    sample = max(first_touch - 1, 0)
    return float(gap[sample]), float(force[sample])


def pull_off(gap: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Return gap and force where a tool is held back most.

    Args:
        gap: gaps of the retract branch.
        force: forces on the tool, negative if the ball holds it back.
    """
    sample = int(np.argmin(force))
    return float(gap[sample]), float(force[sample])


class _Branch(NamedTuple):
    """Style of a branch of a curve."""

    direction: str
    width: float
    marker: str
    find_marked: Callable[[np.ndarray, np.ndarray], tuple[float, float] | None]
    """Returns gap and force of the sample that is marked, or None."""


_BRANCHES = (
    _Branch("approach", 0.9, "o", snap_in),
    _Branch("retract", 2.0, "v", pull_off),
)


def draw_force_curve(curves: Sequence[Rows], settings: Mapping[str, Any], out: Path) -> None:
    """Draw force-distance curves near contact, and once more with their attraction magnified.

    There is a colour for each voltage and a dash pattern for each radius; approach is thin, retract
    is thick.

    Args:
        curves: rows of one voltage [V] and radius [m] each, in the order of time, with the gap
            between tool and ball [m], the direction ("approach" or "retract"), and the total force
            [N], which is negative if it attracts. They are at the medians of the works of adhesion,
            as the caption says.
        settings: settings of the run, which the caption states; `relative_humidity` [%] if it is a
            number.
        out: directory of force_curve.png and .svg.
    """
    styled = _styled(curves)

    # Ends of the axes [nN, nm].
    lowest_forces = [float(column_array(rows, "total").min()) * NN for rows in curves]
    lowest_force = min(-_SMALLEST_PULL, *lowest_forces)
    smallest_gap = min(float(column_array(rows, "gap").min()) * _NM for rows in curves)
    gap_limits = (1.1 * smallest_gap - _GAP_MARGIN, _LARGEST_GAP)

    with figure(out / "force_curve", columns=2, size=(4.3, 3.6), caption=_caption(settings)) as (
        near_contact,
        magnified,
    ):
        for axes, title in (
            (near_contact, "(a) near contact"),
            (magnified, "(b) attraction, magnified"),
        ):
            for curve in styled:
                _draw_curve(axes, curve)
            axes.axhline(0, color="0.4", lw=0.8)
            axes.axvline(0, color="0.4", lw=0.8)
            axes.set(
                xlim=gap_limits,
                xlabel="gap between tool and ball [nm]",
                ylabel="force [nN]",
                title=title,
            )
        magnified.set_ylim(_ROOM_BELOW * lowest_force, -_ROOM_ABOVE * lowest_force)
        near_contact.legend(handles=_legend_handles(styled), fontsize=7, handlelength=4)


def _styled(curves: Sequence[Rows]) -> list[_Curve]:
    """Return the curves in the order of voltage and radius, each with its colour and dashes.

    Colours and dashes repeat where there are more voltages or radii than of them.
    """
    voltages = {rows[0]["voltage"] for rows in curves}
    radii = {rows[0]["radius"] for rows in curves}
    colour_of = dict(zip(sorted(voltages), cycle(_COLOURS)))
    dashes_of = dict(zip(sorted(radii), cycle(_DASHES)))

    styled = []
    for rows in curves:
        voltage = rows[0]["voltage"]
        radius = rows[0]["radius"]
        styled.append(_Curve(voltage, radius, rows, colour_of[voltage], dashes_of[radius]))
    return sorted(styled, key=attrgetter("voltage", "radius"))


def _draw_curve(axes: Axes, curve: _Curve) -> None:
    """Draw both branches of a curve with their marks."""
    for branch in _BRANCHES:
        rows = [row for row in curve.rows if row["direction"] == branch.direction]
        gap = column_array(rows, "gap") * _NM
        force = column_array(rows, "total") * NN
        axes.plot(gap, force, color=curve.colour, ls=curve.dashes, lw=branch.width)
        marked = branch.find_marked(gap, force)
        if marked is not None:
            axes.plot(*marked, branch.marker, color=curve.colour, ms=5, mec="white", zorder=5)


def _caption(settings: Mapping[str, Any]) -> str:
    humidity = settings.get("relative_humidity")
    condition = f" at {humidity:g} % RH" if isinstance(humidity, int | float) else ""
    return (
        f"One curve for each voltage and radius{condition}, works of adhesion at their medians; "
        "retract is thicker.\n"
        "Force on the tool as in an AFM: attraction is negative. "
        "Circle: last before touch; triangle: pull-off.\n"
        f"{described_parameters(settings)}"
    )


def _legend_handles(curves: Sequence[_Curve]) -> list[Line2D]:
    """Return a line for each voltage, then one for each radius, both in ascending order."""
    colours = {curve.voltage: curve.colour for curve in curves}
    dashes = {curve.radius: curve.dashes for curve in curves}
    handles = []
    for voltage in sorted(colours):
        handles.append(Line2D([], [], color=colours[voltage], label=f"{voltage:g} V"))
    for radius in sorted(dashes):
        label = f"R = {radius * UM:g} µm"
        handles.append(Line2D([], [], color="0.3", ls=dashes[radius], label=label))
    return handles
