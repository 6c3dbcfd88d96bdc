"""What the transition between stiff and soft contacts would change in the judged trials: no
verdict."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.gripper.laws.detachment import (
    CONTACT_GAP,
    PROBE_RADIUS,
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    grasp_voltage,
    release_voltage,
)
from iswarm_mj.paper.analysis.bench_statements import STATEMENTS
from iswarm_mj.utils.tables import read_table

TESTS = Path(__file__).parents[1]
LAMBDA, FORCE, _ = np.loadtxt(TESTS / "data/maugis_dugdale.csv", delimiter=",", skiprows=2).T


def factor(work, radius, modulus, z0):
    """Pull-off over pi W R by Maugis-Dugdale, lambda = 1.157 (R W^2 / (E*^2 z0^3))^(1/3)."""
    return np.interp(1.157 * (radius * work**2 / (modulus**2 * z0**3)) ** (1 / 3), LAMBDA, -FORCE)


def as_stiff(work, radius, median, modulus, z0):
    """Work of a stiff contact with the same pull-off, where works are refitted for the median of a
    ball of 20 um."""
    scale = brentq(lambda k: k * factor(k * median, 20e-6, modulus, z0) - 2, 1.0, 4 / 3)
    return scale * work * factor(scale * work, radius, modulus, z0) / 2


@pytest.mark.parametrize("z0", [0.16e-9, 0.4e-9])
def test_no_verdict_on_trials_changes_with_the_pull_off_of_the_transition(z0):
    """Voltages of the committed trials, times what the force balance makes of the other
    pull-off."""
    rows, _ = read_table(TESTS.parent / "results/default/grasp/trials.parquet")
    contacts, changed, change = Contacts(), [], {"grasp": [], "release": []}
    for row in rows:
        radius = row["radius"]
        tool = as_stiff(
            row["work_tool_object"], radius, WORK_TOOL_OBJECT, contacts.probe_modulus, z0
        )
        plate = as_stiff(
            row["work_object_substrate"], radius, WORK_OBJECT_SUBSTRATE, contacts.plate_modulus, z0
        )
        if row["experiment"] == "grasp":
            new = grasp_voltage(radius, tool, plate, CONTACT_GAP, PROBE_RADIUS)
        elif row["experiment"] == "release":
            new = release_voltage(radius, tool, row["gap"], PROBE_RADIUS)
        else:
            changed.append(row)
            continue
        ratio = float(new) / row["quasi_static_voltage"]
        change[row["experiment"]].append(100 * (ratio - 1))
        changed.append(row | {"voltage": row["voltage"] * ratio})
    for name, found in change.items():
        print(f"z0 = {1e9 * z0:g} nm, {name}: {min(found):.1f} to {max(found):.1f} %")
    findings = [
        [one.finding(each) for one in STATEMENTS if one.study == "grasp"]
        for each in (rows, changed)
    ]
    assert [f.verdict for f in findings[0]] == [f.verdict for f in findings[1]]
    assert all(
        math.isfinite(value) and abs(value) < 5 for found in change.values() for value in found
    )
