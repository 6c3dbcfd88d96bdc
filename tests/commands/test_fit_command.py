"""The command `iswarm fit`: what it prints and writes, and commands that take its fit.toml."""

import tomllib
from pathlib import Path

import pytest
from support.cli import code_of, refused, result

from iswarm_mj.commands.main import parse
from iswarm_mj.gripper.fitting.fit import fit
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import read_table
from iswarm_mj.workflows.fit import settings_text, swarm_warnings, trial_settings
from iswarm_mj.workflows.grasp import TABLE

MINE = """radius [um],humidity [%RH],voltage [V]
15,10,24
20,10,27
25,10,31
20,40,33
20,60,38
"""
"""Five grasps of another laboratory."""
FILES = {
    "fit.toml",
    "result.json",
    "fit_data.png",
    "fit_data.svg",
    "fit_profiles.png",
    "fit_profiles.svg",
}


@pytest.fixture
def mine(here):
    """Return the path of a table in the working directory."""
    path = here / "mine.csv"
    path.write_text(MINE)
    return path


def test_a_table_becomes_settings_figures_and_sentences(mine, capfd):
    arguments = ("--radius", "20e-6", "--rh", "10", "--out", "out")
    assert code_of("fit", mine.name, *arguments) == 0
    printed = capfd.readouterr().out
    assert "Only W_plate - W_tool is determined, 16." in printed
    assert "One release voltage" in printed
    assert "release, 20 um, 10 % RH, gap 5 um" in printed
    assert {path.name for path in Path("out").iterdir()} == FILES

    content = result("out")["fit"]
    parameters = content["parameters"]
    assert not parameters["work_tool_object"]["is_determined"]
    assert not parameters["electrical_gap"]["is_estimated"]
    assert content["difference_of_works"]["is_determined"]
    assert [entry["kind"] for entry in content["predictions"]] == ["grasp", "release"]
    assert len(content["residuals"]) == 5
    settings = tomllib.loads(Path("out/fit.toml").read_text())
    text = Path("out/fit.toml").read_text()
    assert "# Values are in SI units: works in J/m^2" in text
    assert "  # not determined: 0.155 to 21.3 mJ/m^2\n" in text
    assert "  # determined roughly: 14.5 to 37.7 mJ/m^2\n" in text
    value = parameters["work_tool_object"]["value"]
    assert settings["grasp"]["work_tool_object"] == pytest.approx(value, rel=1e-5)
    assert settings["gripper"]["work_tool_object"] == pytest.approx(value, rel=1e-5)


@pytest.mark.slow
def test_the_bench_and_swarms_take_its_settings(mine):
    assert code_of("fit", mine.name, "--hold", "electrical_gap=1e-7", "--out", "out") == 0
    works = tomllib.loads(Path("out/fit.toml").read_text())["grasp"]

    grasp = parse(["grasp", "--config", "out/fit.toml"])
    swarm = parse(["clean", "--config", "out/fit.toml"]).gripper
    for name in ("work_object_substrate", "spread_object_substrate", "humidity_doubling"):
        assert getattr(grasp, name) == getattr(swarm, name) == works[name]
    with pytest.raises(UserError, match=r"is of iswarm fit; name the fit.toml beside it"):
        parse(["grasp", "--config", "out/result.json"])
    page = parse(["play", "--config", "out/fit.toml"]).gripper
    assert page == swarm
    assert grasp.electrical_gap == 1e-7

    # The voltages of trials are those that the fit predicts.
    few = ["--radius=20e-6", "--rh=10", "--repeats=12", "--threads=1", "--record", "--out=trials"]
    assert code_of("grasp", "--config", "out/fit.toml", "--no-contact-gap", *few) == 0
    rows, metadata = read_table(Path("trials") / TABLE)
    voltages = sorted(row["voltage"] for row in rows if row["experiment"] == "grasp")
    assert 0.5 * (voltages[5] + voltages[6]) == pytest.approx(27.7, abs=1.5)
    assert metadata["calibration"]["CONTACT_GAP"] == 1e-7


@pytest.mark.slow
def test_the_example_is_the_papers_table(here, capfd):
    assert code_of("fit", "--out", "out") == 0
    assert "6 rows of example" in capfd.readouterr().out
    works = result("out")["fit"]["parameters"]
    assert works["work_tool_object"]["value"] == pytest.approx(1.41e-3, rel=0.03)


