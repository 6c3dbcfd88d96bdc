"""What experiments find in made-up rows."""

from dataclasses import replace

import numpy as np
import pytest
from helpers_outcomes import PLAN, done, rows_of, type_rows

from iswarm_mj.experiments.analysis import paper
from iswarm_mj.experiments.analysis.findings import (
    FAILS,
    HOLDS,
    NOT_COMPARABLE,
    NOT_RUN,
    PREDICTED,
    TOO_FEW,
    UNDECIDED,
    number,
    verdict_of,
)
from iswarm_mj.experiments.analysis.measures import TIME, quartiles, values
from iswarm_mj.experiments.analysis.statistics import compare
from iswarm_mj.experiments.studies import density, hop_count, robustness, sensitivity, swarm_types
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.tasks.measures import Measures, fitness


class TestFindings:
    @pytest.mark.parametrize("name", EXPERIMENTS)
    def test_without_rows_nothing_was_run(self, name):
        found = EXPERIMENTS[name].findings([])
        assert found and {finding.verdict for finding in found} == {NOT_RUN}

    def test_hop_counts_that_help(self):
        def outcome(entry):
            job, k = entry.job, entry.labels["repeat"]
            if job.genome.use_hop_count:
                return done(job, 150 + k, 66, 3000 + k, 60.0 + k)
            return done(job, None, 20 + k, 9000 + k, 300.0 + k)

        rows = rows_of(hop_count.entries(PLAN), outcome)
        found = hop_count.findings(rows)
        assert [finding.verdict for finding in found] == [HOLDS] * 4
        assert "12 of 12 runs reached 66 balls with, 0 of 12 without" in found[0].ours
        assert found[0].ours.startswith("median 156 (third quartile 158) steps with, 1200 (third quartile 1200) steps")
        assert "U = 0," in found[0].statistics and "U = 144," in found[1].statistics

    def test_hop_counts_that_hinder_or_do_nothing(self):
        """Statements turned round do not hold; equal samples leave open what scatters, and refute what does not."""
        entries = hop_count.entries(PLAN)
        worse = rows_of(entries, lambda e: done(e.job, 400 if e.job.genome.use_hop_count else 150 + e.labels["repeat"]))
        assert hop_count.findings(worse)[0].verdict == FAILS
        same = rows_of(entries, lambda e: done(e.job, 150 + e.labels["repeat"]))
        assert [finding.verdict for finding in hop_count.findings(same)] == [UNDECIDED, FAILS, FAILS, FAILS]

    @pytest.mark.parametrize("name", EXPERIMENTS)
    def test_the_runs_of_a_quick_version_are_too_few(self, name):
        """Nothing is judged, however clear the runs are."""
        rows = rows_of(
            EXPERIMENTS[name].entries(replace(PLAN, quick=True)), lambda e: done(e.job, 100 + e.labels["repeat"])
        )
        rows = [row | {"aggregation": 0.3, "overlap": 0.05, "ms_per_step": 2.0} for row in rows]
        found = EXPERIMENTS[name].findings(rows)
        verdicts = {finding.verdict for finding in found}
        assert verdicts <= {TOO_FEW, NOT_RUN, ""} and (TOO_FEW in verdicts or name == "infer")  # which judges nothing

    @pytest.mark.parametrize(
        "best, sparse, verdicts",
        [
            (0.15, None, [HOLDS, HOLDS, HOLDS, HOLDS, HOLDS, HOLDS, FAILS]),
            (0.2, 900, [FAILS, FAILS, FAILS, UNDECIDED, HOLDS, FAILS, FAILS]),
            (0.4, None, [FAILS, FAILS, FAILS, FAILS, HOLDS, HOLDS, FAILS]),
        ],
    )
    def test_densities(self, best, sparse, verdicts):
        """All measures are lowest at one density; 0.05 finishes late or not at all, all others do."""

        def outcome(entry):
            d, k = entry.labels["density"], entry.labels["repeat"]
            far = 1 + abs(d - best)
            time = sparse if d == 0.05 else round(150 * far) + k
            return done(entry.job, time, 66 if time else 40, round(280 * far * entry.job.n_robots), 60 * far)

        found = density.findings(rows_of(density.entries(PLAN), outcome))
        assert [finding.verdict for finding in found] == verdicts
        assert found[0].ours.startswith(f"lowest median at {best:g}; 0.05: ")
        assert f"the lowest median is at {best:g} in 100 % of 9999 bootstrap" in found[0].statistics

    def test_densities_that_are_alike_are_open(self):
        """The times of all scatter alike, so that any may be lowest; half of the runs of 0.05 finish."""

        def outcome(entry):
            d, k = entry.labels["density"], entry.labels["repeat"]
            time = None if d == 0.05 and k % 2 else 150 + (k * round(1000 * d) // 50 * 7) % 30
            return done(entry.job, time, 66 if time else 40)

        found = density.findings(rows_of(density.entries(PLAN), outcome))
        assert (found[0].verdict, found[3].verdict, found[5].verdict) == (UNDECIDED,) * 3

    def test_a_choice_that_slows_the_swarm_down(self):
        """Wrong bits triple the time; a wall range stops all but two runs."""

        def outcome(entry):
            choice, k = entry.labels["choice"], entry.labels["repeat"]
            if entry.labels["choice"] == "optics.wall_range" and k > 1:
                return done(entry.job, None, 10)
            return done(entry.job, (450 if choice == "optics.independent_bit_errors" else 150) + k)

        rows = rows_of(sensitivity.entries(PLAN), outcome)
        reaches, grips, changes = sensitivity.findings(rows)
        assert reaches.verdict == UNDECIDED and "wall_range = 0.75: 2/10 runs" in reaches.ours
        assert grips.verdict == HOLDS and grips.ours == "4 of 4 choices"
        assert "independent_bit_errors = True: +300 (+298 to +302" in changes.ours
        assert "dust_range" not in changes.ours
        found = {change.effect.label: change for change in sensitivity.changes(rows)}
        same, slow = found["random_turn = 90.0"], found["independent_bit_errors = True"]
        assert same.effect.value.estimate == 0 and same.p == same.adjusted == 1.0
        assert (
            slow.adjusted == pytest.approx(min(1, len(found) * slow.p))
            and f"by Holm {number(slow.adjusted, 2)})" in changes.ours
        )

    def test_a_choice_with_which_no_run_gets_there(self):
        """At 50 % of humidity, by arithmetic; elsewhere the statement on the choices themselves fails."""

        def rows(name):
            def outcome(entry):
                fails = (entry.labels["choice"], entry.labels["value"]) == name
                return done(entry.job, None if fails else 150 + entry.labels["repeat"], 10 if fails else 66)

            return rows_of(sensitivity.entries(PLAN), outcome)

        humid, blind = rows(("gripper.relative_humidity", "50.0")), rows(("optics.line_of_sight", "False"))
        assert [f.verdict for f in sensitivity.findings(humid)] == [HOLDS, FAILS, ""]
        assert [f.verdict for f in sensitivity.findings(blind)] == [FAILS, HOLDS, ""]

    def test_robustness(self):
        def outcome(entry):
            share, k = entry.labels["fraction"], entry.labels["repeat"]
            slow = 2 if entry.labels["kind"] == "dead" else 1
            return done(entry.job, None if share == 0.5 and slow == 2 else round(150 * (1 + slow * share)) + k)

        rows = rows_of(robustness.entries(PLAN), outcome)
        robust, cost = robustness.findings(rows)
        assert robust.verdict == FAILS and "50 %: 0 of 12 runs, median 1200 steps" in robust.ours
        assert cost.ours.startswith("10 %: 15 steps (") and "50 %: 970 steps (" in cost.ours and cost.verdict == HOLDS
        assert cost.statistics.count("(") == 5 and "adjusted by Holm for 5 shares, n = 12 + 12 each" in cost.statistics

    def test_bodies_that_cost_nothing(self):
        rows = rows_of(robustness.entries(PLAN), lambda e: done(e.job, 150 + 7 * e.labels["repeat"] % 12))
        assert [finding.verdict for finding in robustness.findings(rows)] == [HOLDS, UNDECIDED]

    def test_types_that_are_the_papers(self):
        """Times about 310 and 311 steps and the fitness that follows from them; aggregation is compared."""
        clean, times, alike, least, fitness, as_fit, gather = swarm_types.findings(type_rows(310, 311))
        assert [f.verdict for f in (clean, times, alike, fitness, as_fit, gather)] == [HOLDS] * 6
        assert {f.kind for f in (clean, alike, least, as_fit, gather)} == {PREDICTED}
        assert clean.ours == "96 of 96 runs of type1, 96 of 96 runs of type2"
        assert times.ours.startswith("type1: median 313 steps (95 % interval 303 to 321), +1 %; type2: ")
        assert "within ±31.2 steps, 10 % of the medians" in alike.statistics
        assert "within ±389 points, 5 % of the paper's 7771" in as_fit.statistics

    def test_the_fittest_of_many_runs_is_not_a_fresh_run(self):
        """Table 2 has the fittest swarms of an evolution; what compares with it says so."""
        found = [f for f in swarm_types.findings(type_rows(310, 311)) if "the paper's" in f.claim]
        assert [f.kind for f in found] == [NOT_COMPARABLE] * 2
        assert all("the fittest run of each type among the 1200" in f.statistics for f in found)

    @pytest.mark.parametrize(
        "one, two, repeats, verdicts",
        [
            (310, 380, 96, [FAILS, FAILS, FAILS, FAILS]),  # 22 % later; 7075 points, 9 % off
            (200, 201, 96, [FAILS, HOLDS, FAILS, HOLDS]),
            (310, 360, 8, [UNDECIDED, UNDECIDED, UNDECIDED, UNDECIDED]),
            (310, 345, 4, [TOO_FEW, TOO_FEW, TOO_FEW, TOO_FEW]),
        ],
    )
    def test_types_that_are_not(self, one, two, repeats, verdicts):
        """By intervals: what differs is told from what is only uncertain, and nothing follows from a few runs."""
        rows = [row for row in type_rows(one, two) if row["repeat"] < repeats]
        found = {f.claim: f.verdict for f in swarm_types.findings(rows)}
        claims = (swarm_types.TIMES, swarm_types.ALIKE, swarm_types.FITNESS, swarm_types.AS_FIT)
        assert [found[claim.text] for claim in claims] == verdicts

    @pytest.mark.parametrize(
        "time, early, repeats, verdict",
        [
            (250, 0, 96, HOLDS),  # of 0 of 96 the interval ends at 3.8 %
            (None, 0, 96, HOLDS),
            (250, 0, 24, UNDECIDED),
            (250, 3, 96, UNDECIDED),
            (250, 12, 96, FAILS),  # of 12 of 96 it begins at 6.6 %
            (250, 3, 3, TOO_FEW),
        ],
    )
    def test_runs_that_are_faster_than_the_papers_shortest_time(self, time, early, repeats, verdict):
        """The first `early` runs of type 2 finish in 249 steps, the others at `time`."""
        rows = [
            row | {"finished_at": 249 if row["type"] == "type2" and row["repeat"] < early else time}
            for row in type_rows(310, 311)
            if row["repeat"] < repeats
        ]
        (found,) = (f for f in swarm_types.findings(rows) if f.claim == swarm_types.LEAST.text)
        assert found.verdict == verdict
        assert found.ours == f"0 of {repeats} runs of type1 do, {early} of {repeats} runs of type2 do"

    @pytest.mark.parametrize("points, collisions, n_robots, step", [(7771, 180, 280, 310), (7766, 80, 314, 311)])
    def test_the_papers_times_follow_from_its_fitness(self, points, collisions, n_robots, step):
        """The formula of section 4.6 gives the paper's points with so many collisions a robot, and not a step later."""
        made = Measures(72, 72, collisions * n_robots, None, step)
        assert paper.latest_finish(points) == step
        assert fitness(made, n_robots, 72, 800) == pytest.approx(points)
        assert fitness(made._replace(collisions=0, finished_at=step + 1), n_robots, 72, 800) < points

    def test_another_preset_is_held_against_both_types(self):
        rows = [
            {
                **e.labels,
                "aggregation": None,
                "goal": 72,
                "max_steps": 800,
                "finished_at": 400,
                "fitness": 100 * (e.labels["type"] == "evolved") + e.labels["repeat"],
            }
            for e in swarm_types.entries(PLAN)
        ]
        better = [f for f in swarm_types.findings(rows) if "preset" in f.claim]
        assert [(f.claim, f.verdict) for f in better] == [
            ("The preset evolved is fitter than type1", HOLDS),
            ("The preset evolved is fitter than type2", HOLDS),
        ]

    def test_aggregation_by_hand(self):
        """Of the empty workers two of three are near a dust area in the first step, none in the second."""
        rd = 2e-3 * np.sqrt(2)
        far = [0.0, 20 * rd, 0.0]
        near, edge = [16 * rd, 0.0, 0.0], [(16 - 3 - 3.4) * rd, 0.0, 0.0]
        frames = {
            "pose": np.array([[near, edge, far, near, near], [far] * 5, [near] * 5]),
            "is_loaded": np.array([[False, False, False, True, False]] * 3),
            "scene_is_scout": np.array([False, False, False, False, True]),
            "scene_dust_areas": np.array([[13.0, -3, 19, 3], [-19, -3, -13, 3]]) * rd,
            "ball_position": np.zeros((3, 4, 3)),
            "delivered": np.array([0, 1, 2]),
        }
        assert swarm_types.aggregation(frames) == pytest.approx((2 / 3 + 0) / 2)

    def test_a_verdict_needs_a_direction_and_an_interval(self):
        low, high = np.arange(12.0), np.arange(12.0) + 20
        assert verdict_of(compare(high, low), is_larger=True) == HOLDS
        assert verdict_of(compare(high, low), is_larger=False) == FAILS
        assert verdict_of(compare(low, low + 1), is_larger=False) == UNDECIDED
        assert verdict_of(compare(high[:4], low[:4]), is_larger=True) == TOO_FEW

    @pytest.mark.parametrize(
        "value, text",
        [
            (0.0, "0"),
            (-0.0, "0"),
            (1234.5, "1234"),
            (0.0123, "0.0123"),
            (2e-7, "2.00e-07"),
            (12.0, "12"),
            (159.4, "159"),
            (1.2e7, "1.20e+07"),
            (float("nan"), "undefined"),
        ],
    )
    def test_numbers_are_readable(self, value, text):
        assert number(value) == text

    def test_what_has_no_value_is_left_out(self):
        rows = [{"finished_at": None, "max_steps": 9}, {"finished_at": 4, "max_steps": 9}]
        assert values(rows, TIME).tolist() == [9, 4] and quartiles(np.array([])) == "no value"
