"""Materials and tips of the bench: what they change, what a run says of them, and that result.json
repeats it."""

import json
from typing import get_args

import numpy as np
import pyarrow.parquet
import pytest
from support.cli import code_of, refused

import iswarm_mj
from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.gripper.laws import detachment, materials
from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage
from iswarm_mj.gripper.laws.roughness import Surface, effective_work
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.workflows.grasp_settings import EffectiveProperties, GraspSettings, cases

SMALL = {"radius": ("20e-6",), "rh": (10.0,), "repeats": 2, "rh_spread": 0.0}


def test_each_name_is_a_material():
    assert get_args(materials.Name) == tuple(materials.MATERIALS)


def test_the_default_materials_are_the_fitted_ones():
    used = GraspSettings().effective
    fitted = detachment.WORK_TOOL_OBJECT, detachment.WORK_OBJECT_SUBSTRATE, detachment.BALL_DENSITY
    assert used == EffectiveProperties(*fitted, Contacts()) and GraspSettings().beyond_the_fit == []
    solder, aluminium, steel = (
        materials.MATERIALS[name] for name in (materials.BALL, materials.TOOL, materials.PLATE)
    )
    assert materials.reduced_modulus(solder, steel) == pytest.approx(
        Contacts().plate_modulus, rel=5e-3
    )
    assert materials.reduced_modulus(solder, aluminium) == pytest.approx(
        Contacts().probe_modulus, rel=5e-3
    )
    assert (
        aluminium.breakdown == Contacts().breakdown
        and solder.yield_pressure == Contacts().yield_pressure
    )


def test_works_go_with_the_geometric_mean_of_the_surface_energies():
    """Tin has 0.71 J/m^2, copper 1.79; a plate with 2.42 / 4 instead of those of steel holds half
    as well."""
    used = GraspSettings(ball_material="copper", plate_material="0.605", **SMALL).effective
    ratio = np.sqrt(1.79 / 0.71)
    assert used.work_tool_object == pytest.approx(1.41e-3 * ratio)
    assert used.work_object_substrate == pytest.approx(14.7e-3 * ratio / 2)
    assert used.ball_density == 8960
    stiffness = (1 - 0.34**2) / 130e9 + (1 - 0.29**2) / 200e9
    assert used.contacts.plate_modulus == pytest.approx(1 / stiffness)


def test_numbers_that_are_given_win():
    given = {
        "work_tool_object": 2e-3,
        "ball_density": 5000.0,
        "contacts": Contacts(yield_pressure=9e6, breakdown=2e9),
    }
    used = GraspSettings(
        ball_material="copper", tool_material="silicon", **given, **SMALL
    ).effective
    assert (used.work_tool_object, used.ball_density) == (2e-3, 5000.0)
    assert (used.contacts.yield_pressure, used.contacts.breakdown) == (9e6, 2e9)
    assert used.work_object_substrate == pytest.approx(14.7e-3 * np.sqrt(1.79 / 0.71))


def test_each_contact_has_a_surface_of_its_own():
    rough = Surface(1e-9, 0.25e-6)
    made = [
        cases(GraspSettings(**own, **SMALL))[0].trial
        for own in ({}, {"tool": rough}, {"plate": rough})
    ]
    (tool, plate), *others = (
        (trial.work_tool_object, trial.work_object_substrate) for trial in made
    )
    lower = [float(effective_work(work, 20e-6, rough)) for work in (tool, plate)]
    assert others == [(lower[0], plate), (tool, lower[1])] and lower[0] < tool


@pytest.mark.parametrize("name", ["gould", "-1", "nan"])
def test_what_is_no_material_is_refused(name):
    with pytest.raises(ConfigError, match="tool_material must be solder, gold"):
        GraspSettings(tool_material=name)


def test_a_round_tip_takes_the_voltages_of_the_laws():
    """A tip as round as the ball: half of the adhesion, and twice the gap, as of spheres against a
    plane."""
    settings = GraspSettings(tip_curvature=20e-6, **SMALL)
    rows = iswarm_mj.run_grasp(settings)
    for case in cases(settings):
        here = {row.experiment: row for row in rows if row.repeat == case.repeat}
        usual = cases(GraspSettings(**SMALL))[case.repeat].trial
        tool, plate = usual.work_tool_object / 2, usual.work_object_substrate
        lift = grasp_voltage(20e-6, tool, plate, 2 * detachment.CONTACT_GAP)
        assert here["grasp"].voltage == pytest.approx(lift, abs=0.4)
        assert here["release"].voltage == pytest.approx(release_voltage(20e-6, tool), rel=0.06)
    assert "no_contact" not in {row.experiment for row in rows}


def test_a_run_says_what_is_not_as_in_the_fit_and_result_json_repeats_it(
    tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    flags = [
        "--radius=12e-6",
        "--rh=10",
        "--repeats=1",
        "--plate-material=silica",
        "--tool.roughness=1e-9",
        "--record",
    ]
    flags += ["--contacts.oxide=6e-8", "--protocol.hold-time=0.002", "--no-contact-gap=2e-6"]
    assert code_of("grasp", *flags, "--out=one") == 0
    said = capfd.readouterr().out
    assert "warning" in said and "radius 12 to 12 um, not 15 to 25, plate_material silica" in said
    result = json.loads((tmp_path / "one/result.json").read_text())
    assert len(result["beyond_the_fit"]) == 2
    assert {row["experiment"]: row["trials"] for row in result["measures"]}["grasp"] == 1
    assert code_of("grasp", "--config=one/result.json", "--out=two") == 0
    one, two = (tmp_path / name / "trials.csv" for name in ("one", "two"))
    assert one.read_text() == two.read_text() and len(one.read_text().splitlines()) == 4
    fields = {
        field.name: field.metadata[b"unit"].decode()
        for field in pyarrow.parquet.read_schema("one/trials.parquet")
    }
    assert (
        fields["voltage"] == "V"
        and fields["work_tool_object"] == "J/m^2"
        and fields["experiment"] == ""
    )
    capfd.readouterr()
    assert code_of("inspect", "one") == 0
    said = capfd.readouterr().out
    assert (
        said.startswith("trials: 1 trials in 3 rows")
        and "grasp  10 % RH: " in said
        and "iswarm grasp --config one/result.json" in said
    )
    assert "is of iswarm grasp" in refused(capfd, tmp_path, "clean", "--config=one/result.json")
