"""The command `iswarm grasp`: the files that it writes and the lines that it prints."""

import csv
import io
import json
import re
from contextlib import redirect_stdout

import numpy as np
import pyarrow.parquet
import pytest
from rerun.chunk import RrdReader
from support.cli import code_of
from support.rrd import read

from iswarm_mj.utils.tables import read_table
from iswarm_mj.workflows.grasp import CURVES, TABLE

FAST = ["--protocol.step-voltage=2", "--threads=1"]
ONE_TRIAL = [*FAST, "--radius=20e-6", "--repeats=1", "--rh=10", "--record", "--out=out"]
"""Without a recording."""
PLACE = ("radius", "relative_humidity")
"""Columns by which the voltages of a run are grouped."""
COLUMNS = {
    "experiment",
    "radius",
    "relative_humidity",
    "trial_humidity",
    "repeat",
    "seed",
    "work_tool_object",
    "work_object_substrate",
    "gap",
    "voltage",
    "limit_voltage",
    "step_voltage",
    "melted",
    "flight_time",
    "landing_speed",
    "landed",
    "transport",
    "off_target",
    "quasi_static_voltage",
    "faulty",
}


def names_in(directory):
    """Return the names of the files in a directory."""
    return {path.name for path in directory.iterdir()}


def values_of_entity(recording, entity):
    """Return the values of a recorded series."""
    values = []
    for chunk in RrdReader(recording).stream().to_chunks():
        if chunk.entity_path != entity:
            continue
        rows = chunk.to_record_batch().to_pylist()
        values += [row["Scalars:scalars"][0] for row in rows if "sim_time" in row]
    return values


