"""What made-up searches say on the statements of section 4.6.1, with one evolution as one sample."""

import numpy as np
import pytest
from helpers_findings import changed, found_in, replicated, search_rows, settings_of

from iswarm_mj.experiments.analysis import evolution_claims as claims
from iswarm_mj.experiments.analysis import evolution_figures, evolution_findings
from iswarm_mj.experiments.analysis.evolution_best import by_replicate
from iswarm_mj.experiments.analysis.evolution_sample import Evolution, evolutions, fittest
from iswarm_mj.experiments.analysis.evolution_statements import STATEMENTS
from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, NOT_RUN, TOO_FEW, UNDECIDED
from iswarm_mj.output.plot_style import blank

JUDGED = [claim for claim in claims.CLAIMS if claim is not claims.RIVAL]
OF_THE_EVOLUTION = [claim for claim in JUDGED if claim is not claims.BEATS]


@pytest.fixture(scope="module")
def found(paper, random):
    return found_in(paper, random=random)


class TestReplicates:
    @pytest.mark.parametrize("claim", JUDGED, ids=lambda claim: claim.text)
    def test_evolutions_that_go_as_the_papers(self, found, claim):
        assert found[claim.text].verdict == HOLDS

    def test_what_was_not_run_is_said(self, found):
        assert found[claims.RIVAL.text].verdict == NOT_RUN
        nothing = evolution_findings.findings({})
        assert {f.verdict for f in nothing} == {NOT_RUN} and [f.claim for f in nothing] == list(found)

    @pytest.mark.parametrize("n", [1, 5])
    @pytest.mark.parametrize("claim", OF_THE_EVOLUTION, ids=lambda claim: claim.text)
    def test_few_evolutions_decide_nothing(self, paper, n, claim):
        """However many runs they have."""
        finding = found_in([row for row in paper if row["replicate"] < n])[claim.text]
        assert finding.verdict == TOO_FEW and "95 %" not in finding.ours
        assert f"one evolution is one sample: no interval over evolutions from {n}, needs 6" in finding.statistics

    def test_a_table_without_replicates_is_of_one_search(self, paper):
        rows = search_rows()
        assert by_replicate(rows) == [rows]
        assert found_in(rows) == found_in([{"replicate": 0, **row} for row in rows])
        assert [len(mine) for mine in by_replicate(paper[::-1])] == [1200] * 8
        assert by_replicate(paper[::-1])[0][0]["replicate"] == 0

    def test_medians_and_signs_are_over_evolutions(self, paper, found):
        shares = [np.mean([row["delivered"] != 72 for row in mine]) for mine in by_replicate(paper)]
        finding = found[claims.MANY_FAIL.text]
        total = sum(row["delivered"] != 72 for row in paper)
        assert finding.ours.startswith(
            f"{total} of 9600 runs; median over 8 evolutions {100 * np.median(shares):.3g} %"
        )
        assert finding.ours.endswith(f"from {100 * min(shares):.3g} to {100 * max(shares):.3g}")
        assert "8 of 8 above 20, sign test p = 0.0078" in finding.statistics  # 2 / 2^8
        assert finding.statistics.startswith("interval by order statistics over 8 evolutions; ")

    @pytest.mark.parametrize("n, verdict", [(2, HOLDS), (3, TOO_FEW)])
    def test_evolutions_without_a_value_do_not_count(self, paper, n, verdict):
        """Those of which no run cleans the arena say nothing of the runs that do."""
        rows = changed(paper, lambda row, number: {"delivered": 40} if number < n else {})
        finding = found_in(rows)[claims.COUNTED.text]
        assert finding.verdict == verdict and finding.ours.endswith(f"; {n} evolutions without 30 such runs")

    @pytest.mark.parametrize("falling, verdict", [(8, HOLDS), (4, UNDECIDED), (0, FAILS)])
    def test_evolutions_that_disagree_leave_it_open(self, paper, falling, verdict):
        """The pooled runs of eight evolutions would decide it in each case."""
        rows = changed(
            paper,
            lambda row, n: {} if n < falling else {"p_vector_forget": 0.2 + 0.7 * row["fraction_scouts"]},
        )
        assert found_in(rows)[claims.TRADE.text].verdict == verdict

    @pytest.mark.parametrize(
        "shift, verdict",
        [(lambda n: 0.0, HOLDS), (lambda n: 0.1, FAILS), (lambda n: 0.1 * (-1) ** n, UNDECIDED)],
        ids=["equal", "apart", "open"],
    )
    def test_equal_is_what_surely_lies_within_a_mutation(self, paper, shift, verdict):
        rows = changed(
            paper,
            lambda row, n: {"fraction_scouts": row["fraction_scouts"] + (shift(n) if row["delivered"] < 72 else 0)},
        )
        finding = found_in(rows)[claims.SCOUTS.text]
        assert finding.verdict == verdict and "within -0.05 to 0.05" in finding.statistics

    @pytest.mark.parametrize(
        "density, verdict",
        [(lambda n: 0.13 + 0.001 * n, HOLDS), (lambda n: 0.3, FAILS), (lambda n: 0.08 + 0.02 * n, UNDECIDED)],
        ids=["there", "elsewhere", "spread"],
    )
    def test_densities(self, paper, density, verdict):
        rows = changed(paper, lambda row, n: {"density_of_robots": density(n)})
        finding = found_in(rows)[claims.DENSITY.text]
        assert finding.verdict == verdict
        middle = np.median([density(n) for n in range(8)])
        assert f"median over 8 evolutions {100 * middle:.3g} %" in finding.ours

    @pytest.mark.parametrize("n, verdict", [(8, HOLDS), (4, UNDECIDED), (0, FAILS)])
    def test_signals_are_counted_by_best_genomes(self, paper, n, verdict):
        rows = changed(paper, lambda row, number: {"priority_signal_loaded": number < n})
        finding = found_in(rows)[claims.SIGNALS.text]
        assert finding.verdict == verdict and finding.ours.startswith(f"{n} of 8 evolutions by their best genomes")
        assert f"priority-signal-loaded in {n} of 8, priority-signal-scouts in 0 of 8" in finding.ours

    def test_evolutions_that_learn_nothing(self, random):
        rng = np.random.default_rng(2)
        rows = [row | {"p_vector_forget": rng.uniform(), "use_hop_count": rng.random() < 0.5} for row in random]
        found = found_in([row | {"use_hop_count": bool(row["use_hop_count"])} for row in rows])
        for claim in (claims.RISES, claims.COUNTED):
            assert found[claim.text].verdict == FAILS, claim
        for claim in (claims.LEARNS, claims.TRADE):
            assert found[claim.text].verdict == UNDECIDED, claim

    @pytest.mark.parametrize("below, verdict", [(3, HOLDS), (4, UNDECIDED), (12, UNDECIDED), (13, FAILS)])
    def test_how_many_of_sixteen_evolutions_must_rise(self, below, verdict):
        """The interval of the median of 16 goes from the fourth value to the thirteenth."""
        (item,) = (item for item in STATEMENTS if item.claim is claims.RISES)
        row = {"delivered": 72, "generation": 0, "fitness": 1.0}
        sample = evolutions([{**row, "replicate": n} for n in range(16)], 72)
        rise = {one: (0.4 if n < below else 0.7) + 0.001 * n for n, one in enumerate(sample)}
        alone = item._replace(value=rise.__getitem__, told=lambda sample: "")
        assert evolution_findings._judged(alone, sample).verdict == verdict

    def test_short_searches_decide_nothing_that_needs_more(self):
        found = found_in(replicated(6, generations=10))
        for claim, needs in (
            (claims.RISES, "35 generations"),
            (claims.LEARNS, "25 generations"),
            (claims.TRADE, "100 generations"),
            (claims.DENSITY, "25 generations"),
        ):
            assert found[claim.text].verdict == TOO_FEW and f"needs {needs}" in found[claim.text].statistics

    def test_the_last_generations_are_told_too(self, paper, random, found):
        best, last = (
            [np.median([value(mine) for mine in by_replicate(rows)]) for rows in (paper, random)]
            for value in (
                lambda mine: np.mean(sorted(row["fitness"] for row in mine)[-100:]),
                lambda mine: np.mean([row["fitness"] for row in mine if row["generation"] >= 100]),
            )
        )
        told = found[claims.BEATS.text].ours
        assert told.startswith(f"mean fitness of the 100 best runs {best[0]:.0f} against {best[1]:.0f} points, of the ")
        assert f"last 20 generations {last[0]:.0f} against {last[1]:.0f}; medians of 8 and 8 searches" in told
        one = found_in(paper, random=search_rows(learns=False))[claims.BEATS.text]
        assert one.verdict == TOO_FEW

    @pytest.mark.parametrize("claim, method, verdict", [(claims.BEATS, "random", FAILS), (claims.RIVAL, "cmaes", "")])
    def test_searches_are_compared_by_their_best_runs(self, paper, claim, method, verdict):
        """One that finds fitter swarms in its first generations is better, however unfit its last ones are."""
        early = changed(paper, lambda row, n: {"fitness": 9000.0 if row["generation"] < 20 else 0.0})
        finding = found_in(paper, **{method: early})[claim.text]
        assert finding.verdict == verdict and "last 20 generations" in finding.ours
        assert "by their 100 best runs: Mann-Whitney U = 0, " in finding.statistics


