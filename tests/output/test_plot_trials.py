"""What is on the figures, read from their axes."""

import numpy as np
import pytest
from support.figures import captured, line

from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.detachment import WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT, grasp_voltage, release_voltage
from iswarm_mj.output import plot_trials
from iswarm_mj.output.plot_trials import draw_figures

RADII = (15e-6, 20e-6, 25e-6)


@pytest.fixture
def shown(monkeypatch):
    return captured(monkeypatch, plot_trials)


def make_row(experiment="grasp", **changes):
    row = {"experiment": experiment, "radius": 20e-6, "relative_humidity": 10.0, "gap": 0.0, "voltage": 25.0}
    row |= {"limit_voltage": 80.0, "melted": False, "faulty": False}
    if experiment == "release":
        row |= {"gap": 5e-6, "voltage": 42.0, "flight_time": 0.18e-3, "landing_speed": 0.14, "landed": True}
    if experiment == "no_contact":
        row |= {"gap": 1e-6, "voltage": None, "limit_voltage": 50.0}
    return row | changes


def make_rows(experiment, humidities=(10.0,)):
    """Two repeats at each radius, whose mean is 26 V, 27 V, ... with the radius."""
    return [
        make_row(experiment, radius=radius, relative_humidity=percent, repeat=repeat, voltage=26.0 + i + 2 * repeat - 1)
        for percent in humidities
        for i, radius in enumerate(RADII)
        for repeat in (0, 1)
    ]


def caption(axes):
    return axes.get_legend().get_title().get_text()


def bands(axes):
    """Limits of the shaded bands."""
    return [(p.get_y(), p.get_y() + p.get_height()) for p in axes.patches]


def test_grasp_at_10_percent(tmp_path, shown):
    draw_figures(make_rows("grasp"), {}, tmp_path)
    (axes,) = shown["grasp_voltage"]
    assert len(shown) == 1
    trials = line(axes, "each trial")
    np.testing.assert_allclose(trials[:, 0], [15, 15, 20, 20, 25, 25])
    np.testing.assert_allclose(trials[:, 1], [25, 27, 26, 28, 27, 29])
    np.testing.assert_allclose(line(axes, "10 % RH, mean"), [(15, 26), (20, 27), (25, 28)])
    assert bands(axes) == [(20, 30)]
    low, high = axes.get_ylim()
    assert 0 <= low < 20 and high > 30


def test_force_laws(tmp_path, shown):
    """Of the calibration, and of another one that the settings tell."""
    rows = make_rows("grasp") + make_rows("release")
    draw_figures(rows, {}, tmp_path)
    other = {"calibration": {"WORK_TOOL_OBJECT": 2e-3, "CONTACT_GAP": 0.3e-6}}
    laws = {name: line(axes[0], "force laws, no dynamics") for name, axes in shown.items()}
    radius = laws["grasp_voltage"][:, 0] * 1e-6
    assert radius[0] == pytest.approx(15e-6) and radius[-1] == pytest.approx(25e-6)
    np.testing.assert_allclose(laws["grasp_voltage"][:, 1], grasp_voltage(radius))
    np.testing.assert_allclose(laws["release_voltage"][:, 1], release_voltage(radius))
    draw_figures(rows, other, tmp_path)
    laws = {name: line(axes[0], "force laws, no dynamics")[:, 1] for name, axes in shown.items()}
    np.testing.assert_allclose(laws["grasp_voltage"], grasp_voltage(radius, 2e-3, gap=0.3e-6))
    np.testing.assert_allclose(laws["release_voltage"], release_voltage(radius, 2e-3))