def test_trials_are_a_table_figures_and_recordings(here, capfd):
    flags = ["--radius=15e-6:25e-6:2", "--rh", 10, 50, "--repeats=2", "--record=5", "--gap=8e-6"]
    assert code_of("grasp", *FAST, *flags) == 0
    out = here / "runs" / "grasp"
    files = {"trials.csv", "trial-0005.rrd", "grasp_voltage.png", "release_voltage_8um.svg", TABLE}
    assert files <= names_in(out)
    assert not any(name.startswith(".") for name in names_in(out))

    # Each trial lifts, releases, and tries three gaps without contact.
    rows, metadata = read_table(out / TABLE)
    assert set(rows[0]) == COLUMNS
    n_rows = {name: 0 for name in ("grasp", "release", "no_contact")}
    for row in rows:
        n_rows[row["experiment"]] += 1
    assert n_rows == {"grasp": 8, "release": 8, "no_contact": 24}
    trials = {(row["radius"], row["relative_humidity"], row["repeat"]) for row in rows}
    radii, humidities = (15e-6, 25e-6), (10, 50)
    assert trials == {(radius, rh, k) for radius in radii for rh in humidities for k in (0, 1)}
    assert (metadata["seed"], metadata["protocol"]["step_voltage"]) == (0, 2)
    assert metadata["calibration"]["CONTACT_GAP"] == 0.2e-6
    with (out / "trials.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(rows)

    # Trial 5 is the second one of the larger ball at 10 % RH.
    (lifting_voltage,) = (
        row["voltage"]
        for row in rows
        if (row["radius"], row["relative_humidity"]) == (25e-6, 10)
        and (row["repeat"], row["experiment"]) == (1, "grasp")
    )
    recording = out / "trial-0005.rrd"
    properties = read(recording)["/__properties/settings"]
    assert properties["trial.radius"] == [25e-6]
    assert properties["repeat"] == [1]
    assert properties["grasp_voltage"] == [lifting_voltage]
    gaps_um = values_of_entity(recording, "/series/gaps/plate")
    assert max(gaps_um) == pytest.approx(8, abs=0.2)

    printed = capfd.readouterr().out
    for radius, humidity in (("15", "10"), ("15", "50"), ("25", "10"), ("25", "50")):
        voltage = r"\d+\.\d \(\d+\.\d-\d+\.\d\)"
        line = rf"^ *{radius} +{humidity} +{voltage}  2 of 2 +{voltage}  [0-2] of 2$"
        assert re.search(line, printed, re.MULTILINE)
    assert "release at 8 um [V]" in printed
    assert "no contact  at 5 um: 0 of 8 lifted up to 50 V\n" in printed
    assert "works of adhesion 1.41 (tool) and 14.7 mJ/m^2 (plate) at 10 % RH" in printed

    # result.json has what each line of the table has.
    measures = json.loads((out / "result.json").read_text())["measures"]
    for measure in measures:
        voltages = [
            row["voltage"]
            for row in rows
            if all(row[name] == measure[name] for name in ("experiment", "gap", *PLACE))
        ]
        assert measure["trials"] == len(voltages) == 2
        if measure["voltage"] is not None:
            assert measure["voltage"]["mean"] == pytest.approx(np.mean(voltages))
    assert {tuple(measure[name] for name in PLACE) for measure in measures} == {
        (radius, rh) for radius in radii for rh in humidities
    }


def test_a_ball_that_cannot_be_lifted_replaces_results_of_an_earlier_run(here, capfd):
    out = here / "out"
    out.mkdir()
    earlier = ["grasp_voltage_humidity.png", "release_voltage_3um.svg", "trial-0001.rrd"]
    for name in (*earlier, "trial-notes.txt"):
        (out / name).write_text("old")
    assert code_of("grasp", *ONE_TRIAL, "--protocol.grasp-limit=10") == 0
    stems = {path.stem for path in out.iterdir()}
    assert stems == {"trials", "grasp_voltage", "no_contact", "trial-notes", "result"}

    rows, _ = read_table(out / TABLE)
    voltages = {row["experiment"]: row["voltage"] for row in rows}
    assert set(voltages) == {"grasp", "no_contact"}
    assert voltages["grasp"] is None
    assert re.search(r"^ *20 +10 +> 10  0 of 1$", capfd.readouterr().out, re.MULTILINE)


def test_results_that_cannot_be_written(here, capfd):
    (here / "out" / "trials.parquet").mkdir(parents=True)
    assert code_of("grasp", *ONE_TRIAL) == 2
    sentence = (
        "iswarm: out/trials.parquet cannot be written (Is a directory); "
        "move it away or choose another --out\n"
    )
    # On a slow machine lines on the progress precede it.
    assert capfd.readouterr().err.endswith(sentence)
    assert names_in(here / "out") == {"trials.parquet"}


RADIUS = 20e-6
VOLTAGES = (0, 20)


@pytest.fixture(scope="module")
def curves(tmp_path_factory):
    """Return the directory of the force-distance curves of a radius at two voltages."""
    here = tmp_path_factory.mktemp("curves")
    flags = ["--force-curve", "--radius", RADIUS, "--voltages", *VOLTAGES]
    with redirect_stdout(io.StringIO()) as printed:
        assert code_of("grasp", *flags, "--out", here / "out") == 0
    (here / "printed.txt").write_text(printed.getvalue())
    return here / "out"


@pytest.fixture(scope="module")
def rows(curves):
    """Return the rows of their table."""
    return read_table(curves / CURVES)[0]


class TestForceCurves:
    def test_files(self, curves):
        figures = {"force_curve.png", "force_curve.svg"}
        assert names_in(curves) == {CURVES, "force_curve.csv", "result.json", *figures}

    def test_columns_have_units(self, curves):
        schema = pyarrow.parquet.read_schema(curves / CURVES)
        lengths = ("radius", "tip", "gap")
        forces = ("adhesion", "electrostatic", "contact", "total")
        assert {field.name: field.metadata[b"unit"].decode() for field in schema} == {
            "direction": "",
            "voltage": "V",
            **dict.fromkeys(lengths, "m"),
            **dict.fromkeys(forces, "N"),
        }

    def curve(self, rows, voltage, direction):
        """Return total force [N] and height of the tip [m] along a way."""
        points = [
            (row["total"], row["tip"])
            for row in rows
            if (row["voltage"], row["direction"]) == (voltage, direction)
        ]
        return np.transpose(points)

    @pytest.mark.parametrize("voltage", VOLTAGES)
    def test_the_tip_goes_down_and_up_again(self, rows, voltage):
        _, down = self.curve(rows, voltage, "approach")
        _, up = self.curve(rows, voltage, "retract")
        # Servos let the tool sink by a nanometre or two.
        np.testing.assert_allclose([down[0], down[-1]], [5e-6, -25e-9], atol=5e-9)
        np.testing.assert_allclose([up[-1], up[0]], [5e-6, -25e-9], atol=5e-9)

    @pytest.mark.parametrize("voltage", VOLTAGES)
    def test_the_pull_off_force_is_that_of_adhesion_and_of_the_voltage(self, rows, voltage):
        """2 pi R W (Derjaguin, Muller, Toporov 1975), and the electrostatic force."""
        approach, _ = self.curve(rows, voltage, "approach")
        retract, _ = self.curve(rows, voltage, "retract")
        electrostatic = min(row["electrostatic"] for row in rows if row["voltage"] == voltage)
        pull_off = -2 * np.pi * RADIUS * 1.41e-3 + electrostatic
        assert retract.min() == pytest.approx(pull_off, rel=0.02)
        assert retract.min() < 0 < approach.max()
        if voltage:
            assert electrostatic < -1e-6

    @pytest.mark.parametrize("voltage", VOLTAGES)
    def test_the_result_states_the_pull_off_force_and_its_gap(self, curves, rows, voltage):
        retract = [
            row for row in rows if (row["voltage"], row["direction"]) == (voltage, "retract")
        ]
        at_pull_off = min(retract, key=lambda row: row["total"])
        measures = json.loads((curves / "result.json").read_text())["measures"]
        (measure,) = (measure for measure in measures if measure["voltage"] == voltage)
        assert measure == {
            "radius": RADIUS,
            "voltage": voltage,
            "pull_off": at_pull_off["total"],
            "gap": at_pull_off["gap"],
        }

    def test_the_pull_off_force_is_printed_and_inspected(self, curves, capfd):
        measures = json.loads((curves / "result.json").read_text())["measures"]
        assert code_of("inspect", curves) == 0
        inspected = capfd.readouterr().out
        for measure in measures:
            force = f"{-1e9 * measure['pull_off']:.0f}"
            line = rf"^ *20 +{measure['voltage']:g} +{force}$"
            for text in ((curves.parent / "printed.txt").read_text(), inspected):
                assert re.search(line, text, re.MULTILINE)

    def test_the_total_is_the_sum_of_its_parts(self, rows):
        adhesion, electrostatic, contact, total = (
            np.array([row[name] for row in rows])
            for name in ("adhesion", "electrostatic", "contact", "total")
        )
        np.testing.assert_allclose(adhesion + electrostatic + contact, total, atol=1e-15)
        assert (adhesion <= 0).all()
        assert (electrostatic <= 0).all()
        assert (contact >= 0).all()


@pytest.mark.parametrize(
    "table, kind, flags",
    [(TABLE, "trials", ["--force-curve"]), (CURVES, "force-distance curves", [])],
)
def test_trials_and_curves_do_not_replace_each_others_result(here, capfd, table, kind, flags):
    out = here / "out"
    out.mkdir()
    for name in (table, "result.json"):
        (out / name).write_text("earlier")
    assert code_of("grasp", *flags, *ONE_TRIAL[-1:]) == 2
    sentence = f"iswarm: --out must be another directory, since this one has {kind}, "
    assert capfd.readouterr().err.startswith(sentence)
    assert (out / "result.json").read_text() == "earlier"
    assert names_in(out) == {table, "result.json"}


def test_trials_and_curves_have_directories_of_their_own_by_default(here):
    """As in README, where one command follows the other."""
    trials = [word for word in ONE_TRIAL if word != "--out=out"]
    assert code_of("grasp", *trials) == 0
    assert code_of("grasp", "--force-curve", "--radius=20e-6", "--voltages=0") == 0
    assert names_in(here / "runs") == {"grasp", "force-curve"}


def test_curves_state_works_of_ones_own_without_a_warning(here, capfd):
    works = ["--work-tool-object=1.3e-3", "--work-object-substrate=18e-3"]
    assert code_of("grasp", "--force-curve", "--radius=20e-6", "--voltages=0", *works) == 0
    printed = capfd.readouterr().out
    assert "  own values  in place of those fitted to the paper: work_tool_object 0.0013" in printed
    assert "warning" not in printed
