"""Figures of the gripper's experiments: voltages and single trials. Axes in µm, V, nN and ms."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.gripper.bench.trial_trace import Trace
from iswarm_mj.gripper.laws.detachment import RELEASE_GAP
from iswarm_mj.gripper.reference import PAPER_HUMIDITY
from iswarm_mj.output.plot_style import DARK, GREEN, ORANGE, YELLOW, figure
from iswarm_mj.output.plot_voltages import Laws, Rows, draw_attempts, draw_voltages

_UM, _NN, _MS = 1e6, 1e9, 1e3

_FORCES = (
    ("electrostatic", "electrostatic, positive to the tool", YELLOW),
    ("adhesion_tool", "adhesion to the tool", GREEN),
    ("adhesion_plate", "adhesion to the plate", ORANGE),
    ("contact_tool", "contact with the tool", "#88ccbb"),
    ("contact_plate", "contact with the plate", "#e8b0a0"),
)
"""Fields of a trace, the names of the forces and their colours."""


def draw_figures(rows: Rows, settings: Mapping[str, Any], out: Path) -> list[Path]:
    """Draw what the rows have: grasp voltages, release voltages, attempts without contact.

    Args:
        rows: of the table of trials, SI. Those that are faulty are left out, and the figure says how many.
        settings: of the run; its `calibration`, constants of `detachment` by their names, is behind the lines of the
            force laws. Absent ones are those of `detachment` itself.
        out: directory.

    Returns:
        Paths of the PNG files; an SVG file lies beside each.
    """
    laws = Laws(settings)
    grasp, release, attempts = (
        [row for row in rows if row["experiment"] == name] for name in ("grasp", "release", "no_contact")
    )
    at_10 = [row for row in grasp if row["relative_humidity"] == PAPER_HUMIDITY]
    drawn = []
    if at_10:
        drawn.append(draw_voltages(out / "grasp_voltage", at_10, laws))
    if len(grasp) > len(at_10):
        drawn.append(draw_voltages(out / "grasp_voltage_humidity", grasp, laws))
    for gap in sorted({row["gap"] for row in release}):
        name = "release_voltage" if gap == RELEASE_GAP else f"release_voltage_{gap * _UM:g}um"
        drawn.append(draw_voltages(out / name, [row for row in release if row["gap"] == gap], laws))
    if attempts:
        drawn.append(draw_attempts(out / "no_contact", attempts, laws))
    return drawn


def draw_trace(trace: Trace, path: Path) -> Path:
    """Draw a trial over time: voltage, gaps and forces, with its phases shaded.

    Args:
        trace: of the trial.
        path: of the files, without suffix.

    Returns:
        Path of the PNG file.
    """
    time = trace.time * _MS
    with figure(path, rows=3, size=(8.0, 2.2)) as panels:
        voltage, gaps, forces = panels
        voltage.plot(time, trace.voltage, color=DARK, lw=1.2)
        gaps.plot(time, trace.gap_tool * _UM, color=GREEN, lw=1.2, label="tool to ball")
        gaps.plot(time, trace.gap_plate * _UM, color=ORANGE, lw=1.2, label="ball to plate")
        for name, label, hue in reversed(_FORCES):
            forces.plot(time, getattr(trace, name) * _NN, color=hue, lw=1.2, label=label)
        forces.axhline(trace.weight * _NN, color=DARK, lw=0.8, ls=":", label="weight")
        forces.set_yscale("symlog", linthresh=1.0)
        voltage.set(ylabel="voltage [V]")
        voltage.set_title(f"Trial with a ball of radius {trace.radius * _UM:g} µm", pad=48)
        gaps.set(ylabel="gap [µm]")
        forces.set(ylabel="force [nN]", xlabel="time [ms]")
        starts = np.flatnonzero(np.append(True, np.diff(trace.phase) != 0))
        edges = np.append(time[starts], time[-1])
        for axes in panels:
            axes.set_xlim(time[0], time[-1])
            for i in range(0, len(starts), 2):
                axes.axvspan(edges[i], edges[i + 1], color="0.5", alpha=0.1, lw=0)
            if axes is not voltage:
                axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
        for start, left, right in zip(starts, edges[:-1], edges[1:], strict=True):
            name, at = trace.phases[trace.phase[start]], ((left + right) / 2, 1.03)
            voltage.text(*at, name, transform=voltage.get_xaxis_transform(), rotation=90, ha="center", fontsize=7)
    return path.with_name(path.name + ".png")