def test_humidities_and_gaps_have_lines_and_figures_of_their_own(tmp_path, shown):
    rows = make_rows("grasp", (10.0, 50.0)) + make_rows("release")
    rows += [make_row("release", gap=3e-6, radius=radius) for radius in RADII]
    rows.append(make_row(voltage=1.0, faulty=True, radius=15e-6))
    draw_figures(rows, {}, tmp_path)
    assert set(shown) == {"grasp_voltage", "grasp_voltage_humidity", "release_voltage", "release_voltage_3um"}
    (near,), (dry,), (both,) = (shown[n] for n in ("release_voltage_3um", "grasp_voltage", "grasp_voltage_humidity"))
    assert [bands(axes) for axes in (near, dry, both)] == [[], [(20, 30)], [(20, 30)]]
    means = [[line.get_label() for line in axes.lines if "mean" in line.get_label()] for axes in (dry, both)]
    assert means == [["10 % RH, mean"], ["10 % RH, mean", "50 % RH, mean"]]
    radius, voltage = [line.get_xydata() for line in both.lines if "force laws" in line.get_label()][1].T
    works = humidity_factor(50.0) * WORK_TOOL_OBJECT, humidity_factor(50.0) * WORK_OBJECT_SUBSTRATE
    np.testing.assert_allclose(voltage, grasp_voltage(1e-6 * radius, *works))
    radius, voltage = line(near, "force laws, no dynamics").T
    np.testing.assert_allclose(voltage, release_voltage(1e-6 * radius, gap=3e-6))
    assert "n = 2 trials at each radius and humidity" in caption(dry) and "1 faulty trials are left out" in caption(dry)


def test_release(tmp_path, shown):
    """Of landings 3, 2 and 1 times as long and 1, 2 and 3 times as fast as usual."""
    rows = [
        make_row("release", voltage=40.0 + k, flight_time=k * 0.18e-3, landing_speed=(4 - k) * 0.14) for k in (3, 2, 1)
    ]
    rows.append(make_row("release", voltage=50.0, landed=False, flight_time=None, landing_speed=None))
    rows.append(make_row("release", voltage=1e9, faulty=True))
    draw_figures(rows, {}, tmp_path)
    (axes,) = shown["release_voltage"]
    assert bands(axes) == [(37, 47)] and axes.get_title() == "Release voltage at 10 % RH, gap 5 µm"
    np.testing.assert_allclose(line(axes, "10 % RH, mean"), [(20, 44)])
    assert "3 of 4 released balls landed; medians: flight 0.36 ms, landing at 0.28 m/s." in caption(axes)


def test_voltages_that_were_not_found(tmp_path, shown):
    """They stand at the limit, and a mean without them would be too low; one that melts its ball is marked."""
    rows = [make_row(), make_row(repeat=1, voltage=None), make_row(radius=25e-6, voltage=None)]
    rows.append(make_row(radius=15e-6, voltage=75.0, melted=True))
    draw_figures(rows, {}, tmp_path)
    (axes,) = shown["grasp_voltage"]
    np.testing.assert_allclose(line(axes, "not up to this voltage"), [(20, 80), (25, 80)])
    np.testing.assert_allclose(line(axes, "melted"), [(15, 75)])
    np.testing.assert_allclose(line(axes, "10 % RH, mean"), [(15, 75)])


def test_attempts_without_contact(tmp_path, shown):
    rows = [make_row("no_contact", gap=gap, radius=radius) for gap in (1e-6, 3e-6) for radius in RADII]
    rows.append(make_row("no_contact", gap=0.3e-6, voltage=40.0, limit_voltage=60.0))
    draw_figures(rows, {}, tmp_path)
    (axes,) = shown["no_contact"]
    assert bands(axes) == [(0, 50)] and axes.get_ylim() == (0, 120)
    np.testing.assert_allclose(line(axes, "lifted (1)"), [(0.3, 40)])
    np.testing.assert_allclose(line(axes, "not lifted up to here (6)"), [(1, 50)] * 3 + [(3, 50)] * 3)
    law = line(axes, "force laws, 10 % RH")
    gap = law[50, 0] * 1e-6
    expected = min(grasp_voltage(radius, 0.0, gap=gap) for radius in np.linspace(15e-6, 25e-6, 41))
    assert law[50, 1] == pytest.approx(expected, rel=1e-3)
