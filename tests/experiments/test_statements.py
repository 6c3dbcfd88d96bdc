"""What the statements on swarms say of made-up runs, no two of whose groups and columns are alike."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers_outcomes import PLAN, done, rows_of, type_rows

from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, NOT_RUN, TOO_FEW, UNDECIDED
from iswarm_mj.experiments.analysis.measures import latest_finish
from iswarm_mj.experiments.analysis.statements import changes
from iswarm_mj.experiments.runner.experiment import Plan, row_of
from iswarm_mj.experiments.runner.jobs import outcome_of
from iswarm_mj.experiments.studies import observed
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.tasks.measures import Measures, fitness

ENTRIES = {name: experiment.entries(PLAN) for name, experiment in EXPERIMENTS.items() if name != "infer"}


def judged(name, rows):
    return EXPERIMENTS[name].findings(rows)


def verdicts(name, rows):
    return [finding.verdict for finding in judged(name, rows)]


def made(name, outcome):
    return rows_of(ENTRIES[name], outcome)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_runs_of_a_quick_version_are_too_few(name):
    """Nothing is judged, however clear the runs are."""
    entries = EXPERIMENTS[name].entries(replace(PLAN, quick=True))
    rows = rows_of(entries, lambda e: done(e.job, 100 + e.labels["repeat"]))
    found = set(verdicts(name, [row | {"aggregation": 0.3, "overlap": 0.05, "ms_per_step": 2.0} for row in rows]))
    assert found <= {TOO_FEW, NOT_RUN, ""} and (TOO_FEW in found or name == "infer")  # which judges nothing


@pytest.mark.parametrize("measure", range(4))
def test_statements_on_hop_counts_are_on_one_measure_each(measure):
    """Runs differ in one of time, dust, collisions and carriage, and the others are equal to the last digit."""

    def outcome(entry):
        values = [100, 50, 2800, 60.0]
        way = 1 if entry.job.genome.use_hop_count == (measure == 1) else -1
        values[measure] += way * (20 + entry.labels["repeat"])
        return done(entry.job, *values)

    assert verdicts("hop-count", made("hop-count", outcome)) == [HOLDS if n == measure else FAILS for n in range(4)]


def test_densities():
    """Swarms are best at 0.1, and those of 0.1 to 0.2 clean; or all clean, and the densest are the fastest."""

    def outcome(entry):
        density, k = entry.labels["density"], entry.labels["repeat"]
        off = abs(density - 0.1)
        time = 200 + round(1000 * off) + k if 0.1 <= density <= 0.2 else None
        return done(entry.job, time, 66, round(entry.job.n_robots * (10 + 100 * off + k)), 50 + 100 * off + k)

    def opposite(entry):
        rank = round(1000 * (1 - entry.labels["density"])) + entry.labels["repeat"]
        return done(entry.job, rank, 66, entry.job.n_robots * rank, float(rank))

    assert verdicts("density", made("density", outcome)) == 7 * [HOLDS]
    assert verdicts("density", made("density", opposite)) == 4 * [FAILS] + [HOLDS, FAILS, FAILS]


class TestTypes:
    def test_types_that_are_the_papers(self):
        """Times about 310 and 311 steps and the fitness that follows from them; aggregation is compared."""
        found = judged("types", type_rows(310, 311))
        assert [f.verdict for f in found] == [HOLDS] * 3 + [UNDECIDED] + [HOLDS] * 3 + [NOT_RUN] * 2
        assert found[0].ours.startswith("type1: 96 of 96: ") and "; type2: 96 of 96: " in found[0].ours
        assert "median 313 steps (303 to 321)" in found[1].ours

    @pytest.mark.parametrize(
        "one, two, repeats, expected",
        [
            (310, 380, 96, [FAILS, FAILS, FAILS, FAILS]),  # 22 % later; 7075 points, 9 % off
            (200, 201, 96, [FAILS, HOLDS, FAILS, HOLDS]),
            (310, 360, 8, [UNDECIDED] * 4),
            (310, 345, 4, [TOO_FEW] * 4),
        ],
    )
    def test_types_that_are_not(self, one, two, repeats, expected):
        """By intervals: what differs is told from what is only uncertain, and nothing follows from a few runs."""
        _, times, alike, _, points, as_fit, *_ = verdicts(
            "types", [row for row in type_rows(one, two) if row["repeat"] < repeats]
        )
        assert [times, alike, points, as_fit] == expected

    @pytest.mark.parametrize("time, early, expected", [(250, 0, HOLDS), (None, 0, HOLDS), (250, 12, FAILS)])
    def test_runs_that_are_faster_than_the_papers_shortest_time(self, time, early, expected):
        """The first `early` runs of type 2 finish in 249 steps, the others at `time`."""
        rows = [
            row | {"finished_at": 249 if row["type"] == "type2" and row["repeat"] < early else time}
            for row in type_rows(310, 311)
        ]
        assert verdicts("types", rows)[3] == expected

    @pytest.mark.parametrize("points, collisions, n_robots, step", [(7771, 180, 280, 310), (7766, 80, 314, 311)])
    def test_the_papers_times_follow_from_its_fitness(self, points, collisions, n_robots, step):
        """The formula of section 4.6 gives the paper's points with so many collisions a robot, and not a step later."""
        run = Measures(72, 72, collisions * n_robots, None, step)
        assert latest_finish(points) == step and fitness(run, n_robots, 72, 800) == pytest.approx(points)
        assert fitness(run._replace(collisions=0, finished_at=step + 1), n_robots, 72, 800) < points

    def test_another_preset_is_held_against_both_types(self):
        """Fitter than type 1 and less fit than type 2."""
        level, evolved = (
            {"type1": 0, "type2": 200, "evolved": 100},
            [
                row_of(e, done(e.job, 300, 72)) | {"aggregation": None}
                for e in ENTRIES["types"]
                if e.labels["type"] == "evolved"
            ],
        )
        rows = [*type_rows(310, 311), *evolved]
        rows = [row | {"fitness": float(level[row["type"]] + row["repeat"] % 24)} for row in rows]
        assert verdicts("types", rows)[-2:] == [HOLDS, FAILS]

    def test_aggregation_by_hand(self):
        """Of the empty workers two of three are near a dust area in the first step, none in the second."""
        rd = 2e-3 * np.sqrt(2)
        far, near, edge = [0.0, 20 * rd, 0.0], [16 * rd, 0.0, 0.0], [(16 - 3 - 3.4) * rd, 0.0, 0.0]
        frames = {
            "pose": np.array([[near, edge, far, near, near], [far] * 5, [near] * 5]),
            "is_loaded": np.array([[False, False, False, True, False]] * 3),
            "scene_is_scout": np.array([False, False, False, False, True]),
            "scene_dust_areas": np.array([[13.0, -3, 19, 3], [-19, -3, -13, 3]]) * rd,
            "ball_position": np.zeros((3, 4, 3)),
            "delivered": np.array([0, 1, 2]),
        }
        assert observed.aggregation(frames) == pytest.approx((2 / 3 + 0) / 2)


