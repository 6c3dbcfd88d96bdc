"""The statements on the gripper: what made-up trials and the laws say of them."""

import numpy as np
import pytest
from support.findings import grasp_rows

from iswarm_mj.paper.analysis import bench_statements
from iswarm_mj.paper.analysis.bench_statements import STATEMENTS
from iswarm_mj.paper.analysis.findings import FAILS, NOT_RUN, TOO_FEW, UNDECIDED

PURE = 0
ALWAYS = 1
GRASP = 2
FLAT_GRASP = 3
RELIABLE = 8
ON_BOARD = 13
TRANSPORT = 15
"""Places of the statements on trials."""


def findings_of(rows):
    """Return the findings on trials."""
    return [statement.finding(rows) for statement in STATEMENTS if statement.study == "grasp"]


def first_of(rows, experiment):
    """Return the first trial of an experiment."""
    return next(row for row in rows if row["experiment"] == experiment)


class TestTrials:
    @pytest.mark.parametrize(
        ("experiment", "change", "statement"),
        [
            ("no_contact", {"voltage": 45.0}, PURE),
            ("grasp", {"voltage": None}, ALWAYS),
            ("release", {"landed": False}, RELIABLE),
            ("release", {"off_target": 26e-6}, TRANSPORT),
            ("release", {"landed": False}, TRANSPORT),
        ],
    )
    def test_a_single_one_can_spoil_a_statement(self, experiment, change, statement):
        rows = grasp_rows(repeats=16)
        first_of(rows, experiment).update(change)
        assert findings_of(rows)[statement].verdict == FAILS

    def test_few_show_nothing(self):
        """The exact interval of 25 of 25 begins at 86 %; four at a radius say nothing."""
        reliable = findings_of(grasp_rows(repeats=5))[RELIABLE]
        assert reliable.verdict == TOO_FEW
        assert "(86.3 to 100)" in reliable.statistics
        assert findings_of(grasp_rows(repeats=4))[GRASP].verdict == TOO_FEW

    def test_faulty_ones_do_not_count(self):
        """The made-up voltages are beyond those on board, whose statement is left out."""
        rows = grasp_rows()
        for row in rows[::7]:
            row.update(faulty=True, voltage=1000.0)
        verdicts = {finding.verdict for finding in findings_of(rows)[:ON_BOARD]}
        assert FAILS not in verdicts

    def test_a_slight_slope_over_the_radius_decides_nothing(self):
        assert findings_of(grasp_rows(slope=0.15))[FLAT_GRASP].verdict == UNDECIDED

    def test_without_a_transport_nothing_is_said_of_it(self):
        rows = [{**row, "transport": 0.0} for row in grasp_rows(repeats=16)]
        assert findings_of(rows)[TRANSPORT].verdict == NOT_RUN


@pytest.mark.parametrize(
    ("release_peak", "pick_peak", "holds"),
    [
        (1.0, 1.05, True),
        (1.05, 1.2, False),
        (0.8, 1.0, False),
        (1.0, 3.0, False),
        (0.0, 1.0, False),
    ],
)
def test_a_peak_is_near_the_balls_radius_in_both_forces(
    monkeypatch, release_peak, pick_peak, holds
):
    """Forces fall with the distance of R_m / R from their peaks."""

    def force_with(peak):
        return lambda voltage, gap, ball, tool: 10 - np.abs(tool / ball - peak)

    monkeypatch.setattr(bench_statements, "release_force", force_with(release_peak))
    monkeypatch.setattr(bench_statements, "pick_force", force_with(pick_peak))
    assert bench_statements.peak_fact().holds == holds
