"""Figure of force-distance curves in the convention of AFMs: attraction is negative, with snap-in and pull-off."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from iswarm_mj.output.palette import BLUE, DARK, GREEN, ORANGE, PURPLE, YELLOW
from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.plot_trials import Rows, column
from iswarm_mj.output.trace_lines import NN, UM

_NM = 1e9
_NEAR = 30.0
"""Gaps up to which a curve is near contact [nm]."""
_HUES = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, DARK)
_DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (1.5, 1.5)), (0, (6, 1.5, 1.5, 1.5)), (0, (3, 1)), (0, (10, 3)))
_WIDTHS = {"approach": 0.9, "retract": 2.0}
_PARTS = (("adhesion", 0.9), ("electrostatic", 1.8))


class Curve(NamedTuple):
    """One approach or retract."""

    voltage: float
    radius: float
    direction: str
    gap: np.ndarray
    """Between tool and ball, negative in contact [nm]."""
    force: np.ndarray
    """On the tool, negative if it is attracted [nN]."""
    touches: np.ndarray
    """Whether tool and ball are in contact."""
    rows: Rows


def curves_of(rows: Rows) -> list[Curve]:
    """Curves by voltage, radius and direction; rows in the order of time, see `draw_force_curve`."""
    found: dict[tuple[float, float, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        found.setdefault((row["voltage"], row["radius"], row["direction"]), []).append(row)
    return [
        Curve(*key, column(own, "gap") * _NM, column(own, "total") * NN, column(own, "gap") <= 0, own)
        for key, own in sorted(found.items())
    ]


def snap_in(curve: Curve) -> tuple[float, float] | None:
    """Gap and force at the last sample before first touch on approach; None where they do not touch."""
    if not curve.touches.any():
        return None
    place = max(int(np.argmax(curve.touches)) - 1, 0)
    return float(curve.gap[place]), float(curve.force[place])


def pull_off(curve: Curve) -> tuple[float, float]:
    """Gap and force where a retracting tool is held back most."""
    place = int(np.argmin(curve.force))
    return float(curve.gap[place]), float(curve.force[place])


def draw_force_curve(rows: Rows, settings: Mapping[str, Any], out: Path) -> Path:
    """Draw force-distance curves: all of them, near pull-off, and their attractive parts at all gaps.

    A colour for each voltage, dashes for each radius; approach is thin, retract is thick.

    Args:
        rows: in the order of time; gap between tool and ball [m], voltage [V], direction ("approach" or "retract"),
            the forces electrostatic, adhesion and total [N], negative if they attract, and radius [m].
        settings: of the run; `relative_humidity` [%] goes into the caption if it is one number.
        out: directory.

    Returns:
        Path of the PNG file.
    """
    path, curves = out / "force_curve", curves_of(rows)
    hues = {v: _HUES[k % len(_HUES)] for k, v in enumerate(sorted({c.voltage for c in curves}))}
    dashes = {r: _DASHES[k % len(_DASHES)] for k, r in enumerate(sorted({c.radius for c in curves}))}
    humidity = settings.get("relative_humidity")
    condition = f" at {humidity:g} % RH" if isinstance(humidity, int | float) else ""
    caption = (
        f"One curve for each voltage and radius{condition}, works of adhesion at their medians. Force on the tool as\n"
        "in an AFM: attraction is negative. Snap-in: last sample before first touch. Pull-off: greatest attraction on "
        "retract."
    )
    with figure(path, columns=3, size=(4.3, 3.9), caption=caption) as (whole, near, parts):
        for curve in curves:
            style: Any = {
                "color": hues[curve.voltage],
                "ls": dashes[curve.radius],
                "lw": _WIDTHS[curve.direction],
            }
            for axes in (whole, near):
                axes.plot(curve.gap, curve.force, **style)
                _mark(axes, curve, hues[curve.voltage], axes is near)
            for name, width in _PARTS if curve.direction == "approach" else ():
                if curve.voltage or name == "adhesion":
                    parts.plot(curve.gap / 1e3, column(curve.rows, name) * NN, **style | {"lw": width})
        lowest = min(-1.0, *(float(curve.force.min()) for curve in curves))
        least = min(float(curve.gap.min()) for curve in curves)
        for axes, title in ((whole, "(a) near contact"), (near, "(b) attraction, magnified")):
            axes.axhline(0, color="0.4", lw=0.8)
            axes.axvline(0, color="0.4", lw=0.8)
            axes.set(xlim=(1.1 * least - 0.5, _NEAR), xlabel="gap between tool and ball [nm]", ylabel="force [nN]")
            axes.set_title(title)
        near.set_ylim(1.15 * lowest, -0.3 * lowest)
        parts.set(xlabel="gap between tool and ball [µm]", ylabel="force [nN]", title="(c) parts, without contact")
        parts.set(xscale="log", xlim=(1e-3, None))
        parts.set_yscale("symlog", linthresh=0.1)
        parts.set_ylim(1.5 * lowest, 0)
        conditions = [_sample(f"{v:g} V", color=hue) for v, hue in hues.items()]
        conditions += [_sample(f"R = {r * UM:g} µm", ls=ls) for r, ls in dashes.items()]
        strokes = [_sample(name, lw=width) for name, width in _WIDTHS.items()]
        strokes += [_sample("snap-in", marker="o", ls=""), _sample("pull-off", marker="v", ls="")]
        kinds = [_sample(name, lw=width) for name, width in _PARTS]
        for axes, handles in ((whole, conditions), (near, strokes), (parts, kinds)):
            axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), fontsize=7, ncols=2)
    return path.with_name(path.name + ".png")


def _mark(axes: Axes, curve: Curve, hue: str, with_force: bool) -> None:
    """Mark snap-in or pull-off."""
    is_approach = curve.direction == "approach"
    found = snap_in(curve) if is_approach else pull_off(curve)
    if found is None:
        return
    axes.plot(*found, marker="o" if is_approach else "v", color=hue, markersize=5, markeredgecolor="white", zorder=5)
    if with_force and not is_approach:
        text = f"{found[1]:.0f} nN"
        axes.annotate(text, found, (6, -3), textcoords="offset points", fontsize=6.5, color=hue, annotation_clip=True)


def _sample(label: str, color: str = "0.2", **style: Any) -> Line2D:
    """A line of the legend."""
    return Line2D([], [], color=color, label=label, **style)
