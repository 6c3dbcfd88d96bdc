"""What made-up searches and trials say on the paper's statements."""

import numpy as np
import pytest
from helpers_findings import grasp_rows, search_rows, settings_of

from iswarm_mj.experiments.analysis import evolution_figures, evolution_findings, grasp_findings, law_findings
from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, NOT_RUN, TOO_FEW, UNDECIDED


def by_claim(findings):
    return {finding.claim: finding for finding in findings}


@pytest.fixture(scope="module")
def found():
    """Findings of a made-up evolution beside a random search."""
    paper, random = (search_rows(), settings_of()), (search_rows(learns=False, seed=1), settings_of("random"))
    return by_claim(evolution_findings.findings({"paper": paper, "random": random}))


class TestEvolution:
    @pytest.mark.parametrize(
        "claim",
        [
            "RISES",
            "LEARNS",
            "BEATS",
            "MANY_FAIL",
            "COUNTED",
            "UNCOUNTED",
            "SCOUTS",
            "FORGET",
            "TRADE",
            "DENSITY",
            "SIGNALS",
            "WEIGHTS",
            "DISTANCES",
        ],
    )
    def test_a_search_that_goes_as_the_papers(self, found, claim):
        assert found[getattr(evolution_findings, claim).text].verdict == HOLDS

    def test_what_was_not_run_is_said(self, found):
        assert found[evolution_findings.RIVAL.text].verdict == NOT_RUN
        assert {f.verdict for f in evolution_findings.findings({})} == {NOT_RUN}

    def test_shares_are_counted(self, found):
        """Those that clean the arena all count hops, as they were made."""
        rows = search_rows()
        clean = sum(row["delivered"] == 72 for row in rows)
        assert found[evolution_findings.COUNTED.text].ours.startswith(f"{clean} of {clean}, 100.0 %")
        assert found[evolution_findings.MANY_FAIL.text].ours.startswith(f"{1200 - clean} of 1200, ")

    def test_a_search_that_learns_nothing(self):
        rows = search_rows(learns=False)
        for row, other in zip(rows, np.random.default_rng(2).uniform(0, 1, len(rows)), strict=True):
            row["p_vector_forget"] = float(other)
            row["use_hop_count"] = bool(other < 0.5)
        found = by_claim(evolution_findings.findings({"paper": (rows, settings_of())}))
        for claim in ("RISES", "COUNTED", "TRADE"):
            assert found[getattr(evolution_findings, claim).text].verdict == FAILS, claim
        assert found[evolution_findings.LEARNS.text].verdict == UNDECIDED

    @pytest.mark.parametrize("n, apart, verdict", [(1000, 0.0, HOLDS), (60, 0.2, UNDECIDED), (500, 1.0, FAILS)])
    def test_equal_is_what_surely_differs_by_little(self, n, apart, verdict):
        rng = np.random.default_rng(0)
        good, poor = ([{"x": v} for v in rng.normal(shift, 1, n)] for shift in (0, apart))
        assert evolution_findings._equal(evolution_findings.SCOUTS, "x", good, poor).verdict == verdict

    def test_the_best_runs_are_told_too(self, found):
        means = [
            np.mean(sorted(row["fitness"] for row in rows)[-100:])
            for rows in (search_rows(), search_rows(learns=False, seed=1))
        ]
        assert (
            f"of the 100 best runs {means[0]:.0f} against {means[1]:.0f}" in found[evolution_findings.BEATS.text].ours
        )

    def test_a_short_search_decides_nothing_that_needs_more(self):
        found = by_claim(evolution_findings.findings({"paper": (search_rows(10), settings_of())}))
        for claim in ("RISES", "LEARNS", "TRADE", "DENSITY", "SIGNALS"):
            assert found[getattr(evolution_findings, claim).text].verdict == UNDECIDED, claim

    @pytest.mark.parametrize(
        "n_good, n_counting, n_poor, n_not_counting, verdicts",
        [
            (5, 5, 4, 1, (UNDECIDED, UNDECIDED, UNDECIDED)),
            (29, 29, 29, 29, (HOLDS, UNDECIDED, UNDECIDED)),
            (60, 60, 40, 36, (HOLDS, HOLDS, HOLDS)),
            (60, 57, 40, 22, (HOLDS, UNDECIDED, UNDECIDED)),  # Wilson: 0.863 to 0.983, 0.398 to 0.693
            (970, 700, 30, 3, (FAILS, FAILS, FAILS)),
            (78, 78, 22, 0, (UNDECIDED, HOLDS, UNDECIDED)),  # Wilson: 0.150 to 0.311
        ],
    )
    def test_shares_are_judged_by_their_intervals(self, n_good, n_counting, n_poor, n_not_counting, verdicts):
        row = search_rows(1)[0]
        rows = [row | {"delivered": 72, "use_hop_count": k < n_counting} for k in range(n_good)]
        rows += [row | {"delivered": 40, "use_hop_count": k >= n_not_counting} for k in range(n_poor)]
        found = by_claim(evolution_findings.findings({"paper": (rows, settings_of())}))
        claims = (evolution_findings.MANY_FAIL, evolution_findings.COUNTED, evolution_findings.UNCOUNTED)
        assert tuple(found[claim.text].verdict for claim in claims) == verdicts

    def test_the_fittest_are_those_of_generations_35_to_100(self):
        rows = [{"generation": g, "fitness": float(g % 97), "individual": k} for g in range(120) for k in range(10)]
        top = evolution_figures.fittest(rows, 35, 100)
        assert (
            len(top) == 250
            and min(r["fitness"] for r in top) == 72
            and {r["generation"] for r in top} == set(range(72, 97))
        )


