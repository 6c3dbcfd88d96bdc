"""Materials and tips of the bench: their effects, and how a run reports and repeats them."""

import json
import re
from contextlib import redirect_stdout
from pathlib import Path
from typing import get_args

import numpy as np
import pyarrow.parquet
import pytest
from support.cli import code_of

import iswarm_mj
from iswarm_mj.config.swarm import GripperConfig
from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.gripper.laws import detachment, materials
from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage
from iswarm_mj.gripper.laws.roughness import Surface, effective_work
from iswarm_mj.tasks.layout import balls_on_floor
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.workflows.grasp_settings import EffectiveProperties, GraspSettings, cases
from iswarm_mj.workflows.grasp_summary import summary

TIP = Path(__file__).parents[2] / "examples/best-tip/tip.json"

SMALL = {"radius": ("20e-6",), "rh": (10.0,), "repeats": 2, "rh_spread": 0.0}
"""Settings of two trials."""


def test_contacts_and_surfaces_that_the_fit_did_not_have_are_named():
    settings = GraspSettings(
        contacts=Contacts(oxide=50e-9),
        tool=Surface(roughness=2e-9),
        plate=Surface(preload=1e-6),
    )
    assert settings.beyond_the_fit == [
        "contacts.oxide 5e-08",
        "tool.roughness 2e-09",
        "plate.preload 1e-06",
    ]


OWN_WORKS = {"work_tool_object": 1.33e-3, "work_object_substrate": 18e-3}
"""Works as a fit.toml has them."""


def test_works_of_ones_own_are_no_prediction_of_the_papers_fit():
    """A tip's forces and the law of humidity still are."""
    settings = GraspSettings(
        **OWN_WORKS,
        radius=("12e-6",),
        spread_tool_object=0.1,
        electrical_gap=0.1e-6,
        probe_radius=20e-6,
        contacts=Contacts(oxide=50e-9),
    )
    assert settings.beyond_the_fit == []
    assert settings.own_values == [
        "work_tool_object 0.00133",
        "work_object_substrate 0.018",
        "spread_tool_object 0.1",
        "electrical_gap 1e-07",
        "probe_radius 2e-05",
        "contacts.oxide 5e-08",
    ]
    assert "beyond_the_fit" not in settings.metadata()
    assert dict(summary(settings, []))["own values"].endswith(", ".join(settings.own_values))

    elsewhere = GraspSettings(**OWN_WORKS, rh=(95.0,), tip=TIP)
    assert elsewhere.beyond_the_fit == ["rh 95 to 95 %, not 5 to 90", f"tip {TIP}"]
    assert len(elsewhere.own_values) == 2


def test_one_work_of_ones_own_leaves_the_other_to_the_papers_fit():
    settings = GraspSettings(work_tool_object=2e-3)
    assert settings.beyond_the_fit == ["work_tool_object 0.002"]
    assert settings.own_values == []


def test_each_name_is_a_material():
    assert get_args(materials.Name) == tuple(materials.MATERIALS)


def test_the_default_materials_are_the_fitted_ones():
    contacts = Contacts()
    assert GraspSettings().beyond_the_fit == []
    assert GraspSettings().effective == EffectiveProperties(
        detachment.WORK_TOOL_OBJECT,
        detachment.WORK_OBJECT_SUBSTRATE,
        detachment.BALL_DENSITY,
        contacts,
    )

    solder = materials.MATERIALS[materials.BALL]
    aluminium = materials.MATERIALS[materials.TOOL]
    steel = materials.MATERIALS[materials.PLATE]
    plate_modulus = materials.reduced_modulus(solder, steel)
    probe_modulus = materials.reduced_modulus(solder, aluminium)
    assert plate_modulus == pytest.approx(contacts.plate_modulus, rel=5e-3)
    assert probe_modulus == pytest.approx(contacts.probe_modulus, rel=5e-3)
    assert aluminium.breakdown == contacts.breakdown
    assert solder.yield_pressure == contacts.yield_pressure


