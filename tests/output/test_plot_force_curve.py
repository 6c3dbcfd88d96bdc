"""Force-distance curves as an AFM shows them: attraction negative, snap-in, pull-off, radii told apart."""

import numpy as np
import pytest

from iswarm_mj.output.plot_force_curve import curves_of, draw_force_curve, pull_off, snap_in

GAPS = {"approach": (20e-9, 5e-9, 1e-9, -2e-9), "retract": (-2e-9, -1e-9, 1e-9, 20e-9)}
TOTALS = {"approach": (-10e-9, -50e-9, -90e-9, 3e-6), "retract": (3e-6, -40e-9, -200e-9, -10e-9)}


def rows_of(voltage, radius, scale=1.0):
    return [
        {
            "direction": direction,
            "voltage": voltage,
            "radius": radius,
            "gap": gap,
            "adhesion": min(total, 0) * scale,
            "electrostatic": -5e-9 if voltage else 0.0,
            "total": total * scale,
        }
        for direction in GAPS
        for gap, total in zip(GAPS[direction], TOTALS[direction], strict=True)
    ]


def test_snap_in_and_pull_off_are_where_the_samples_say():
    approach, retract = curves_of(rows_of(20.0, 15e-6))
    assert (approach.direction, retract.direction) == ("approach", "retract")
    np.testing.assert_allclose(approach.force, [-10, -50, -90, 3000])
    assert snap_in(approach) == pytest.approx((1, -90))
    assert pull_off(retract) == pytest.approx((1, -200))


def test_without_touch_there_is_no_snap_in():
    rows = [row for row in rows_of(0.0, 15e-6) if row["gap"] > 0]
    assert snap_in(curves_of(rows)[0]) is None


@pytest.fixture
def shown(monkeypatch):
    """The axes of the figure that is drawn."""
    from matplotlib.figure import Figure

    kept, save = [], Figure.savefig

    def savefig(self, *args, **settings):
        kept.append(self)
        return save(self, *args, **settings)

    monkeypatch.setattr(Figure, "savefig", savefig)
    return kept


def test_all_is_drawn(tmp_path, shown):
    rows = [row for v in (0.0, 20.0) for k, r in enumerate((15e-6, 25e-6)) for row in rows_of(v, r, 1 + k)]
    assert draw_force_curve(rows, {"relative_humidity": 30.0}, tmp_path) == tmp_path / "force_curve.png"
    assert (tmp_path / "force_curve.svg").stat().st_size > 10_000
    whole, near, parts = shown[0].axes
    assert whole.get_ylim()[1] >= 6000 and whole.get_ylim()[0] <= -400  # the contact branch as a whole
    assert near.get_ylim()[1] < 200 < 400 <= -near.get_ylim()[0]
    curves = [line for line in whole.lines if len(line.get_xdata()) == 4]
    assert len(curves) == 8 and len({line.get_color() for line in curves}) == 2
    by_radius = {k: {line.get_linestyle() for line in curves[k : k + 2]} for k in (0, 2)}
    assert by_radius[0].isdisjoint(by_radius[2])
    assert {text.get_text() for text in near.texts} == {"-200 nN", "-400 nN"}
    marks = [line.get_marker() for line in near.lines if len(line.get_xdata()) == 1]
    assert sorted(marks) == ["o"] * 4 + ["v"] * 4
    labels = [text.get_text() for text in whole.get_legend().get_texts()]
    assert labels == ["0 V", "20 V", "R = 15 µm", "R = 25 µm"]
    assert (np.concatenate([line.get_ydata() for line in parts.lines]) <= 0).all()
    assert "at 30 % RH" in shown[0].get_supxlabel() and "attraction is negative" in shown[0].get_supxlabel()
