"""One evolution as one sample: its quantities by hand, and what made-up searches say."""

import pytest
from support.findings import changed, found_in, search_rows

from iswarm_mj.paper.analysis.evolution import Evolution
from iswarm_mj.paper.analysis.evolution_statements import STATEMENTS, TRAITS
from iswarm_mj.paper.analysis.findings import NOT_RUN, TOO_FEW, UNDECIDED
from iswarm_mj.utils import intervals

CLAIMS = [statement.claim for statement in STATEMENTS[: -len(TRAITS)]]
RISES = CLAIMS[0]
BEATS_CHANCE = CLAIMS[2]
BEATS_RIVAL = CLAIMS[3]
SELECTION_CLAIMS = [f"Selection moves {trait}" for trait in TRAITS]


def verdicts(findings, claims):
    """Return the verdicts on some claims."""
    return {findings[claim].verdict for claim in claims}


class TestFindings:
    def test_few_evolutions_decide_nothing_however_many_runs_they_have(self, paper):
        findings = found_in([row for row in paper if row["replicate"] < 5])
        of_one_method = [claim for claim in CLAIMS if claim not in (BEATS_CHANCE, BEATS_RIVAL)]
        assert verdicts(findings, of_one_method) == {TOO_FEW}
        assert "(" not in findings[RISES].ours  # no interval

    def test_one_difference_among_several_traits_may_be_chance(self, paper, random, monkeypatch):
        """The interval leaves out zero, its p-value is below 0.05, and that by Holm is not."""
        monkeypatch.setattr(intervals, "RESAMPLES", 9999)  # for so near a miss
        by_chance = changed(random, lambda row, n: {"density_of_robots": 0.04 + 0.04 * n})
        evolved = changed(paper, lambda row, n: {"density_of_robots": 0.17 + 0.04 * n})
        finding = found_in(evolved, random=by_chance)["Selection moves the density of robots"]
        assert finding.verdict == UNDECIDED
        assert finding.ours.endswith("(0.01 to 0.27)")
        assert "by Holm p = 0.14;" in finding.statistics

    def test_selection_needs_replicates_of_random_search(self, paper):
        assert verdicts(found_in(paper), SELECTION_CLAIMS) == {NOT_RUN}
        one_search = found_in(paper, random=search_rows(learns=False))
        assert verdicts(one_search, SELECTION_CLAIMS) == {TOO_FEW}


class TestFittest:
    """Those of generations 35 to 100, where the first one is number 1."""

    @staticmethod
    def rows(fitness_of):
        """Return 120 generations of ten runs whose fitness depends on the generation."""
        rows = []
        for generation in range(120):
            row = {"generation": generation, "fitness": float(fitness_of(generation))}
            rows += [{**row, "delivered": 0, "use_hop_count": True}] * 10
        return rows

    def test_they_are_250(self):
        """Fitness rises up to the 97th generation, and then begins again."""
        fittest = Evolution(self.rows(lambda generation: generation % 97), 72).fittest
        assert len(fittest) == 250
        assert {row["generation"] for row in fittest} == set(range(72, 97))

    def test_generations_just_before_and_behind_are_left_out(self):
        rows = self.rows(lambda generation: generation in (33, 34, 99, 100))
        fit = [row["generation"] for row in Evolution(rows, 72).fittest if row["fitness"]]
        assert sorted(fit) == [34] * 10 + [99] * 10


class TestQuantities:
    """40 generations of two runs, of which the second cleans the arena and is fitter by 50."""

    @pytest.fixture
    def rows(self):
        """Return the rows of the search."""
        rows = []
        for generation in range(40):
            failed = {
                "generation": generation,
                "delivered": 0,
                "fitness": 100.0 * generation,
                "use_hop_count": False,
                "fraction_scouts": 0.1,
                "density_of_robots": generation / 100,
            }
            clean = {
                **failed,
                "delivered": 72,
                "fitness": failed["fitness"] + 50,
                "use_hop_count": True,
                "fraction_scouts": 0.3,
            }
            rows += [failed, clean]
        return rows

    @pytest.fixture
    def evolution(self, rows):
        """Return the search as a sample."""
        return Evolution(rows, 72)

    def test_the_fitness_of_generations(self, evolution):
        assert list(evolution.bests[:2]) == [50.0, 150.0]
        assert list(evolution.means[:2]) == [25.0, 125.0]
        assert evolution.rise == 1.0
        assert evolution.final_fitness == 29.5 * 100 + 25
        assert evolution.gain == (29.5 - 2.0) * 100

    def test_the_last_generations(self, evolution):
        assert evolution.density == pytest.approx(0.295)
        assert evolution.late_mean("fraction_scouts") == pytest.approx(0.2)

    def test_clean_arenas_against_others(self, evolution, rows):
        assert evolution.cleaning_difference("fraction_scouts") == pytest.approx(0.2)
        assert evolution.exception_share == 0.0
        assert Evolution(rows[:58], 72).cleaning_difference("x") is None

    def test_a_short_search_has_no_fittest(self, evolution):
        assert evolution.fittest == []
        assert evolution.forgetting_against_scouts is None
