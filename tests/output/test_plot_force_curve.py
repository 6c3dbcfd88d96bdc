"""Force-distance curves as an AFM shows them: attraction negative, snap-in, pull-off, radii told apart."""

import numpy as np
import pytest
from support.figures import captured

from iswarm_mj.output import plot_force_curve
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
    """In nm and nN, sorted by voltage, then radius; with a mark where it snaps in and where it is pulled off."""
    shown = captured(monkeypatch, plot_force_curve)
    scales = {(v, r): 1 + k + v / 10 for v in (0.0, 20.0) for k, r in enumerate((15e-6, 25e-6))}
    curves = [rows_of(*setting, scale) for setting, scale in reversed(scales.items())]
    draw_force_curve(curves, {"relative_humidity": 30.0}, tmp_path)
    whole, near = shown["force_curve"]
    assert near.get_ylim()[1] < 400 < 800 < -near.get_ylim()[0]
    lines, marks = ([line for line in near.lines if len(line.get_xdata()) == n] for n in (4, 1))
    for k, (side, scale) in enumerate((side, scale) for scale in scales.values() for side in GAPS):
        np.testing.assert_allclose(
            lines[k].get_xydata().T, 1e9 * np.array([GAPS[side], scale * np.array(TOTALS[side])])
        )
        place, mark = {"approach": ((1, -90 * scale), "o"), "retract": ((1, -200 * scale), "v")}[side]
        np.testing.assert_allclose(marks[k].get_xydata(), [place])
        assert marks[k].get_marker() == mark
    styles = [(line.get_color(), line.get_linestyle()) for line in lines[::2]]
    assert len(set(styles)) == 4 and styles[0][0] == styles[1][0] and styles[0][1] == styles[2][1]
    legend = [text.get_text() for text in whole.get_legend().get_texts()]
    assert legend == ["0 V", "20 V", "R = 15 µm", "R = 25 µm"]