def test_the_fittest_are_those_of_generations_35_to_100():
    rows = [{"generation": g, "fitness": float(g % 97), "individual": k} for g in range(120) for k in range(10)]
    top = fittest(rows, 35, 100)
    assert (
        len(top) == 250
        and min(r["fitness"] for r in top) == 72
        and {r["generation"] for r in top} == set(range(72, 97))
    )


def test_the_first_and_the_last_generation_of_the_plateau_count():
    """The first generation is number 1; those just before and just behind are as fit, and left out."""
    rows = [{"generation": g, "fitness": float(g in (33, 34, 99, 100))} for g in range(120) for _ in range(10)]
    assert sorted(r["generation"] for r in fittest(rows, 35, 100) if r["fitness"]) == [34] * 10 + [99] * 10


def test_quantities_of_one_search():
    """By hand: 40 generations of two runs, of which the second cleans the arena and is the fitter one."""
    rows = []
    for generation in range(40):
        for clean in (False, True):
            genome = {"fraction_scouts": 0.3 if clean else 0.1, "density_of_robots": generation / 100}
            fitness = 100.0 * generation + (50 if clean else 0)
            rows.append({"generation": generation, "delivered": 72 if clean else 0, "fitness": fitness, **genome})
    one = Evolution(rows, 72)
    assert one.rise == 1.0 and list(one.bests[:2]) == [50.0, 150.0] and list(one.means[:2]) == [25.0, 125.0]
    assert one.gain == (29.5 - 2.0) * 100 and one.final == 29.5 * 100 + 25
    assert one.density == pytest.approx(0.295) and one.late("fraction_scouts") == pytest.approx(0.2)
    assert one.apart("fraction_scouts") == pytest.approx(0.2) and Evolution(rows[:58], 72).apart("x") is None
    assert one.trade is None and one.top == []