def test_choices_that_change_the_time_and_that_stop_the_swarm():
    """Wrong bits triple the time; a wall range stops all but two runs."""

    def outcome(entry):
        choice, k = entry.labels["choice"], entry.labels["repeat"]
        stops = choice == "optics.wall_range" and k > 1
        return done(entry.job, None if stops else (450 if choice == "optics.independent_bit_errors" else 150) + k)

    rows = made("sensitivity", outcome)
    reaches, grips, changed = judged("sensitivity", rows)
    assert (reaches.verdict, grips.verdict, changed.verdict) == (UNDECIDED, HOLDS, "")
    assert "wall_range = 0.75: 2 of 10: " in reaches.ours and grips.ours.count("10 of 10") == 4
    assert "independent_bit_errors = True" in changed.ours and "dust_range" not in changed.ours
    found = {change.choice: change for change in changes(rows)}
    same, slow = found["strategy.random_turn"], found["optics.independent_bit_errors"]
    assert slow.effect.estimate == 300 and same.effect.estimate == 0 and same.p == same.adjusted == 1.0
    assert slow.adjusted == pytest.approx(min(1, len(changes(rows)) * slow.p)) and slow.reached == "10/10"


def test_dead_robots_that_cost_time():
    def outcome(entry):
        part, k, slow = entry.labels["fraction"], entry.labels["repeat"], 1 + (entry.labels["kind"] == "dead")
        return done(entry.job, None if part == 0.5 and slow == 2 else round(150 * (1 + slow * part)) + k)

    robust, cost = judged("robustness", made("robustness", outcome))
    assert (robust.verdict, cost.verdict) == (FAILS, HOLDS)
    assert "50 %: 0 of 12: " in robust.ours and "0 %: 12 of 12: " in robust.ours
    assert "10 %: 186 against 170, difference 15 steps (" in cost.ours and "difference 970 steps (" in cost.ours