@pytest.mark.slow
def test_trials_of_the_bench_confirm_predictions(mine, capfd):
    prior = "work_tool_object=1.41e-3:1.01"
    few = ["--trials", "4", "--radius", "20e-6", "--rh", "10", "--out", "out"]
    assert code_of("fit", mine.name, "--prior", prior, *few) == 0
    assert "trials of the bench, grasp, 20 um, 10 % RH: median" in capfd.readouterr().out
    content = result("out")["fit"]
    for prediction, trials in zip(content["predictions"], content["trials"], strict=True):
        assert trials["with_voltage"] == trials["trials"] == 4
        low, high = prediction["balls_low"], prediction["balls_high"]
        assert low < trials["median"] < high


def test_trials_have_the_roughness_and_the_oxide_of_the_fit():
    table = {
        "kind": ["grasp", "grasp", "melting", "melting"],
        "radius [um]": [20, 20, 20, 20],
        "humidity [%]": [10, 10, 10, 10],
        "voltage [V]": [24, 26, 50, 51],
    }
    fitted = fit(table, hold={"plate_roughness": 2e-9, "tool_roughness": 1e-9})
    settings = trial_settings(fitted, 20e-6, 10.0, gaps=(5e-6,), n_trials=2)
    assert settings.plate.roughness == 2e-9
    assert settings.tool.roughness == 1e-9
    assert settings.contacts.oxide == pytest.approx(50e-9, rel=0.05)


@pytest.mark.slow
def test_free_parameters_may_have_hyphens(mine):
    few = ["--radius", "20e-6", "--rh", "10", "--out", "out"]
    assert code_of("fit", mine.name, "--free", "humidity-doubling", *few) == 0
    assert result("out")["fit"]["parameters"]["humidity_doubling"]["is_estimated"]


def test_works_that_mean_other_voltages_in_swarms_have_a_warning(mine):
    fitted = fit(mine, hold={"electrical_gap": 1e-7, "plate_roughness": 2e-9})
    (warning,) = swarm_warnings(fitted)
    assert "electrical_gap 1e-07 (swarms: 2e-07), plate.roughness 2e-09 (swarms: 0)" in warning
    assert f"# {warning}\n[gripper]" in settings_text(fitted, "mine.csv")

    # The swarm's own gap, tip and balls.
    assert swarm_warnings(fit(mine)) == []


@pytest.mark.slow
def test_a_rounded_tip_is_that_of_trials_and_settings(here, capfd):
    header, *rows = MINE.splitlines()
    lines = [f"{header},tip_curvature [um]", *(f"{row},30" for row in rows)]
    (here / "round.csv").write_text("\n".join(lines))
    few = ["--trials", "2", "--radius", "20e-6", "--rh", "10", "--out", "out"]
    assert code_of("fit", "round.csv", "--prior", "work_tool_object=1.41e-3:1.01", *few) == 0
    assert "trials of the bench, grasp, 20 um, 10 % RH: median 2" in capfd.readouterr().out
    assert parse(["grasp", "--config", "out/fit.toml"]).tip_curvature == 30e-6


@pytest.mark.slow
def test_a_fit_replaces_an_earlier_one_and_is_inspected(mine, capfd):
    for _ in range(2):
        assert code_of("fit", mine.name, "--out", "out") == 0
    capfd.readouterr()
    assert code_of("inspect", "out") == 0
    assert "W_plate - W_tool" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["none.csv"], "none.csv cannot be read"),
        (["mine.csv", "--units", "radius"], "--units must be NAME=VALUE (got 'radius')"),
        (["mine.csv", "--hold", "electrical_gap=wide"], "--hold must be a number in SI (got"),
        (["mine.csv", "--free", "gapp"], "--free names gapp, but parameters are"),
        (["mine.csv", "--prior", "electrical_gap=1e-7"], "--prior must be NAME=MEDIAN:FACTOR"),
        (
            ["mine.csv", "--hold", "electrical_gap=1e-7", "electrical_gap=2e-7"],
            "--hold names a parameter twice",
        ),
        (["mine.csv", "--radius", "5e-6", "--gap", "30e-6"], "and at most 4 times the radius"),
        (["mine.csv", "--radius", "5e-6", "--trials", "2"], "--radius must be radii from 10e-6"),
        (["mine.csv", "--rh", "110"], "--rh must be between 0 and 100 %"),
    ],
)
def test_bad_input_is_refused(mine, here, capfd, arguments, sentence):
    assert sentence in refused(capfd, here, "fit", *arguments)


def test_the_table_grasp_is_for_the_bench_alone(here):
    (here / "both.toml").write_text("steps = 7\n[grasp]\nrepeats = 3\n")
    assert parse(["clean", "--config", "both.toml"]).steps == 7
    assert parse(["grasp", "--config", "both.toml"]).repeats == 3