class TestFigures:
    def test_replicates_are_lines_and_their_median_is_the_thick_one(self, paper):
        _, (axes,) = blank()
        evolutions_drawn = evolutions(paper, 72)
        evolution_figures._draw_all(axes, evolutions_drawn)
        lines = [line for line in axes.get_lines() if len(line.get_xdata()) == 120]
        so_far = np.array([np.maximum.accumulate(one.bests) for one in evolutions_drawn])
        np.testing.assert_array_equal([line.get_ydata() for line in lines[:8]], so_far)
        thick = max(lines, key=lambda line: line.get_linewidth())
        np.testing.assert_array_equal(thick.get_ydata(), np.median(so_far, axis=0))

    def test_files(self, paper, random, tmp_path):
        searches = {"paper": (paper, settings_of()), "random": (random, settings_of("random"))}
        drawn = [path for search in searches.values() for path in evolution_figures.draw_search(*search, tmp_path)]
        drawn += evolution_figures.draw_traits(searches, tmp_path)
        assert [path.name for path in drawn] == [
            "evolution_paper.png",
            "trade.png",
            "evolution_random.png",
            "traits.png",
        ]
        assert all(path.read_bytes().startswith(b"\x89PNG") for path in drawn)
        assert evolution_figures.draw_traits({"paper": (search_rows(), settings_of())}, tmp_path) == []