def test_works_go_with_the_geometric_mean_of_the_surface_energies():
    """Tin has 0.71 J/m^2, copper 1.79; a plate of a quarter of steel's 2.42 holds half as well."""
    used = GraspSettings(ball_material="copper", plate_material="0.605", **SMALL).effective
    ratio = np.sqrt(1.79 / 0.71)
    assert used.work_tool_object == pytest.approx(1.41e-3 * ratio)
    assert used.work_object_substrate == pytest.approx(14.7e-3 * ratio / 2)
    assert used.ball_density == 8960
    stiffness = (1 - 0.34**2) / 130e9 + (1 - 0.29**2) / 200e9
    assert used.contacts.plate_modulus == pytest.approx(1 / stiffness)


def test_numbers_that_are_given_win():
    settings = GraspSettings(
        ball_material="copper",
        tool_material="silicon",
        work_tool_object=2e-3,
        ball_density=5000.0,
        contacts=Contacts(yield_pressure=9e6, breakdown=2e9),
        **SMALL,
    )
    used = settings.effective
    assert used.work_tool_object == 2e-3
    assert used.ball_density == 5000.0
    assert used.contacts.yield_pressure == 9e6
    assert used.contacts.breakdown == 2e9
    assert used.work_object_substrate == pytest.approx(14.7e-3 * np.sqrt(1.79 / 0.71))


def works_with(**surfaces):
    """Return the works of adhesion of tool and plate with these surfaces."""
    trial = cases(GraspSettings(**surfaces, **SMALL))[0].trial
    return trial.work_tool_object, trial.work_object_substrate


def test_each_contact_has_a_surface_of_its_own():
    rough = Surface(1e-9, 0.25e-6)
    tool, plate = works_with()
    rough_tool = float(effective_work(tool, 20e-6, rough))
    rough_plate = float(effective_work(plate, 20e-6, rough))
    assert rough_tool < tool
    assert works_with(tool=rough) == (rough_tool, plate)
    assert works_with(plate=rough) == (tool, rough_plate)


@pytest.mark.parametrize("name", ["gould", "-1", "nan"])
def test_unknown_materials_are_refused(name):
    with pytest.raises(ConfigError, match="tool_material must be solder, gold"):
        GraspSettings(tool_material=name)


def test_a_round_tip_takes_the_voltages_of_the_laws():
    """A tip as round as the ball has half the adhesion and twice the gap, as two spheres have."""
    settings = GraspSettings(tip_curvature=20e-6, **SMALL)
    flat_cases = cases(GraspSettings(**SMALL))
    rows = iswarm_mj.run_grasp(settings)
    assert {row.experiment for row in rows} == {"grasp", "release"}

    for case in cases(settings):
        row_of = {row.experiment: row for row in rows if row.repeat == case.repeat}
        flat = flat_cases[case.repeat].trial
        tool = flat.work_tool_object / 2
        lift = grasp_voltage(20e-6, tool, flat.work_object_substrate, 2 * detachment.CONTACT_GAP)
        assert row_of["grasp"].voltage == pytest.approx(lift, abs=0.4)
        assert row_of["release"].voltage == pytest.approx(release_voltage(20e-6, tool), rel=0.06)


BEYOND_THE_FIT = [
    "--radius=12e-6",
    "--rh=10",
    "--repeats=1",
    "--plate-material=silica",
    "--tool.roughness=1e-9",
    "--contacts.oxide=6e-8",
    "--protocol.hold-time=0.002",
    "--no-contact-gap=2e-6",
    "--record",
]
"""Flags of a trial unlike those of the fit."""


