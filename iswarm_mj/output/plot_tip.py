"""Figure of a tip: its profile with a ball, its voltages, and their tolerances."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from iswarm_mj.gripper.tips.profile import Profile, seat_of
from iswarm_mj.gripper.tips.solid import points_of
from iswarm_mj.output.palette import BLUE, DARK, GREY, ORANGE, PALE, YELLOW
from iswarm_mj.output.plot_style import figure
from iswarm_mj.output.trial_shapes import UM

Rows = Sequence[Mapping[str, Any]]
"""Rows of `workflows.tip.TipRow`, as values by the names of columns."""


def draw_tip(
    profile: Profile,
    *,
    rows: Rows,
    flat_rows: Rows,
    tolerances: Rows,
    caption: str,
    out: Path,
) -> None:
    """Draw profile, voltages over the ball's radius, and tolerances.

    Args:
        profile: of the tip.
        rows: of the tip; those of the first humidity and gap are drawn.
        flat_rows: of a flat tip of the same radius.
        tolerances: over gaps and over misplacements.
        caption: of the figure.
        out: path of the figure, without suffix.
    """
    with figure(out, rows=2, columns=2, size=(4.0, 3.2), caption=caption) as axes:
        shape, by_radius, by_gap, by_offset = axes
        middle = sorted(row["radius"] for row in rows)[len(rows) // 2]
        _draw_profile(shape, profile, middle)

        first = rows[0]
        kept = [i for i, row in enumerate(rows) if _is_like(row, first)]
        radii = [rows[i]["radius"] * UM for i in kept]
        for column, colour, name in (
            ("grasp_voltage", BLUE, "grasp"),
            ("release_voltage", ORANGE, "release"),
        ):
            by_radius.plot(radii, [rows[i][column] for i in kept], "o-", color=colour, label=name)
            flat = [flat_rows[i][column] for i in kept]
            by_radius.plot(
                radii, flat, "s--", color=colour, ms=4, alpha=0.5, label=f"{name}, flat tip"
            )
        by_radius.set(xlabel="radius of the ball [µm]", ylabel="voltage [V]", title="voltages")
        by_radius.legend(fontsize=7)

        over_gap = [row for row in tolerances if row["misplacement"] == 0]
        gaps = [row["gap"] * UM for row in over_gap]
        by_gap.plot(gaps, [row["release_voltage"] for row in over_gap], "o-", color=ORANGE)
        by_gap.set(xlabel="gap at the release [µm]", ylabel="release voltage [V]", title="gap")

        over_offset = [row for row in tolerances if row["gap"] == first["gap"]]
        offsets = [row["misplacement"] * UM for row in over_offset]
        for column, colour in (("grasp_voltage", BLUE), ("release_voltage", ORANGE)):
            by_offset.plot(offsets, [row[column] for row in over_offset], "o-", color=colour)
        by_offset.set(
            xlabel="misplacement of the ball [µm]", ylabel="voltage [V]", title="misplacement"
        )
        for each in (by_radius, by_gap, by_offset):
            each.set_ylim(0, 1.15 * each.get_ylim()[1])


def _is_like(row: Mapping[str, Any], first: Mapping[str, Any]) -> bool:
    """Return whether a row has the humidity and the gap of another."""
    return (row["relative_humidity"], row["gap"]) == (first["relative_humidity"], first["gap"])


def _draw_profile(axes: Axes, profile: Profile, ball_radius: float) -> None:
    """Draw the tip that touches a ball [m] on the plate."""
    radius = ball_radius * UM
    lift = radius - seat_of(profile, ball_radius).height * UM
    r, z = (values * UM for values in points_of(profile))
    top = max(lift + z.max() + 0.6 * profile.radius * UM, 2.6 * radius)
    outline_r = np.concatenate([-r[::-1], r, [r[-1], -r[-1]]])
    outline_z = np.concatenate([z[::-1], z, [top - lift, top - lift]]) + lift
    axes.fill(outline_r, outline_z, color=PALE, ec=DARK, lw=1)
    axes.add_patch(Circle((0, radius), radius, fc=YELLOW, ec=DARK, lw=0.8, alpha=0.8))
    axes.axhline(0, color=GREY, lw=4)
    half = 1.25 * max(radius, r[-1])
    axes.set(
        xlim=(-half, half),
        ylim=(-0.08 * top, top),
        aspect="equal",
        xlabel="distance from the axis [µm]",
        ylabel="height [µm]",
        title=f"tip and ball of {radius:g} µm",
    )
    axes.grid(visible=False)