def test_slow_messages():
    """One rate slows, one hastens, one changes nothing; hop counts help in all."""

    def outcome(entry):
        later = {"1000": 100, "2000": -30}.get(entry.labels["setting"][:4], 0)
        return done(entry.job, (150 if entry.labels["use_hop_count"] else 800) + later + entry.labels["repeat"])

    fast, middle, slow, _, *hops = judged("message-time", made("message-time", outcome))
    assert (fast.verdict, middle.verdict, slow.verdict) == (UNDECIDED, FAILS, HOLDS)
    assert slow.ours.startswith("256 against 156, difference 100 steps (")
    times = [finding for finding in hops if "more quickly" in finding.claim]
    assert [finding.verdict for finding in times] == [HOLDS] * 4 and times[2].claim.endswith("messages at 1000 bit/s")


def test_grasps_by_trials_are_told_from_the_balance():
    """Low voltages take longer; by trials type 2 takes longer with 55 V in dry air, and as much shorter in damp."""

    def time(labels):
        is_apart = labels["type"] == "type2" and labels["resolution"] == "dynamic" and labels["grasp_voltage"] == 55
        later = {10: 60, 50: -60}.get(labels["relative_humidity"], 0) if is_apart else 0
        return 300 + later + (200 if labels["grasp_voltage"] == 30 else 0)

    def failed(labels):
        return 40 if labels["grasp_voltage"] == 30 and labels["relative_humidity"] == 50 else 4

    def rows(time, failed):
        found = []
        for entry in ENTRIES["resolved-grasps"]:
            k, at, vain = entry.labels["repeat"], time(entry.labels), failed(entry.labels)
            measures = Measures(66, 66, 2800, 60.0, at + k, 66 + vain, vain, 3, 69, 2, lost_time=vain + 3.25)
            found.append(row_of(entry, outcome_of(measures, at + k, 0.0)))
        return found

    found = judged("resolved-grasps", rows(time, failed))
    # although the mean of all humidities is the same
    assert [f.verdict for f in found] == [HOLDS] * 8 + [HOLDS, HOLDS, FAILS, *[HOLDS] * 5]
    apart = found[10].ours.split("; ")
    dry, damp = (np.log((300 + way + np.arange(24)) / (300 + np.arange(24))).mean() for way in (60, -60))
    assert f"{math.exp(dry):.3g} " in apart[0] and f"{math.exp(damp):.3g} " in apart[2]
    even = verdicts("resolved-grasps", rows(lambda labels: 300, lambda labels: 4))
    assert even == [*[HOLDS] * 6, FAILS, UNDECIDED] * 2


def test_time_steps_that_change_something_and_that_only_may_have():
    """Five runs scatter too much for an equivalence within 10 %, though their medians are the same."""

    def rows(overlap, collisions, first):
        found = []
        for entry in ENTRIES["time-step"]:
            rate, k = entry.labels["rate"], entry.labels["repeat"]
            measures = Measures(66, 70, collisions(rate) + 10 * k, 60.0 + k, first + k)
            seen = {"overlap": overlap / rate if k < 6 else None, "ms_per_step": 2.0 + 0.01 * rate if k < 6 else None}
            found.append({**row_of(entry, outcome_of(measures, first + k, 0.0)), **seen})
        return found

    mine = rows(20, lambda rate: 2800 + 3000 * (rate == 10), 150)
    time, _, collisions, _, overlap, *_ = verdicts("time-step", mine)
    assert (time, collisions, overlap) == (HOLDS, FAILS, FAILS)
    few = [row for row in rows(6, lambda rate: 2800, 80) if row["repeat"] % 5 == 0]
    assert verdicts("time-step", few)[0] == UNDECIDED
    assert verdicts("time-step", [row for row in mine if row["rate"] < 100])[4] == NOT_RUN


def test_overlaps_and_times_are_observed(small):
    """Overlaps lessen with the time step."""
    plan = Plan(replace(small, arena=replace(small.arena, n_dust=4)), quick=True)
    entries = [e._replace(job=replace(e.job, n_robots=40, steps=30)) for e in EXPERIMENTS["time-step"].entries(plan)]
    entries = [e for e in entries if e.labels["type"] == "type1" and e.labels["rate"] in (10, 50)]
    rows = [row_of(e, done(e.job, None)) for e in entries]
    observed.observe(plan, None, rows)
    overlap = {row["rate"]: row["overlap"] for row in rows if row["repeat"] == 0}
    assert 0.02 < overlap[50] < 0.5 * overlap[10] < 0.5
    assert all((row["overlap"] is None) == (row["repeat"] > 0) for row in rows)
    assert np.isfinite([row["ms_per_step"] for row in rows if row["repeat"] == 0]).all()
