"""Which readings agree with the paper: the design, the statements, and the support in made-up rows."""

from dataclasses import replace
from functools import cache

import pytest

from iswarm_mj.config import READINGS, SwarmConfig
from iswarm_mj.experiments.analysis.statements import ASKED, penalty_error
from iswarm_mj.experiments.analysis.statistics import Interval
from iswarm_mj.experiments.analysis.support import (
    Combination,
    accepted,
    answers,
    chances,
    counts_alone,
    gives_way,
    more_alone,
    support,
)
from iswarm_mj.experiments.runner.experiment import Plan, row_of, varied
from iswarm_mj.experiments.runner.jobs import Outcome
from iswarm_mj.experiments.studies import infer
from iswarm_mj.experiments.studies.infer import (
    ALONE,
    DEFAULTS,
    DENSITIES,
    FACTORS,
    NAMED,
    NAMED_REPEATS,
    SETTINGS,
    combinations_of,
    design,
    entries,
    findings,
)
from iswarm_mj.simulation.common import PER_WORLD_FIELDS
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.measures import Measures

N = 40
SELECTING = sum(asked.selects for asked in ASKED.values())


def outcome(entry, like_the_paper):
    """What the paper reports of such a run; or the opposite: dense swarms are best, hop counts no use."""
    row, job = entry.labels, entry.job
    if row["study"] == "types":
        time = {"type1": 310, "type2": 311}[row["setting"]] if like_the_paper else 120
        collisions = job.n_robots * {"type1": 180, "type2": 80}[row["setting"]] if like_the_paper else 0
    elif row["study"] == "density":
        off = abs(row["density"] - 0.12) if like_the_paper else 1 - row["density"]
        time, collisions = 100 + round(1000 * off), round(job.n_robots * (10 + 100 * off))
        time = None if like_the_paper and not 0.1 <= row["density"] <= 0.2 else time
    else:
        good = (row["setting"] == "with") == like_the_paper
        time, collisions = 200 if good else None, job.n_robots * (10 if good else 20)
    goal = job.stop_at or 72
    return Outcome(Measures(goal if time else goal - 20, goal, collisions, time or 300.0, time), time or job.steps, 0.0)


@cache
def listed():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(infer, "COMBINATIONS", N)
        return entries(Plan())


def rows_where(like_the_paper):
    return [row_of(e, outcome(e, like_the_paper(e.labels))) for e in listed()]


def said(rows):
    """Answers by the texts of the statements, those that select and those held out."""
    texts = ([text for text, asked in ASKED.items() if asked.selects == which] for which in (True, False))
    both = (answers(rows), answers(rows, selects=False))
    return {text: holds for pair in zip(texts, both, strict=True) for text, holds in zip(*pair, strict=True)}


def types_of(rows):
    return [{**row, "type": row["setting"]} for row in rows if row["study"] == "types"]


