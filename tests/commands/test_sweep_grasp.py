"""`iswarm sweep grasp`: rows are those of single runs of the bench, for each radius and humidity."""

from pathlib import Path

import numpy as np
import pyarrow.csv
import pytest
from support.cli import code_of

from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.workflows import grasp
from iswarm_mj.workflows.grasp import run_grasp
from iswarm_mj.workflows.grasp_settings import GraspSettings

TIP = Path(__file__).parents[2] / "examples/best-tip/tip.json"
FAST = ["--threads=1", "--repeats=1", "--no-contact-gap=2e-6", "--protocol.step-voltage=2"]


def read_rows():
    """Return the rows of the table of the sweep, as dicts."""
    return pyarrow.csv.read_csv("runs/sweep/sweep.csv").to_pylist()


@pytest.mark.slow
def test_each_row_is_a_radius_and_humidity_of_a_single_run(here, capfd):
    over = ["--over", "probe-radius=8e-6:20e-6:2", "ball-material=gold"]
    places = ["--radius", "15e-6", "20e-6", "--rh", "10", "50", "--gap", "3e-6"]
    assert code_of("sweep", "grasp", *FAST, *places, *over) == 0
    printed = capfd.readouterr().out.splitlines()
    assert len(printed) == 1 + 2 * 2 * 2 + 2
    assert "release at 3 um [V]" in printed[0]

    rows = read_rows()
    assert len(rows) == 2 * 4 * 3  # variants, places, and grasp, release, no contact
    for kind in (".png", ".svg"):
        assert (here / "runs/sweep/sweep").with_suffix(kind).stat().st_size > 0

    settings = GraspSettings(
        radius=("15e-6", "20e-6"),
        rh=(10.0, 50.0),
        repeats=1,
        gap=(3e-6,),
        no_contact_gap=(2e-6,),
        probe_radius=20e-6,
        ball_material="gold",
        threads=1,
        protocol=Protocol(step_voltage=2.0),
    )
    single = {
        (row.experiment, row.gap, row.radius, row.relative_humidity): row.voltage
        for row in run_grasp(settings)
    }
    names = ("experiment", "at_gap", "ball_radius", "relative_humidity")
    swept = {
        tuple(row[name] for name in names): row["mean_voltage"]
        for row in rows
        if (row["probe_radius"], row["ball_material"]) == (20e-6, "gold")
    }
    assert swept == single

    assert code_of("inspect", "runs/sweep") == 0
    assert printed[1] in capfd.readouterr().out.splitlines()


@pytest.mark.slow
def test_tips_gaps_and_radii_may_vary_and_finished_runs_are_kept(here, monkeypatch):
    over = ["--over", f"tip={TIP}", "radius=15e-6", "gap=3e-6,5e-6"]
    command = ["sweep", "grasp", *FAST, "--rh=10", *over]
    assert code_of(*command) == 0
    rows = read_rows()
    releases = [row for row in rows if row["experiment"] == "release"]
    assert [row["at_gap"] for row in releases] == [3e-6, 5e-6]
    assert [row["radius"] for row in releases] == [15e-6] * 2
    assert all(row["radius"] == row["ball_radius"] for row in rows)
    assert all(row["gap"] == row["at_gap"] for row in releases)
    assert np.all([row["tip"] == str(TIP) for row in rows])

    def refuse(*arguments):
        raise AssertionError("a finished run was repeated")

    monkeypatch.setattr(grasp, "run_grasp", refuse)
    assert code_of(*command) == 0
    assert read_rows() == rows


def test_what_is_not_lifted_has_no_voltage(here, capfd):
    over = ["--over", "protocol.grasp-limit=10"]
    assert code_of("sweep", "grasp", *FAST, "--radius=20e-6", "--rh=10", *over) == 0
    lines = [line.split() for line in capfd.readouterr().out.splitlines()]
    assert lines[1] == ["10", "20", "10", "-", "0", "of", "1"]


@pytest.mark.parametrize(
    "flags, sentence",
    [
        (["--over", "rh=10,200"], "--rh must be between 0 and 100 % (got 200.0)"),
        (["--over", "probe-radius=8e-6,1"], "--probe-radius must be"),
        (["--over", "probe-radius=8e-6:9e-6:0"], "--over must be"),
        (["--over", "rh=10,20", "--record=3"], "--record has no effect on the runs of a sweep"),
        (["--over", "force-curve=True,False"], "--force-curve has no effect on the runs"),
        (["--over", f"tip={TIP}", "probe-radius=8e-6,9e-6"], "--probe-radius must be left out"),
    ],
)
def test_bad_values_are_refused_before_the_first_run(here, capfd, flags, sentence):
    assert code_of("sweep", "grasp", *flags) == 2
    error = capfd.readouterr().err
    assert error.startswith(f"iswarm: {sentence}")
    assert error.count("\n") == 1
    assert not (here / "runs").exists()
