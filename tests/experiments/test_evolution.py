"""One evolution as one sample: its quantities by hand, and what made-up searches say on the statements."""

import numpy as np
import pytest
from helpers_findings import changed, found_in, search_rows

from iswarm_mj.experiments.analysis import statistics
from iswarm_mj.experiments.analysis.evolution import Evolution
from iswarm_mj.experiments.analysis.evolution_statements import STATEMENTS, TRAITS
from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, NOT_RUN, TOO_FEW, UNDECIDED

CLAIMS = [statement.claim for statement in STATEMENTS[: -len(TRAITS)]]
RISES, LEARNS, BEATS, RIVAL, AS_FIT, SLOW, MANY_FAIL, COUNTED, _, EXCEPTIONS, SCOUTS_LEVEL, FORGET_LEVEL = CLAIMS[:12]
SCOUTS, FORGET, TRADE, DENSITY, SIGNALS, *_ = CLAIMS[12:]
JUDGED = [claim for claim in CLAIMS if claim is not RIVAL]
MOVED = {trait: f"Selection moves {trait}" for trait in TRAITS}


def test_evolutions_that_go_as_the_papers(paper, random):
    found = found_in(paper, random=random)
    assert {claim: found[claim].verdict for claim in JUDGED} == dict.fromkeys(JUDGED, HOLDS)
    assert found[RIVAL].verdict == NOT_RUN
    assert {statement.finding({}).verdict for statement in STATEMENTS} == {NOT_RUN}


def test_few_evolutions_decide_nothing(paper):
    """However many runs they have."""
    found = found_in([row for row in paper if row["replicate"] < 5])
    assert {found[claim].verdict for claim in JUDGED if claim is not BEATS} == {TOO_FEW}
    assert "(" not in found[RISES].ours  # no interval


def test_evolutions_without_a_value_do_not_count_and_those_that_disagree_leave_it_open(paper):
    """Those of which no run cleans the arena say nothing of the runs that do; pooled runs would decide the trade."""
    for n, verdict in ((2, HOLDS), (3, TOO_FEW)):
        finding = found_in(changed(paper, lambda row, k, n=n: {"delivered": 40} if k < n else {}))[COUNTED]
        assert finding.verdict == verdict and f"over 8 evolutions, n = {8 - n};" in finding.statistics
    for n, verdict in ((4, UNDECIDED), (0, FAILS)):
        rows = changed(
            paper, lambda row, k, n=n: {} if k < n else {"p_vector_forget": 0.2 + 0.7 * row["fraction_scouts"]}
        )
        assert found_in(rows)[TRADE].verdict == verdict


@pytest.mark.parametrize(
    "shift, verdict",
    [(lambda n: 0.0, HOLDS), (lambda n: 0.1, FAILS), (lambda n: 0.1 * (-1) ** n, UNDECIDED)],
    ids=["equal", "apart", "open"],
)
def test_equal_is_what_surely_lies_within_a_mutation(paper, shift, verdict):
    def of(row, n):
        off = shift(n) if row["delivered"] < 72 else 0
        return {"fraction_scouts": 0.16 + off, "p_vector_forget": 0.28 + off}

    found = found_in(changed(paper, of))
    assert [found[claim].verdict for claim in (SCOUTS, FORGET)] == [verdict] * 2


def test_densities_are_of_the_last_20_generations(paper):
    for density, verdict in ((lambda n: 0.13 + 0.001 * n, HOLDS), (lambda n: 0.08 + 0.02 * n, UNDECIDED)):
        rows = changed(
            paper, lambda row, n, of=density: {"density_of_robots": of(n) if row["generation"] >= 100 else 0.9}
        )
        finding = found_in(rows)[DENSITY]
        assert finding.verdict == verdict and f"{100 * np.median([density(n) for n in range(8)]):.3g} %" in finding.ours


class TestSelection:
    """Random searches of densities around 0.17."""

    @pytest.mark.parametrize(
        "density, verdict",
        [
            (lambda n: 0.12 + 0.002 * n, HOLDS),
            (lambda n: 0.03 + 0.04 * n, UNDECIDED),
            (lambda n: 0.165 + 0.002 * n, FAILS),
        ],
        ids=["selected", "drift", "near"],
    )
    def test_densities(self, paper, random, density, verdict):
        rng = np.random.default_rng(0)
        by_chance = changed(random, lambda row, n: {"density_of_robots": rng.uniform(0.01, 0.33)})
        mine = changed(paper, lambda row, n: {"density_of_robots": density(n)})
        assert found_in(mine, random=by_chance)[MOVED["the density of robots"]].verdict == verdict

    def test_one_difference_among_several_traits_may_be_chance(self, paper, random, monkeypatch):
        """Its interval leaves out zero, its p-value is below 0.05, and that by Holm is not."""
        monkeypatch.setattr(statistics, "RESAMPLES", 9999)  # for so near a miss
        by_chance = changed(random, lambda row, n: {"density_of_robots": 0.04 + 0.04 * n})
        mine = changed(paper, lambda row, n: {"density_of_robots": 0.17 + 0.04 * n})
        finding = found_in(mine, random=by_chance)[MOVED["the density of robots"]]
        assert finding.verdict == UNDECIDED
        assert finding.ours.endswith("(0.01 to 0.27)") and "by Holm p = 0.14;" in finding.statistics

    def test_without_replicates_of_both_nothing_is_said(self, paper):
        assert {found_in(paper)[claim].verdict for claim in MOVED.values()} == {NOT_RUN}
        few = found_in(paper, random=search_rows(learns=False))
        assert {few[claim].verdict for claim in MOVED.values()} == {TOO_FEW}


def test_the_fittest_are_those_of_generations_35_to_100():
    """The first generation is number 1; those just before and just behind are as fit, and left out."""
    common = {"delivered": 0, "use_hop_count": True}
    rows = [{**common, "generation": g, "fitness": float(g % 97)} for g in range(120) for _ in range(10)]
    top = Evolution(rows, 72).top
    assert len(top) == 250 and {row["generation"] for row in top} == set(range(72, 97))
    edges = [{**row, "fitness": float(row["generation"] in (33, 34, 99, 100))} for row in rows]
    assert sorted(r["generation"] for r in Evolution(edges, 72).top if r["fitness"]) == [34] * 10 + [99] * 10


def test_quantities_of_one_search():
    """By hand: 40 generations of two runs, of which the second cleans the arena and is the fitter one."""
    rows = []
    for generation in range(40):
        for clean in (False, True):
            genome = {"fraction_scouts": 0.3 if clean else 0.1, "density_of_robots": generation / 100}
            fitness = 100.0 * generation + (50 if clean else 0)
            run = {"generation": generation, "delivered": 72 if clean else 0, "fitness": fitness}
            rows.append({**run, "use_hop_count": clean, **genome})
    one = Evolution(rows, 72)
    assert one.rise == 1.0 and list(one.bests[:2]) == [50.0, 150.0] and list(one.means[:2]) == [25.0, 125.0]
    assert one.gain == (29.5 - 2.0) * 100 and one.final == 29.5 * 100 + 25
    assert one.density == pytest.approx(0.295) and one.late("fraction_scouts") == pytest.approx(0.2)
    assert one.apart("fraction_scouts") == pytest.approx(0.2) and Evolution(rows[:58], 72).apart("x") is None
    assert one.trade is None and one.top == [] and one.exceptions == 0.0