class TestGripper:
    def test_trials_that_go_as_the_papers(self):
        found = grasp_findings.findings(grasp_rows())
        assert {f.claim: f.verdict for f in found if f.verdict not in (HOLDS, "")} == {}
        assert sum("higher at" in f.claim for f in found) == 2

    @pytest.mark.parametrize(
        "changes, claim",
        [
            ({"grasp": 33.0}, "GRASP"),
            ({"release": 49.0}, "RELEASE"),
            ({"slope": 0.6}, "FLAT_GRASP"),
            ({"release": 75.0}, "THEORY"),
            ({"release": 60.0}, "ALIKE"),
        ],
    )
    def test_trials_that_do_not(self, changes, claim):
        found = by_claim(grasp_findings.findings(grasp_rows(**changes)))
        assert found[getattr(grasp_findings, claim).text].verdict == FAILS

    def test_single_trials_can_spoil_a_statement(self):
        rows = grasp_rows()
        rows[0]["voltage"] = 45.0
        next(r for r in rows if r["experiment"] == "grasp")["voltage"] = None
        next(r for r in rows if r["experiment"] == "release")["landed"] = False
        found = by_claim(grasp_findings.findings(rows))
        assert [found[getattr(grasp_findings, c).text].verdict for c in ("PURE", "ALWAYS", "RELIABLE")] == [FAILS] * 3

    def test_few_trials_do_not_show_that_all_succeed(self):
        """Of 25 of 25 the exact interval begins at 86 %; of four at a radius nothing is said."""
        found = by_claim(grasp_findings.findings(grasp_rows(repeats=5)))
        assert found[grasp_findings.RELIABLE.text].verdict == TOO_FEW
        assert "86.3 to 100.0 %" in found[grasp_findings.RELIABLE.text].statistics
        found = by_claim(grasp_findings.findings(grasp_rows(repeats=4)))
        assert found[grasp_findings.GRASP.text].verdict == TOO_FEW

    def test_a_slope_that_is_only_uncertain_is_open(self):
        found = by_claim(grasp_findings.findings(grasp_rows(slope=0.2)))
        assert found[grasp_findings.FLAT_GRASP.text].verdict == UNDECIDED

    def test_faulty_rows_do_not_count(self):
        rows = grasp_rows()
        for row in rows[::7]:
            row |= {"faulty": True, "voltage": 1000.0}
        assert FAILS not in {f.verdict for f in grasp_findings.findings(rows)}

    def test_laws(self):
        """The slips of the paper's numbers, and what its equations give; worked by hand in the laws' own tests."""
        found = {f.claim: f for f in law_findings.findings()}
        assert "106 to 1063 V; 123 to 1228 V" in found[law_findings.RANGE.text].ours
        assert (
            found[law_findings.CONSTANT.text].verdict == FAILS and "4.753e+05" in found[law_findings.CONSTANT.text].ours
        )
        assert found[law_findings.POINTS.text].ours == "2860 and 8380"
        assert "release 0.894, pick 0.57" in found[law_findings.ASYMPTOTE.text].ours
        assert found[law_findings.SQUARE.text].verdict == found[law_findings.SCALE.text].verdict == HOLDS
