"""Selection against drift, in made-up searches."""

import numpy as np
import pytest
from helpers_findings import changed, found_in, search_rows

from iswarm_mj.experiments.analysis import evolution_selection
from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, NOT_RUN, TOO_FEW, UNDECIDED
from iswarm_mj.experiments.analysis.statistics import Interval

TRAITS = {trait.label: trait.claim for trait in evolution_selection.TRAITS}


class TestSelection:
    """Random searches of densities around 0.17."""

    def verdict(self, paper, random, density):
        rng = np.random.default_rng(0)
        by_chance = changed(random, lambda row, n: {"density_of_robots": rng.uniform(0.01, 0.33)})
        mine = changed(paper, lambda row, n: {"density_of_robots": density(n)})
        return found_in(mine, random=by_chance)[TRAITS["density"].text]

    def test_a_common_density_was_selected(self, paper, random):
        finding = self.verdict(paper, random, lambda n: 0.12 + 0.002 * n)
        assert finding.verdict == HOLDS
        # 2 of the 12870 ways to rank 8 and 8 are as extreme; Holm's factor is that of 8 traits at most
        assert "Mann-Whitney p = 1.6e-04" in finding.statistics and "by Holm for 8 traits" in finding.statistics

    def test_one_difference_among_several_traits_may_be_chance(self, paper, random):
        """Its interval leaves out zero, its p-value is below 0.05, and that by Holm is not."""
        by_chance = changed(random, lambda row, n: {"density_of_robots": 0.04 + 0.04 * n})
        mine = changed(paper, lambda row, n: {"density_of_robots": 0.17 + 0.04 * n})
        finding = found_in(mine, random=by_chance)[TRAITS["density"].text]
        assert finding.verdict == UNDECIDED
        assert "95 % interval 0.01 to 0.27), Mann-Whitney p = 0.021, 0.14 by Holm for 8 traits" in finding.statistics
        assert "holds if that is below 0.05 and the interval leaves out zero, else does not" in finding.statistics

    def test_drift_ends_anywhere(self, paper, random):
        assert self.verdict(paper, random, lambda n: 0.03 + 0.04 * n).verdict == UNDECIDED

    def test_what_stays_near_was_not_moved(self, paper, random):
        assert self.verdict(paper, random, lambda n: 0.165 + 0.002 * n).verdict == FAILS

    @pytest.mark.parametrize(
        ("elites", "others", "verdict"),
        [
            (lambda row: True, lambda row: row["individual"] < 5, HOLDS),
            (lambda row: row["individual"] == 0, lambda row: True, FAILS),
            (lambda row: row["replicate"] < 4, lambda row: row["individual"] < 6, UNDECIDED),
        ],
    )
    def test_booleans_are_those_of_elites(self, paper, random, elites, others, verdict):
        """Whatever mutations make of the others."""

        def of_mine(row, n):
            is_elite = row["individual"] < 2
            flag = (elites if is_elite else others)(row)
            return {"origin": "elite" if is_elite else "mutation", "priority_signal_loaded": flag}

        by_chance = changed(random, lambda row, n: {"priority_signal_loaded": row["individual"] % 2 == 0})
        finding = found_in(changed(paper, of_mine), random=by_chance)[TRAITS["loaded signal"].text]
        assert finding.verdict == verdict

    def test_without_replicates_of_both_nothing_is_said(self, paper):
        traits = [claim.text for claim in TRAITS.values()]
        assert {found_in(paper)[text].verdict for text in traits} == {NOT_RUN}
        few = found_in(paper, random=search_rows(learns=False))
        assert {few[text].verdict for text in traits} == {TOO_FEW}


@pytest.mark.parametrize(
    ("low", "high", "p", "verdict"),
    [
        (0.01, 0.2, 0.04, HOLDS),
        (-0.2, -0.01, 0.04, HOLDS),
        (-0.2, -0.01, 0.05, UNDECIDED),
        (0.01, 0.04, 0.06, FAILS),
        (-0.05, 0.05, 0.04, FAILS),
        (-0.06, 0.04, 0.04, UNDECIDED),
        (-0.04, 0.06, 1.0, UNDECIDED),
    ],
)
def test_a_median_that_differs_was_moved(low, high, p, verdict):
    assert evolution_selection._moved(Interval(0.0, low, high), p, 0.05) == verdict
