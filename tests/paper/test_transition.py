"""The transition between stiff and soft contacts: it would change no verdict on trials."""

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
TRIALS = TESTS.parent / "results/default/grasp/trials.parquet"
FITTED_RADIUS = 20e-6
"""Radius of the ball for which works of adhesion are fitted [m]."""
LAMBDA, FORCE, _ = np.loadtxt(TESTS / "data/maugis_dugdale.csv", delimiter=",", skiprows=2).T
"""Maugis' parameter, and the pull-off force over pi W R."""


def pull_off_factor(work, radius, modulus, z0):
    """Return the pull-off force over pi W R by Maugis-Dugdale.

    lambda = 1.157 (R W^2 / (E*^2 z0^3))^(1/3).
    """
    parameter = 1.157 * (radius * work**2 / (modulus**2 * z0**3)) ** (1 / 3)
    return np.interp(parameter, LAMBDA, -FORCE)


def stiff_work(work, radius, median_work, modulus, z0):
    """Return the work of adhesion of a stiff contact with the same pull-off force.

    Works are fitted again, so that the median one gives the force of a stiff contact at a ball of
    20 um.
    """

    def excess(scale):
        return scale * pull_off_factor(scale * median_work, FITTED_RADIUS, modulus, z0) - 2

    fitted_work = brentq(excess, 1.0, 4 / 3) * work
    return fitted_work * pull_off_factor(fitted_work, radius, modulus, z0) / 2


def voltage_ratio(row, z0):
    """Return by what the force balance of a trial multiplies its voltage in the transition."""
    contacts = Contacts()
    radius = row["radius"]
    tool = stiff_work(row["work_tool_object"], radius, WORK_TOOL_OBJECT, contacts.probe_modulus, z0)
    if row["experiment"] == "grasp":
        plate = stiff_work(
            row["work_object_substrate"], radius, WORK_OBJECT_SUBSTRATE, contacts.plate_modulus, z0
        )
        voltage = grasp_voltage(radius, tool, plate, CONTACT_GAP, PROBE_RADIUS)
    else:
        voltage = release_voltage(radius, tool, row["gap"], PROBE_RADIUS)
    return float(voltage) / row["quasi_static_voltage"]


def verdicts(rows):
    """Return the verdicts of the statements on trials."""
    on_trials = [statement for statement in STATEMENTS if statement.study == "grasp"]
    return [statement.finding(rows).verdict for statement in on_trials]


@pytest.mark.parametrize("z0", [0.16e-9, 0.4e-9])
def test_no_verdict_changes_with_the_pull_off_of_the_transition(z0):
    """Voltages are those of the published trials, and change by less than 5 %."""
    rows, _ = read_table(TRIALS)
    changed_rows = []
    percent = {"grasp": [], "release": []}
    for row in rows:
        if row["experiment"] not in percent:
            changed_rows.append(row)
            continue
        ratio = voltage_ratio(row, z0)
        percent[row["experiment"]].append(100 * (ratio - 1))
        changed_rows.append({**row, "voltage": row["voltage"] * ratio})

    assert verdicts(changed_rows) == verdicts(rows)
    for experiment, changes in percent.items():
        print(f"z0 = {1e9 * z0:g} nm, {experiment}: {min(changes):.1f} to {max(changes):.1f} %")
        assert all(math.isfinite(change) and abs(change) < 5 for change in changes)
