"""The command `iswarm grasp`: what it writes, what it refuses."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from rerun.chunk import RrdReader
from support.cli import code_of
from support.rrd import read

from iswarm_mj.utils.tables import read_table
from iswarm_mj.workflows.grasp import CURVES, TABLE

FAST = ["--protocol.step-voltage=2", "--threads=1"]
COLUMNS = """
    experiment radius relative_humidity trial_humidity repeat seed work_tool_object work_object_substrate gap
    voltage limit_voltage step_voltage melted flight_time landing_speed landed transport off_target quasi_static_voltage
    faulty
"""


def from_path(directory):
    return read_table(Path(directory) / TABLE)[0]


def test_writes_table_figures_and_recordings(here, capfd):
    assert (
        code_of(
            "grasp",
            *FAST,
            "--radius",
            "15e-6:25e-6:2",
            "--rh",
            10,
            50,
            "--repeats",
            2,
            "--record",
            5,
            "--gap=8e-6",
        )
        == 0
    )
    out = here / "runs" / "grasp"
    names = {path.name for path in out.iterdir()}
    made = {"trials.csv", "trial-0005.rrd", "grasp_voltage.png", "release_voltage_8um.svg"}
    assert made | {TABLE} <= names
    assert not any(name.startswith(".") for name in names)
    rows, told = read_table(out / TABLE)
    assert set(rows[0]) == set(COLUMNS.split())
    assert [
        sum(r["experiment"] == e for r in rows) for e in ("grasp", "release", "no_contact")
    ] == [8, 8, 24]
    assert sorted({(r["radius"], r["relative_humidity"], r["repeat"]) for r in rows}) == [
        (radius, rh, repeat) for radius in (15e-6, 25e-6) for rh in (10, 50) for repeat in (0, 1)
    ]
    assert (told["seed"], told["protocol"]["step_voltage"], told["calibration"]["CONTACT_GAP"]) == (
        0,
        2,
        0.2e-6,
    )
    with (out / "trials.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(rows)
    recorded = read(out / "trial-0005.rrd")  # of the larger ball at 10 % RH, the second
    kept = recorded["/__properties/settings"]
    lifted = next(
        r["voltage"]
        for r in rows
        if r["radius"] == 25e-6 and r["repeat"] == 1 and r["experiment"] == "grasp"
    )
    wanted = {"trial.radius": 25e-6, "repeat": 1, "grasp_voltage": lifted}
    assert {name: kept[name] for name in wanted} == {
        name: [value] for name, value in wanted.items()
    }
    gaps = [
        r["Scalars:scalars"][0]
        for c in RrdReader(out / "trial-0005.rrd").stream().to_chunks()
        if c.entity_path == "/series/gaps/plate"
        for r in c.to_record_batch().to_pylist()
        if "sim_time" in r
    ]
    assert max(gaps) == pytest.approx(8, abs=0.2)
    said = capfd.readouterr().out
    assert re.search(r"grasp  10 % RH: \d+\.\d V \(.*\), (\d+) of \1 lifted\n", said)
    assert re.search(r"release  10 % RH at [\d.]+ um: .*\), \d+ of \d+ landed and stayed\n", said)


def test_a_ball_that_cannot_be_lifted_replaces_results_of_an_earlier_run(here, capfd):
    (here / "out").mkdir()
    for name in (
        "grasp_voltage_humidity.png",
        "release_voltage_3um.svg",
        "trial-0001.rrd",
        "trial-notes.txt",
    ):
        (here / "out" / name).write_text("old")
    flags = [
        *FAST,
        "--radius",
        "20e-6",
        "--repeats",
        1,
        "--rh",
        10,
        "--record",
        "--protocol.grasp-limit",
        10,
    ]
    assert code_of("grasp", *flags, "--out", "out") == 0
    names = {"trials", "grasp_voltage", "no_contact", "trial-notes", "result"}
    assert {path.stem for path in (here / "out").iterdir()} == names
    rows = {row["experiment"]: row for row in from_path("out")}
    assert set(rows) == {"grasp", "no_contact"} and rows["grasp"]["voltage"] is None
    assert "1 of 1 not up to 10 V" in capfd.readouterr().out


def test_results_that_cannot_be_written(here, capfd):
    flags = [*FAST, "--radius", "20e-6", "--rh", 10, "--repeats", 1, "--record", "--out", "out"]
    (here / "out" / "trials.parquet").mkdir(parents=True)
    assert code_of("grasp", *flags) == 2
    said = "iswarm: out/trials.parquet cannot be written (Is a directory); move it away or choose another --out\n"
    assert capfd.readouterr().err.endswith(said)  # on a slow machine after what was waited for
    assert [path.name for path in (here / "out").iterdir()] == ["trials.parquet"]


def test_force_curves(here):
    assert (
        code_of("grasp", "--force-curve", "--radius", "20e-6", "--voltages", 0, 20, "--out", "out")
        == 0
    )
    names = {path.name for path in (here / "out").iterdir()}
    assert names == {CURVES, "force_curve.csv", "force_curve.png", "force_curve.svg", "result.json"}
    schema = pyarrow.parquet.read_schema(here / "out" / CURVES)
    lengths, forces = ("radius", "tip", "gap"), ("adhesion", "electrostatic", "contact", "total")
    units = {
        "direction": "",
        "voltage": "V",
        **dict.fromkeys(lengths, "m"),
        **dict.fromkeys(forces, "N"),
    }
    assert {field.name: field.metadata[b"unit"].decode() for field in schema} == units
    rows, _ = read_table(here / "out" / CURVES)
    for voltage in (0, 20):
        (approach, down), (retract, up) = (
            np.transpose(
                [
                    (row["total"], row["tip"])
                    for row in rows
                    if (row["voltage"], row["direction"]) == (voltage, direction)
                ]
            )
            for direction in ("approach", "retract")
        )
        for way in (down, up[::-1]):  # servos let the tool sink by a nanometre or two
            np.testing.assert_allclose([way[0], way[-1]], [5e-6, -25e-9], atol=5e-9)
        electrostatic = min(row["electrostatic"] for row in rows if row["voltage"] == voltage)
        pull_off = -2 * np.pi * 20e-6 * 1.41e-3 + electrostatic
        assert retract.min() == pytest.approx(pull_off, rel=0.02)
        assert retract.min() < 0 < approach.max()
        told = next(
            m
            for m in json.loads((here / "out/result.json").read_text())["measures"]
            if m["voltage"] == voltage
        )
        least = min(
            (row for row in rows if row["voltage"] == voltage and row["direction"] == "retract"),
            key=lambda r: r["total"],
        )
        assert told == {
            "radius": 20e-6,
            "voltage": voltage,
            "pull_off": least["total"],
            "gap": least["gap"],
        }
    assert electrostatic < -1e-6
    parts = np.array(
        [[row[name] for name in ("adhesion", "electrostatic", "contact", "total")] for row in rows]
    )
    np.testing.assert_allclose(parts[:, :3].sum(axis=1), parts[:, 3], atol=1e-15)
    assert (parts[:, :2] <= 0).all() and (parts[:, 2] >= 0).all()
