"""What made-up trials and the laws say on the statements on the gripper."""

import numpy as np
import pytest
from support.findings import grasp_rows

from iswarm_mj.paper.analysis import bench_statements
from iswarm_mj.paper.analysis.bench_statements import STATEMENTS
from iswarm_mj.paper.analysis.findings import FAILS, NOT_RUN, TOO_FEW, UNDECIDED

PURE, ALWAYS, GRASP, FLAT_GRASP, RELIABLE, ON_BOARD, TRANSPORT = 0, 1, 2, 3, 8, 13, 15
"""Places of the statements on trials."""


def found(rows):
    return [statement.finding(rows) for statement in STATEMENTS if statement.study == "grasp"]


def test_single_trials_can_spoil_a_statement_and_few_show_nothing():
    """Of 25 of 25 the exact interval begins at 86 %; of four at a radius nothing is said; faulty
    ones do not count."""
    rows = grasp_rows()
    rows[0]["voltage"] = 45.0
    next(r for r in rows if r["experiment"] == "grasp")["voltage"] = None
    next(r for r in rows if r["experiment"] == "release")["landed"] = False
    assert [found(rows)[place].verdict for place in (PURE, ALWAYS, RELIABLE)] == [FAILS] * 3
    said = found(grasp_rows(repeats=5))[RELIABLE]
    assert said.verdict == TOO_FEW and "(86.3 to 100)" in said.statistics
    assert found(grasp_rows(repeats=4))[GRASP].verdict == TOO_FEW
    rows = [
        row | ({} if k % 7 else {"faulty": True, "voltage": 1000.0})
        for k, row in enumerate(grasp_rows())
    ]
    assert FAILS not in {f.verdict for f in found(rows)[:ON_BOARD]}
    assert found(grasp_rows(slope=0.15))[FLAT_GRASP].verdict == UNDECIDED


@pytest.mark.parametrize("change", [{"off_target": 26e-6}, {"landed": False}])
def test_one_ball_off_the_target_spoils_the_transport(change):
    rows = grasp_rows(repeats=16)
    next(r for r in rows if r["experiment"] == "release").update(change)
    assert found(rows)[TRANSPORT].verdict == FAILS
    assert found([row | {"transport": 0.0} for row in rows])[TRANSPORT].verdict == NOT_RUN


@pytest.mark.parametrize(
    "release, pick, holds",
    [
        (1.0, 1.05, True),
        (1.05, 1.2, False),
        (0.8, 1.0, False),
        (1.0, 3.0, False),
        (0.0, 1.0, False),
    ],
)
def test_a_peak_is_near_the_balls_radius_in_both_forces(monkeypatch, release, pick, holds):
    """Forces that fall with the distance of R_m / R from a number."""

    def force(at):
        return lambda voltage, gap, ball, tool: 10 - np.abs(tool / ball - at)

    monkeypatch.setattr(bench_statements, "release_force", force(release))
    monkeypatch.setattr(bench_statements, "pick_force", force(pick))
    assert bench_statements.peak_fact().holds == holds
