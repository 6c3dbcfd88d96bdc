"""One evolution as one sample: its quantities by hand, and what made-up searches say on the statements."""

import numpy as np
import pytest
from helpers_findings import changed, found_in, replicated, search_rows

from iswarm_mj.experiments.analysis.evolution import Evolution, best_of, by_replicate
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


@pytest.mark.parametrize("n", [1, 5])
def test_few_evolutions_decide_nothing(paper, n):
    """However many runs they have."""
    found = found_in([row for row in paper if row["replicate"] < n])
    assert {found[claim].verdict for claim in JUDGED if claim is not BEATS} == {TOO_FEW}
    assert "(" not in found[RISES].ours  # no interval


def test_a_table_without_replicates_is_of_one_search(paper):
    rows = search_rows()
    assert by_replicate(rows) == [rows]
    assert found_in(rows) == found_in([{"replicate": 0, **row} for row in rows])
    assert [len(mine) for mine in by_replicate(paper[::-1])] == [1200] * 8
    assert by_replicate(paper[::-1])[0][0]["replicate"] == 0


def test_medians_are_over_evolutions(paper):
    parts = [100 * np.mean([row["delivered"] != 72 for row in mine]) for mine in by_replicate(paper)]
    finding = found_in(paper)[MANY_FAIL]
    assert finding.ours.startswith(f"{min(parts):.3g} to {max(parts):.3g}, median {np.median(parts):.1f} % (")


@pytest.mark.parametrize("n, verdict", [(2, HOLDS), (3, TOO_FEW)])
def test_evolutions_without_a_value_do_not_count(paper, n, verdict):
    """Those of which no run cleans the arena say nothing of the runs that do."""
    finding = found_in(changed(paper, lambda row, number: {"delivered": 40} if number < n else {}))[COUNTED]
    assert finding.verdict == verdict and f"over 8 evolutions, n = {8 - n};" in finding.statistics


@pytest.mark.parametrize("falling, verdict", [(8, HOLDS), (4, UNDECIDED), (0, FAILS)])
def test_evolutions_that_disagree_leave_it_open(paper, falling, verdict):
    """The pooled runs of eight evolutions would decide it in each case."""
    rows = changed(paper, lambda row, n: {} if n < falling else {"p_vector_forget": 0.2 + 0.7 * row["fraction_scouts"]})
    assert found_in(rows)[TRADE].verdict == verdict


@pytest.mark.parametrize(
    "shift, verdict",
    [(lambda n: 0.0, HOLDS), (lambda n: 0.1, FAILS), (lambda n: 0.1 * (-1) ** n, UNDECIDED)],
    ids=["equal", "apart", "open"],
)
@pytest.mark.parametrize("claim, name", [(SCOUTS, "fraction_scouts"), (FORGET, "p_vector_forget")])
def test_equal_is_what_surely_lies_within_a_mutation(paper, claim, name, shift, verdict):
    middle = {"fraction_scouts": 0.16, "p_vector_forget": 0.28}[name]
    rows = changed(paper, lambda row, n: {name: middle + (shift(n) if row["delivered"] < 72 else 0)})
    assert found_in(rows)[claim].verdict == verdict


@pytest.mark.parametrize(
    "claim, name, level", [(SCOUTS_LEVEL, "fraction_scouts", 0.16), (FORGET_LEVEL, "p_vector_forget", 0.28)]
)
@pytest.mark.parametrize(
    "shift, verdict",
    [(lambda n: 0.006 * n, HOLDS), (lambda n: 0.02 * n - 0.07, UNDECIDED), (lambda n: -0.06 - 0.001 * n, FAILS)],
    ids=["there", "spread", "elsewhere"],
)
def test_levels_in_swarms_that_clean(paper, claim, name, level, shift, verdict):
    """Whatever the others have; the paper's levels are judged within one mutation, as equality is."""
    rows = changed(paper, lambda row, n: {name: level + shift(n) if row["delivered"] == 72 else 0.9})
    assert found_in(rows)[claim].verdict == verdict


@pytest.mark.parametrize(
    "density, verdict",
    [(lambda n: 0.13 + 0.001 * n, HOLDS), (lambda n: 0.3, FAILS), (lambda n: 0.08 + 0.02 * n, UNDECIDED)],
    ids=["there", "elsewhere", "spread"],
)
def test_densities(paper, density, verdict):
    """Of the last 20 generations: the one before them is elsewhere."""
    rows = changed(paper, lambda row, n: {"density_of_robots": density(n) if row["generation"] >= 100 else 0.9})
    finding = found_in(rows)[DENSITY]
    assert finding.verdict == verdict
    assert f"{100 * np.median([density(n) for n in range(8)]):.1f} %" in finding.ours


