"""Figure of force-distance curves in the convention of AFMs: attraction is negative, with snap-in and pull-off."""

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.output.palette import BLUE, DARK, GREEN, ORANGE, PURPLE, YELLOW
from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.plot_trials import Rows, column
from iswarm_mj.output.trial_shapes import NN, UM

_NM = 1e9
_NEAR = 30.0
"""Gaps up to which a curve is near contact [nm]."""
_HUES = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, DARK)
_DASHES = ("-", "--", ":", "-.")
_WIDTHS = {"approach": 0.9, "retract": 2.0}


class Curve(NamedTuple):
    """One approach or retract."""

    voltage: float
    radius: float
    direction: str
    gap: np.ndarray
    """Between tool and ball, negative in contact [nm]."""
    force: np.ndarray
    """On the tool, negative if it is attracted [nN]."""


def curves_of(rows: Rows) -> list[Curve]:
    """Curves by voltage, radius and direction; rows in the order of time, see `draw_force_curve`."""
    found: dict[tuple[float, float, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        found.setdefault((row["voltage"], row["radius"], row["direction"]), []).append(row)
    return [Curve(*key, column(own, "gap") * _NM, column(own, "total") * NN) for key, own in sorted(found.items())]


def snap_in(curve: Curve) -> tuple[float, float] | None:
    """Gap and force at the last sample before first touch on approach; None where they do not touch."""
    touches = curve.gap <= 0
    if not touches.any():
        return None
    place = max(int(np.argmax(touches)) - 1, 0)
    return float(curve.gap[place]), float(curve.force[place])


def pull_off(curve: Curve) -> tuple[float, float]:
    """Gap and force where a retracting tool is held back most."""
    place = int(np.argmin(curve.force))
    return float(curve.gap[place]), float(curve.force[place])


def draw_force_curve(rows: Rows, settings: Mapping[str, Any], out: Path) -> None:
    """Draw force-distance curves, as a whole and near pull-off.

    A colour for each voltage, dashes for each radius; approach is thin, retract is thick.

    Args:
        rows: in the order of time; gap between tool and ball [m], voltage [V], direction ("approach" or "retract"),
            the force total [N], negative if it attracts, and radius [m].
        settings: of the run; `relative_humidity` [%] goes into the caption if it is one number.
        out: directory of force_curve.png and .svg.
    """
    curves = curves_of(rows)
    hues = dict(zip(sorted({curve.voltage for curve in curves}), cycle(_HUES)))
    dashes = dict(zip(sorted({curve.radius for curve in curves}), cycle(_DASHES)))
    humidity = settings.get("relative_humidity")
    condition = f" at {humidity:g} % RH" if isinstance(humidity, int | float) else ""
    caption = (
        f"One curve for each voltage and radius{condition}, works of adhesion at their medians; retract is thicker.\n"
        "Force on the tool as in an AFM: attraction is negative. Circle: last before touch; triangle: pull-off."
    )
    lowest = min(-1.0, *(float(curve.force.min()) for curve in curves))
    least = min(float(curve.gap.min()) for curve in curves)
    with figure(out / "force_curve", columns=2, size=(4.3, 3.6), caption=caption) as (whole, near):
        for axes, title in ((whole, "(a) near contact"), (near, "(b) attraction, magnified")):
            for curve in curves:
                label = f"{curve.voltage:g} V, R = {curve.radius * UM:g} µm" if curve.direction == "retract" else None
                style = {"color": hues[curve.voltage], "ls": dashes[curve.radius], "lw": _WIDTHS[curve.direction]}
                axes.plot(curve.gap, curve.force, label=label, **style)
                mark, found = ("o", snap_in(curve)) if curve.direction == "approach" else ("v", pull_off(curve))
                if found is not None:
                    axes.plot(*found, mark, color=hues[curve.voltage], ms=5, mec="white", zorder=5)
            axes.axhline(0, color="0.4", lw=0.8)
            axes.axvline(0, color="0.4", lw=0.8)
            axes.set(
                xlim=(1.1 * least - 0.5, _NEAR),
                xlabel="gap between tool and ball [nm]",
                ylabel="force [nN]",
                title=title,
            )
        near.set_ylim(1.15 * lowest, -0.3 * lowest)
        whole.legend(fontsize=7)