class TestDesign:
    def test_every_label_comes_equally_often(self):
        drawn = design(60, 0)
        for name, levels in FACTORS.items():
            counts = [sum(labels[name] == level for labels in drawn) for level in levels]
            assert counts == [60 // len(levels)] * len(levels)
        assert drawn != design(60, 1) and drawn == design(60, 0)

    def test_every_label_is_a_setting_of_its_own(self):
        """The defaults are among them, and all but three can differ within one run."""
        for name, levels in FACTORS.items():
            configs = [varied(SwarmConfig(), values) for values in levels.values()]
            assert len(set(configs)) == len(levels) and SwarmConfig() in configs, name
            names = {key for values in levels.values() for key in values}
            together = {f"{part}.{item}" for part, items in PER_WORLD_FIELDS.items() for item in items}
            assert names <= together | {"drive.max_turn", "drive.turn_substeps", "drive.locations"}

    def test_each_combination_is_run_on_all_figures_and_both_types(self):
        sampled = [e for e in listed() if e.labels["reading"] is None]
        assert len(sampled) == N * len(SETTINGS) == N * (2 + len(DENSITIES) + 2)
        assert len(listed()) - len(sampled) == (len(NAMED) + len(ALONE)) * NAMED_REPEATS * len(SETTINGS)
        for entry in sampled[:24]:
            config = SwarmConfig()
            for name in FACTORS:
                config = varied(config, FACTORS[name][entry.labels[name]])
            assert entry.job.config == config
        types = [e.job for e in sampled if e.labels["study"] == "types"]
        assert {(job.genome, job.steps, job.stop_at) for job in types} == {
            (PRESETS[name], 800, None) for name in ("type1", "type2")
        }
        absent = [e.job for e in sampled if e.labels["setting"] == "without"]
        assert {(j.genome, j.stop_at, j.steps) for j in absent} == {
            (replace(PRESETS["type1"], use_hop_count=False), 66, 1200)
        }

    def test_the_paper_s_reading_is_run_with_each_other_value_alone(self):
        """In the same layouts."""
        runs = {}
        for entry in listed():
            if entry.labels["reading"] == "paper":
                runs.setdefault(entry.labels["combination"], []).append(entry)
        plain, *changed = [runs[place] for place in sorted(runs, reverse=True)]
        assert len(changed) == len(ALONE) == sum(map(len, FACTORS.values())) - len(FACTORS)
        assert len({one[0].job.config for one in changed} | {plain[0].job.config}) == len(ALONE) + 1
        for one in changed:
            assert [e.job.seed for e in one] == [e.job.seed for e in plain]
            (told,) = [(name, one[0].labels[name]) for name in FACTORS if one[0].labels[name]]
            assert one[0].job.config == varied(READINGS["paper"], FACTORS[told[0]][told[1]])


class TestStatements:
    def test_all_hold_for_runs_as_the_paper_reports_them(self):
        runs = [row for row in rows_where(lambda labels: True) if row["combination"] == 0]
        assert all(answers(runs)) and all(answers(runs, selects=False)) and penalty_error(types_of(runs)) == 0.0

    def test_none_holds_for_their_opposite(self):
        runs = [row for row in rows_where(lambda labels: False) if row["combination"] == 0]
        held = {text for text, holds in said(runs).items() if holds}
        assert held == {"0.1 to 0.2 cleans", "Both types take the same time"}  # both may hold for other reasons
        assert penalty_error(types_of(runs)) > 0.9

    @pytest.mark.parametrize(
        "low, high, supported", [(0.34, 0.9, True), (0.32, 0.9, False), (0.05, 0.3, False)], ids=str
    )
    def test_support_is_by_the_low_end_of_the_interval(self, low, high, supported):
        """Of three labels each has a third without support; the estimates all lie above."""
        shares = {"a": Interval(0.1, 0.0, 0.2), "b": Interval(0.5, low, high), "c": Interval(0.1, 0.0, 0.2)}
        assert gives_way("a", shares, {"a": 3, "b": 3, "c": 3}) == ("b" if supported else None)

    def test_times_and_penalties_are_of_their_types(self):
        """Those of one type given to the other agree with nothing."""
        runs = [row for row in rows_where(lambda labels: True) if row["combination"] == 0]
        wrong = [row | {"finished_at": 500} if row["setting"] == "type1" else row for row in runs]
        found = said(wrong)
        assert not found["Type 1 takes 310 steps"] and found["Type 2 takes 311 steps"]
        assert not found["Both types take the same time"] and found["Type 1 loses 9 points by collisions"]
        fewer = [row | {"collisions_per_robot": 30.0} if row["setting"] == "type2" else row for row in runs]
        assert [text for text, holds in said(fewer).items() if not holds] == ["Type 2 loses 4 points by collisions"]

    def test_swarms_reach_a_goal_if_more_than_half_of_them_do(self):
        clean = [ASKED[text].holds for text in ("0.1 to 0.2 cleans", "0.05 does not clean", "Above 0.2 does not clean")]
        half = [{"study": "density", "density": d, "finished_at": t} for d in DENSITIES for t in (100, None)]
        most = half + [{**row, "finished_at": 200} for row in half[::2]]
        assert [holds(half) for holds in clean] == [False, True, True]
        assert [holds(most) for holds in clean] == [True, False, False]


class TestSupport:
    def test_a_default_gives_way_to_what_is_supported_and_does_no_worse_alone(self):
        """Of the supported the one with the largest share, in thirds; without support or counts none."""
        shares = {"a": Interval(0.1, 0.05, 0.2), "b": Interval(0.5, 0.4, 0.6), "c": Interval(0.6, 0.5, 0.7)}
        assert gives_way("a", shares, {"a": 12, "b": 12, "c": 12}) == "c"
        assert gives_way("a", shares, {"a": 12, "b": 12, "c": 11}) == "b"
        assert gives_way("a", shares, {"a": 12, "b": 11, "c": 11}) is None
        assert gives_way("c", shares, {"a": 12, "b": 11, "c": 12}) is None
        assert gives_way("a", shares, {"a": 12}) is None

    def test_counts_with_one_value_changed(self):
        """Of runs as the paper reports them, but for those with drops."""
        every = combinations_of(rows_where(lambda labels: labels["drops"] != "1 % a step"))
        total = SELECTING
        assert counts_alone(every, "drops", DEFAULTS["drops"]) == {"none": total, "1 % a step": 1}
        assert counts_alone(every, "locations", DEFAULTS["locations"]) == {"free": total, "cells": total}
        assert sum(c.is_named for c in every) == len(NAMED)

    def test_single_runs_are_compared_by_layouts(self):
        def one(label, single):
            return Combination("paper", {"drops": label}, [True] * 3, 0.0, single)

        change = more_alone([one(None, [1, 5, 9]), one("1 % a step", [3, 7, 11])], "drops", "none")
        assert change == {"1 % a step": Interval(2.0, 2.0, 2.0)}
        apart = more_alone([one(None, [1, 5, 9]), one("1 % a step", [11, 7, 3])], "drops", "none")["1 % a step"]
        assert apart.estimate == 2.0 and apart.low < -2 and apart.high > 6

    def test_chances_are_corrected_for_the_number_of_factors(self):
        """Of 200, the ten that hold have the first label of `a`, and the labels of `b` by halves."""
        sample = [Combination(None, {"a": str(k % 2), "b": str(k // 2 % 2)}, [k % 2 == 0], k / 200) for k in range(200)]
        found = chances(sample, accepted(sample), {"a": ["0", "1", "2"], "b": ["0", "1"]})
        assert found["a"] == pytest.approx((2 / 2**10, 4 / 2**10)) and found["b"] == pytest.approx((1, 1))

    def test_the_penalties_decide_between_equals(self):
        sample = [Combination(None, {"a": str(k)}, [True, k % 2 == 0], abs(k - 10) / 10) for k in range(40)]
        assert [c.labels["a"] for c in accepted(sample)] == ["10", "8"]
        assert support(sample, accepted(sample), "a", ["10", "99"]).keys() == {"10"}

    def test_findings_count_what_is_reproduced(self):
        rows = rows_where(lambda labels: labels["reading"] != "initial" and labels["avoidance_sides"] != "all")
        first, *others = findings(rows)
        total = SELECTING
        assert f"at most {total} of {total}, by 20" in first.ours
        assert f"paper {total} of {total}, and of those held out 7 of 7; initial 1 of {total}" in first.ours
        sides = next(f for f in others if "avoidance sides" in f.claim)
        assert "front: 100 %" in sides.ours and "p = 0.5, 1 by Holm for 21 readings" in sides.statistics