@pytest.mark.parametrize("n, verdict", [(8, HOLDS), (4, UNDECIDED), (0, FAILS)])
def test_signals_are_counted_by_best_genomes(paper, n, verdict):
    finding = found_in(changed(paper, lambda row, number: {"priority_signal_loaded": number < n}))[SIGNALS]
    assert finding.verdict == verdict and finding.ours.startswith(f"{n} of 8: ")


@pytest.mark.parametrize(
    "best, verdict",
    [
        (lambda n: 7771 + 10 * n, HOLDS),
        (lambda n: 7382 + n, UNDECIDED),  # 0.95 * 7771 = 7382.45
        (lambda n: 8153 + n, UNDECIDED),  # 1.05 * 7771 = 8159.55
        (lambda n: 8160 + n, FAILS),
        (lambda n: 7375 + n, FAILS),
    ],
)
def test_the_fittest_swarm_of_an_evolution_is_as_fit_as_the_papers(paper, best, verdict):
    """By its fittest run; nearly is 5 %."""
    rows = changed(paper, lambda row, n: {"fitness": best(n) if row["generation"] == 60 else 2000.0})
    assert found_in(rows)[AS_FIT].verdict == verdict


@pytest.mark.parametrize(
    "early, verdict",
    [(lambda n: 0, HOLDS), (lambda n: 2, HOLDS), (lambda n: 8, FAILS), (lambda n: 2 + n, UNDECIDED)],
)
def test_swarms_that_clean_faster_than_the_paper_takes_for_possible(paper, early, verdict):
    """Of each 100 swarms that clean, the first few need 249 steps, all others 250, which is not less."""
    place = {n: 0 for n in range(8)}

    def time(row, n):
        if row["delivered"] < 72:
            return {}
        place[n] += 1
        return {"finished_at": 249 if place[n] % 100 < early(n) else 250}

    assert found_in(changed(paper, time))[SLOW].verdict == verdict


@pytest.mark.parametrize(
    "cleaning, verdict",
    [(lambda n: 3 + n % 2, HOLDS), (lambda n: 0, FAILS), (lambda n: 9, FAILS), (lambda n: n, UNDECIDED)],
)
def test_few_swarms_without_hop_counts_clean(paper, cleaning, verdict):
    """Of each 100 without hop counts so many clean; 2 to 8 are as few as the paper's 4."""
    place = {n: 0 for n in range(8)}

    def clean(row, n):
        if row["use_hop_count"]:
            return {}
        place[n] += 1
        cleans = (place[n] - 1) % 100 < cleaning(n)
        return {"delivered": 72, "finished_at": 320} if cleans else {"delivered": 40, "finished_at": None}

    assert found_in(changed(paper, clean))[EXCEPTIONS].verdict == verdict


def test_short_searches_decide_nothing_that_needs_more():
    found = found_in(replicated(6, generations=10))
    assert {found[claim].verdict for claim in (RISES, LEARNS, TRADE, DENSITY)} == {TOO_FEW}


@pytest.mark.parametrize("claim, method, verdict", [(BEATS, "random", FAILS), (RIVAL, "cmaes", "")])
def test_searches_are_compared_by_their_best_runs(paper, claim, method, verdict):
    """One that finds fitter swarms in its first generations is better, however unfit its last ones are."""
    early = changed(paper, lambda row, n: {"fitness": 9000.0 if row["generation"] < 20 else 0.0})
    finding = found_in(paper, **{method: early})[claim]
    assert finding.verdict == verdict and " against 9000, difference -" in finding.ours


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

    def test_one_difference_among_several_traits_may_be_chance(self, paper, random):
        """Its interval leaves out zero, its p-value is below 0.05, and that by Holm is not."""
        by_chance = changed(random, lambda row, n: {"density_of_robots": 0.04 + 0.04 * n})
        mine = changed(paper, lambda row, n: {"density_of_robots": 0.17 + 0.04 * n})
        finding = found_in(mine, random=by_chance)[MOVED["the density of robots"]]
        assert finding.verdict == UNDECIDED
        assert finding.ours.endswith("(0.01 to 0.27)") and "by Holm p = 0.14;" in finding.statistics

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
        finding = found_in(changed(paper, of_mine), random=by_chance)[MOVED["the priority signal of loaded robots"]]
        assert finding.verdict == verdict

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


def test_the_best_genome_is_best_on_average_over_its_runs():
    """A lucky run of one genome, and two others with three runs each."""
    (row,) = search_rows(1, 1)
    rows = [row | {"fraction_scouts": 0.1, "fitness": 9.0}]
    rows += [row | {"fraction_scouts": 0.2, "fitness": f} for f in (1.0, 2, 9)]
    rows += [row | {"fraction_scouts": 0.3, "fitness": f} for f in (5.0, 5, 5)]
    best = best_of(rows)
    assert (best.genome.fraction_scouts, best.fitness, best.n_runs) == (0.3, 5.0, 3)