class TestRun:
    """A run beyond the fit."""

    @pytest.fixture(scope="class")
    @classmethod
    def here(cls, tmp_path_factory):
        """Directory in which the run is, with its output in `run.txt`."""
        here = tmp_path_factory.mktemp("run")
        with pytest.MonkeyPatch.context() as patch, (here / "run.txt").open("w") as file:
            patch.chdir(here)
            with redirect_stdout(file):
                assert code_of("grasp", *BEYOND_THE_FIT, "--out=one") == 0
        return here

    def test_warns_of_what_is_not_as_in_the_fit(self, here):
        output = (here / "run.txt").read_text()
        assert "warning" in output
        assert "radius 12 to 12 um, not 15 to 25, plate_material silica" in output
        result = json.loads((here / "one/result.json").read_text())
        assert len(result["beyond_the_fit"]) == 4
        trials = {measure["experiment"]: measure["trials"] for measure in result["measures"]}
        assert trials["grasp"] == 1

    def test_states_the_properties_of_its_materials(self, here):
        """Steel of the plate has 2.42 J/m^2, silica 0.26."""
        effective = json.loads((here / "one/result.json").read_text())["effective"]
        assert effective["work_tool_object"] == pytest.approx(1.41e-3)
        assert effective["work_object_substrate"] == pytest.approx(14.7e-3 * np.sqrt(0.26 / 2.42))
        assert effective["ball_density"] == 7400
        assert effective["contacts"]["yield_pressure"] == 64e6
        assert effective["contacts"]["oxide"] == 6e-8
        assert "(tool) and 4.82 mJ/m^2 (plate)" in (here / "run.txt").read_text()

    def test_is_repeated_from_its_result(self, here, monkeypatch):
        monkeypatch.chdir(here)
        assert code_of("grasp", "--config=one/result.json", "--out=two") == 0
        table = (here / "one/trials.csv").read_text()
        assert len(table.splitlines()) == 4
        assert (here / "two/trials.csv").read_text() == table

    def test_has_units_in_its_table(self, here):
        schema = pyarrow.parquet.read_schema(here / "one/trials.parquet")
        units = {field.name: field.metadata[b"unit"].decode() for field in schema}
        assert units["voltage"] == "V"
        assert units["work_tool_object"] == "J/m^2"
        assert units["experiment"] == ""

    def test_is_inspected(self, here, monkeypatch, capfd):
        monkeypatch.chdir(here)
        assert code_of("inspect", "one") == 0
        output = capfd.readouterr().out
        assert output.startswith("trials: 1 trials in 3 rows")
        assert re.search(r"^ *12 +10 .* [01] of 1 ", output, re.MULTILINE)
        assert "iswarm grasp --config one/result.json" in output


def test_spreads_humidity_and_electrical_gap_are_those_of_the_settings():
    narrow = GraspSettings(
        spread_tool_object=0.01,
        spread_object_substrate=0.3,
        electrical_gap=0.3e-6,
        **{**SMALL, "repeats": 200, "rh_spread": 0.0},
    )
    trials = [case.trial for case in cases(narrow)]
    logarithms = np.log([trial.work_tool_object for trial in trials])
    assert np.std(logarithms) == pytest.approx(0.01, rel=0.15)
    logarithms = np.log([trial.work_object_substrate for trial in trials])
    assert np.std(logarithms) == pytest.approx(np.sqrt(np.log1p(0.3**2)), rel=0.15)
    assert trials[0].contact_gap == 0.3e-6
    assert "electrical_gap 3e-07" in narrow.beyond_the_fit

    # The bench multiplies works by the default law of humidity.
    usual, growing = (
        cases(GraspSettings(rh=(45.0,), rh_spread=0.0, humidity_doubling=doubling))[0].trial
        for doubling in (70.0, 35.0)
    )
    ratio = growing.work_object_substrate / usual.work_object_substrate
    assert ratio == pytest.approx(2.0 / 1.5)


def test_swarms_have_the_humidity_of_their_settings():
    growing = GripperConfig(relative_humidity=45.0, humidity_doubling=35.0)
    balls = balls_on_floor(growing, np.zeros((1, 2)), np.full(1, 20e-6))
    assert balls.work_object_substrate == pytest.approx(2 * growing.work_object_substrate)
