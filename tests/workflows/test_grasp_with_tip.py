"""Trials of the bench with the table of a tip."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.cli import code_of, refused, result

from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.output.trial_laws import Laws
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.workflows.grasp import quasi_static_grasp, quasi_static_release, run_grasp
from iswarm_mj.workflows.grasp_settings import GraspSettings

TIP = Path(__file__).parents[2] / "examples/best-tip/tip.json"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_trials_follow_the_tips_laws():
    settings = GraspSettings(
        radius=("20e-6",), rh=(10.0,), repeats=2, tip=TIP, no_contact_gap=(2e-6,), threads=1
    )
    rows = run_grasp(settings)
    tip = read_table(TIP)
    for row in rows:
        if row.experiment == "no_contact":
            assert row.voltage is None
            continue
        assert row.voltage == pytest.approx(row.quasi_static_voltage, rel=0.03)
        work_tool = row.work_tool_object
        if row.experiment == "grasp":
            law = tip.grasp_voltage(20e-6, work_tool, row.work_object_substrate, 0.2e-6)
        else:
            law = tip.release_voltage(20e-6, work_tool, 5e-6)
        assert row.quasi_static_voltage == pytest.approx(law)


@pytest.mark.parametrize("tip", [None, str(TIP)])
def test_laws_of_a_trial_take_the_density_of_its_ball(tip):
    """Without adhesion the square of the voltage of a grasp is in proportion to the weight."""
    light = Trial(20e-6, 1e-3, 0.0, tip=tip, density=5e3)
    heavy = light._replace(density=20e3)
    grasps = [quasi_static_grasp(each, 0.0, 0.0, 0.2e-6) for each in (light, heavy)]
    assert grasps[1] == pytest.approx(2 * grasps[0])
    releases = [quasi_static_release(each, 1e-3, 5e-6) for each in (light, heavy)]
    assert releases[1] < releases[0]


def test_a_tip_lowers_the_adhesion_by_its_share():
    settings = GraspSettings(radius=("20e-6",), rh=(10.0,), repeats=1, tip=TIP, threads=1)
    flat = GraspSettings(radius=("20e-6",), rh=(10.0,), repeats=1, threads=1)
    with_tip, without = (run_grasp(each)[-1].work_tool_object for each in (settings, flat))
    assert with_tip / without == pytest.approx(read_table(TIP).adhesion_share(20e-6))


@pytest.mark.slow
def test_the_command_names_the_tip_and_repeats(here, capfd):
    run = ["--radius=20e-6", "--rh=10", "--repeats=1", "--threads=1", "--protocol.step-voltage=2"]
    assert code_of("grasp", f"--tip={TIP}", *run, "--out=out") == 0
    assert f"beyond the fit, so that voltages are predictions: tip {TIP}" in capfd.readouterr().out
    assert (here / "out/trial-0000.rrd").exists()
    assert result("out")["grasp"]["tip"] == str(TIP)
    assert code_of("grasp", "--config=out/result.json", "--record", "--out=again") == 0
    assert json.dumps(result("again")["measures"]) == json.dumps(result("out")["measures"])


def test_force_curves_take_a_tip():
    run = ["--force-curve", "--radius=20e-6", "--rh=10", "--voltages", "0"]
    assert code_of("grasp", *run, "--out=flat") == 0
    assert code_of("grasp", *run, f"--tip={TIP}", "--out=tip") == 0
    flat, tip = (result(name)["measures"][0]["pull_off"] for name in ("flat", "tip"))
    assert tip / flat == pytest.approx(read_table(TIP).adhesion_share(20e-6), rel=0.05)


def test_the_figures_lines_are_those_of_the_tip():
    laws = Laws({"tip": str(TIP)})
    assert laws.release_voltage_of(20e-6, 10.0) < 32 < Laws({}).release_voltage_of(20e-6, 10.0)
    assert laws.grasp_voltage_of(np.array([15e-6, 20e-6]), 10.0).shape == (2,)


@pytest.mark.parametrize("name", ["tip_curvature", "probe_radius"])
def test_a_tip_has_a_shape_of_its_own(name):
    with pytest.raises(ConfigError, match="left out with a `tip`"):
        GraspSettings(tip=TIP, **{name: 30e-6})


def test_a_file_that_is_no_table_is_refused(here, capfd):
    (here / "a.json").write_text("{}")
    assert "is no table of a tip" in refused(capfd, here, "grasp", "--tip=a.json", "--out=out")
    assert "a.json" not in refused(capfd, here, "grasp", "--tip=b.json", "--out=out")
