"""Figure of force-distance curves in the convention of AFMs: attraction is negative, with snap-in and pull-off."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from iswarm_mj.output.palette import BLUE, DARK, GREEN, ORANGE, PURPLE, YELLOW
from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.plot_trials import Rows, column
from iswarm_mj.output.trial_shapes import NN, UM

_NM = 1e9
_NEAR = 30.0
"""Gaps up to which a curve is near contact [nm]."""
_HUES = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, DARK)
_DASHES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (9, 2)), (0, (1, 4)), (0, (5, 1, 1, 1, 1, 1)), (0, (9, 1, 3, 1)))


def snap_in(gap: np.ndarray, force: np.ndarray) -> tuple[float, float] | None:
    """Gap and force at the last sample before first touch on approach; None where they do not touch."""
    touches = gap <= 0
    if not touches.any():
        return None
    place = max(int(np.argmax(touches)) - 1, 0)
    return float(gap[place]), float(force[place])


def pull_off(gap: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Gap and force where a retracting tool is held back most."""
    place = int(np.argmin(force))
    return float(gap[place]), float(force[place])


def draw_force_curve(curves: Sequence[Rows], settings: Mapping[str, Any], out: Path) -> None:
    """Draw force-distance curves, as a whole and near pull-off.

    A colour for each voltage, dashes for each radius; approach is thin, retract is thick.

    Args:
        curves: rows of one voltage [V] and radius [m] each, in the order of time; gap between tool and ball [m],
            direction ("approach" or "retract"), the force total [N], negative if it attracts.
        settings: of the run; `relative_humidity` [%] goes into the caption if it is one number.
        out: directory of force_curve.png and .svg.
    """
    by_setting = sorted((((rows[0]["voltage"], rows[0]["radius"]), rows) for rows in curves), key=itemgetter(0))
    hues = dict(zip(sorted({voltage for (voltage, _), _ in by_setting}), cycle(_HUES)))
    dashes = dict(zip(sorted({radius for (_, radius), _ in by_setting}), cycle(_DASHES)))
    humidity = settings.get("relative_humidity")
    condition = f" at {humidity:g} % RH" if isinstance(humidity, int | float) else ""
    caption = (
        f"One curve for each voltage and radius{condition}, works of adhesion at their medians; retract is thicker.\n"
        "Force on the tool as in an AFM: attraction is negative. Circle: last before touch; triangle: pull-off."
    )
    lowest = min(-1.0, *(float(column(rows, "total").min()) * NN for rows in curves))
    least = min(float(column(rows, "gap").min()) * _NM for rows in curves)
    with figure(out / "force_curve", columns=2, size=(4.3, 3.6), caption=caption) as (whole, near):
        for axes, title in ((whole, "(a) near contact"), (near, "(b) attraction, magnified")):
            for (voltage, radius), rows in by_setting:
                for direction, width, mark, place in _SIDES:
                    own = [row for row in rows if row["direction"] == direction]
                    gap, force = column(own, "gap") * _NM, column(own, "total") * NN
                    axes.plot(gap, force, color=hues[voltage], ls=dashes[radius], lw=width)
                    found = place(gap, force)
                    if found is not None:
                        axes.plot(*found, mark, color=hues[voltage], ms=5, mec="white", zorder=5)
            axes.axhline(0, color="0.4", lw=0.8)
            axes.axvline(0, color="0.4", lw=0.8)
            axes.set(
                xlim=(1.1 * least - 0.5, _NEAR),
                xlabel="gap between tool and ball [nm]",
                ylabel="force [nN]",
                title=title,
            )
        near.set_ylim(1.15 * lowest, -0.3 * lowest)
        voltages = [Line2D([], [], color=hue, label=f"{voltage:g} V") for voltage, hue in hues.items()]
        radii = [Line2D([], [], color="0.3", ls=ls, label=f"R = {radius * UM:g} µm") for radius, ls in dashes.items()]
        whole.legend(handles=voltages + radii, fontsize=7, handlelength=4)


_SIDES: tuple[Any, ...] = (("approach", 0.9, "o", snap_in), ("retract", 2.0, "v", pull_off))
"""Directions, widths of their lines, marks and what these mark."""
