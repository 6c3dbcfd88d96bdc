"""The study of grasps by trials: which runs it is made of, and what it finds in made-up rows."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from iswarm_mj.config import GripperConfig
from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, NOT_RUN, TOO_FEW, UNDECIDED
from iswarm_mj.experiments.report.result_tables import TABLES
from iswarm_mj.experiments.runner.experiment import Plan, row_of
from iswarm_mj.experiments.runner.jobs import Outcome
from iswarm_mj.experiments.studies import resolved_grasps
from iswarm_mj.tasks.measures import Measures

ENTRIES = resolved_grasps.entries(Plan())


def made_rows(time, failed, entries=ENTRIES):
    """Rows of runs that take these times and grasp so often in vain, by functions of the labels."""
    rows = []
    for entry in entries:
        k, at, vain = entry.labels["repeat"], time(entry.labels), failed(entry.labels)
        found = Measures(66, 66, 2800, 60.0, at + k, 66 + vain, vain, 3, 69, 2, lost_time=vain + 3.25)
        made = Outcome(found, at + k, 0.0)
        rows.append(row_of(entry, made))
    return rows


def time_of(labels):
    """Low voltages take longer; by trials type 2 takes longer with 55 V in dry air, and as much shorter in damp air."""
    is_apart = labels["type"] == "type2" and labels["resolution"] == "dynamic" and labels["grasp_voltage"] == 55
    later = {10: 60, 50: -60}.get(labels["relative_humidity"], 0) if is_apart else 0
    return 300 + later + (200 if labels["grasp_voltage"] == 30 else 0)


def failed_of(labels):
    return 40 if labels["grasp_voltage"] == 30 and labels["relative_humidity"] == 50 else 4


def test_pairs_differ_in_what_decides_alone():
    assert len(ENTRIES) == 2 * 3 * 3 * 2 * 24 and len({entry.job.seed for entry in ENTRIES}) == len(ENTRIES) // 2
    pairs = {}
    for entry in ENTRIES:
        gripper = entry.job.config.gripper
        assert gripper.resolution == entry.labels["resolution"]
        assert gripper.grasp_voltage == entry.labels["grasp_voltage"]
        assert gripper.relative_humidity == entry.labels["relative_humidity"]
        usual = replace(entry.job.config, gripper=replace(gripper, resolution="quasi-static"))
        pairs.setdefault(entry.job.seed, []).append(replace(entry.job, config=usual))
    assert all(len(both) == 2 and both[0] == both[1] for both in pairs.values())


def test_the_spread_of_adhesion_is_the_calibrated_one_from_attempt_to_attempt():
    mine, usual = ENTRIES[0].job.config.gripper, GripperConfig()
    assert mine.spread_tool_object == usual.spread_tool_object
    assert mine.spread_object_substrate == usual.spread_object_substrate


def test_findings_tell_differences_from_none():
    said = {finding.claim: finding for finding in resolved_grasps.findings(made_rows(time_of, failed_of))}
    apart = "At {} V trials instead of the balance of the forces leave the {} as it is"
    same = [apart.format(v, what) for what in ("finishing time", "number of attempts per ball") for v in (30, 40, 55)]
    assert {claim.rpartition(", ")[0]: finding.verdict for claim, finding in said.items() if "type1" in claim} == {
        **dict.fromkeys(same, HOLDS),
        "At 30 V more grasps fail at 50 % RH than at 10 %": HOLDS,
        "At 50 % RH a swarm with 30 V takes longer than one with 55 V": HOLDS,
    }
    later = [said[f"{apart.format(v, 'finishing time')}, type2"] for v in (30, 40, 55)]
    assert [finding.verdict for finding in later] == [HOLDS, HOLDS, FAILS]  # although the mean of all is the same
    dry, damp = (np.log((300 + way + np.arange(24)) / (300 + np.arange(24))).mean() for way in (60, -60))
    assert f"{math.exp(dry):.3g} " in later[2].ours and f"{math.exp(damp):.3g} " in later[2].ours
    assert [part.rpartition(" at ")[2] for part in later[2].ours.split(", ")] == [
        "10 % RH (24 pairs)",
        "30 % RH (24 pairs)",
        "50 % RH (24 pairs)",
    ]
    even = resolved_grasps.findings(made_rows(lambda labels: 300, lambda labels: 4))
    assert [finding.verdict for finding in even] == [*[HOLDS] * 6, FAILS, UNDECIDED] * 2


def test_few_runs_and_none_are_not_judged():
    quick = resolved_grasps.findings(made_rows(time_of, failed_of, resolved_grasps.entries(Plan(quick=True))))
    assert [finding.verdict for finding in quick[:8]] == [
        *(TOO_FEW, NOT_RUN, TOO_FEW) * 2,
        NOT_RUN,
        TOO_FEW,
    ]
    assert {finding.verdict for finding in resolved_grasps.findings([])} == {NOT_RUN}
    idle = [{**row, "finished_at": None} for row in made_rows(time_of, failed_of)]
    assert resolved_grasps.findings(idle)[0].verdict == TOO_FEW


def test_an_outcome_tells_attempts():
    measures = Measures(60, 70, 5, 3.0, None, 90, 20, 7, 67, 2, 0.5, 27.5, 0.2, 3)
    made = Outcome.of(ENTRIES[0].job, measures, 1200)
    assert made.columns.items() >= measures._asdict().items() and made.columns["steps"] == 1200
    assert Outcome.read(json.loads(json.dumps(made))) == made


def test_table_and_figures(tmp_path):
    rows = made_rows(time_of, failed_of)
    lines = TABLES["resolved-grasps"](rows).splitlines()
    assert len(lines) == 2 + 2 * 3 * 3 * 2
    cells = [cell.strip() for cell in lines[3].split("|")[1:-1]]
    assert cells[:5] == ["type1", "10 %", "30 V", "trials", "24 of 24"] and cells[-1] == "0 (0 to 0)"
    assert cells[6:11] == ["1.06 (1.06 to 1.06)", "4 (4 to 4)", "3 (3 to 3)", "2 (2 to 2)", "7.25 (7.25 to 7.25)"]
    paths = resolved_grasps.draw(rows, tmp_path)
    assert [path.name for path in paths] == ["resolved_grasps_type1.png", "resolved_grasps_type2.png"]
    assert all(path.stat().st_size > 10_000 for path in paths)


@pytest.mark.parametrize("measure", resolved_grasps.COUNTS, ids=lambda m: m.name)
def test_measures_have_values_where_nothing_was_picked(measure):
    row = {"attempts": 0, "picked": 0, "failed_grasps": 0, "failed_releases": 0, "broken_off": 0, "lost_time": 0.0}
    assert measure.value(row) == 0
