"""One evolution as one sample: its quantities by hand, and what made-up searches say on the
statements."""

import pytest
from support.findings import changed, found_in, search_rows

from iswarm_mj.paper.analysis import statistics
from iswarm_mj.paper.analysis.evolution import Evolution
from iswarm_mj.paper.analysis.evolution_statements import STATEMENTS, TRAITS
from iswarm_mj.paper.analysis.findings import NOT_RUN, TOO_FEW, UNDECIDED

CLAIMS = [statement.claim for statement in STATEMENTS[: -len(TRAITS)]]
RISES, BEATS, RIVAL = CLAIMS[0], CLAIMS[2], CLAIMS[3]
JUDGED = [claim for claim in CLAIMS if claim is not RIVAL]


def test_few_evolutions_decide_nothing(paper):
    """However many runs they have."""
    found = found_in([row for row in paper if row["replicate"] < 5])
    assert {found[claim].verdict for claim in JUDGED if claim is not BEATS} == {TOO_FEW}
    assert "(" not in found[RISES].ours  # no interval


def test_one_difference_among_several_traits_may_be_chance(paper, random, monkeypatch):
    """Its interval leaves out zero, its p-value is below 0.05, and that by Holm is not."""
    monkeypatch.setattr(statistics, "RESAMPLES", 9999)  # for so near a miss
    by_chance = changed(random, lambda row, n: {"density_of_robots": 0.04 + 0.04 * n})
    mine = changed(paper, lambda row, n: {"density_of_robots": 0.17 + 0.04 * n})
    finding = found_in(mine, random=by_chance)["Selection moves the density of robots"]
    assert finding.verdict == UNDECIDED
    assert finding.ours.endswith("(0.01 to 0.27)") and "by Holm p = 0.14;" in finding.statistics


def test_without_replicates_of_both_nothing_is_said_of_selection(paper):
    moved = [f"Selection moves {trait}" for trait in TRAITS]
    assert {found_in(paper)[claim].verdict for claim in moved} == {NOT_RUN}
    few = found_in(paper, random=search_rows(learns=False))
    assert {few[claim].verdict for claim in moved} == {TOO_FEW}


def test_the_fittest_are_those_of_generations_35_to_100():
    """The first generation is number 1; those just before and just behind are as fit, and left
    out."""
    common = {"delivered": 0, "use_hop_count": True}
    rows = [
        {**common, "generation": g, "fitness": float(g % 97)} for g in range(120) for _ in range(10)
    ]
    top = Evolution(rows, 72).fittest
    assert len(top) == 250 and {row["generation"] for row in top} == set(range(72, 97))
    edges = [{**row, "fitness": float(row["generation"] in (33, 34, 99, 100))} for row in rows]
    assert (
        sorted(r["generation"] for r in Evolution(edges, 72).fittest if r["fitness"])
        == [34] * 10 + [99] * 10
    )


def test_quantities_of_one_search():
    """By hand: 40 generations of two runs, of which the second cleans the arena and is the fitter
    one."""
    rows = []
    for generation in range(40):
        for clean in (False, True):
            genome = {
                "fraction_scouts": 0.3 if clean else 0.1,
                "density_of_robots": generation / 100,
            }
            fitness = 100.0 * generation + (50 if clean else 0)
            run = {"generation": generation, "delivered": 72 if clean else 0, "fitness": fitness}
            rows.append({**run, "use_hop_count": clean, **genome})
    one = Evolution(rows, 72)
    assert (
        one.rise == 1.0
        and list(one.bests[:2]) == [50.0, 150.0]
        and list(one.means[:2]) == [25.0, 125.0]
    )
    assert one.gain == (29.5 - 2.0) * 100 and one.final_fitness == 29.5 * 100 + 25
    assert one.density == pytest.approx(0.295) and one.late_mean(
        "fraction_scouts"
    ) == pytest.approx(0.2)
    assert (
        one.cleaning_difference("fraction_scouts") == pytest.approx(0.2)
        and Evolution(rows[:58], 72).cleaning_difference("x") is None
    )
    assert (
        one.forgetting_against_scouts is None and one.fittest == [] and one.exception_share == 0.0
    )
