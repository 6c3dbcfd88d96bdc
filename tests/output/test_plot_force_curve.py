"""Force-distance curves as an AFM shows them: attraction negative, snap-in, pull-off, radii told apart."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from iswarm_mj.output.plot_force_curve import draw_force_curve, pull_off, snap_in

GAPS = {"approach": (20e-9, 5e-9, 1e-9, -2e-9), "retract": (-2e-9, -1e-9, 1e-9, 20e-9)}
TOTALS = {"approach": (-10e-9, -50e-9, -90e-9, 3e-6), "retract": (3e-6, -40e-9, -200e-9, -10e-9)}


def rows_of(voltage, radius, scale=1.0):
    return [
        {"direction": direction, "voltage": voltage, "radius": radius, "gap": gap, "total": total * scale}
        for direction in GAPS
        for gap, total in zip(GAPS[direction], TOTALS[direction], strict=True)
    ]


def test_snap_in_and_pull_off_are_where_the_samples_say():
    approach, retract = (1e9 * np.array([GAPS[side], TOTALS[side]]) for side in GAPS)
    assert snap_in(*approach) == pytest.approx((1, -90))
    assert pull_off(*retract) == pytest.approx((1, -200))
    assert snap_in(*approach[:, :3]) is None


def test_all_is_drawn(tmp_path, monkeypatch):
    shown, save = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *args, **more: (shown.append(self), save(self, *args, **more)))
    curves = [rows_of(v, r, 1 + k) for v in (0.0, 20.0) for k, r in enumerate((15e-6, 25e-6))]
    draw_force_curve(curves, {"relative_humidity": 30.0}, tmp_path)
    assert (tmp_path / "force_curve.svg").stat().st_size > 10_000
    whole, near = shown[0].axes
    assert len([line for line in whole.lines if len(line.get_xdata()) == 4]) == 8
    assert near.get_ylim()[1] < 200 < 400 <= -near.get_ylim()[0]
    marks = [line.get_marker() for line in near.lines if len(line.get_xdata()) == 1]
    assert sorted(marks) == ["o"] * 4 + ["v"] * 4
