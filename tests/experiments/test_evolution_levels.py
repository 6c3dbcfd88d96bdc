"""Statements on the paper's numbers of section 4.6.1, by made-up evolutions: a fitness, times, means and shares."""

import numpy as np
import pytest
from helpers_findings import changed, found_in

from iswarm_mj.experiments.analysis import evolution_claims as claims
from iswarm_mj.experiments.analysis.findings import FAILS, FITTED, HOLDS, PREDICTED, UNDECIDED


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
    finding = found_in(rows)[claims.AS_FIT.text]
    assert (finding.verdict, finding.kind, finding.paper[:11]) == (verdict, PREDICTED, "7771 points")
    middle = np.median([best(n) for n in range(8)])
    assert finding.ours.startswith(f"{100 * (middle / 7771 - 1):+.1f} % against the paper's; median over 8 evolutions ")
    assert f"{middle:.0f} points (95 % interval {best(0)} to {best(7)})" in finding.ours
    assert "within 7382 points to 8160 points, does not if it lies outside" in finding.statistics


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

    finding = found_in(changed(paper, time))[claims.SLOW.text]
    assert (finding.verdict, finding.kind) == (verdict, PREDICTED)
    assert finding.ours.startswith(f"the earliest at step {249 if early(7) else 250}; median over 8 evolutions ")
    assert "holds if the interval lies below 5 %, does not if it lies above" in finding.statistics


@pytest.mark.parametrize(
    "claim, name, level",
    [(claims.SCOUTS_LEVEL, "fraction_scouts", 0.16), (claims.FORGET_LEVEL, "p_vector_forget", 0.28)],
)
@pytest.mark.parametrize(
    "shift, verdict",
    [(lambda n: 0.006 * n, HOLDS), (lambda n: 0.02 * n - 0.07, UNDECIDED), (lambda n: -0.06 - 0.001 * n, FAILS)],
    ids=["there", "spread", "elsewhere"],
)
def test_levels_in_swarms_that_clean(paper, claim, name, level, shift, verdict):
    """Whatever the others have; the paper's levels are judged within one mutation, as equality is."""
    rows = changed(paper, lambda row, n: {name: level + shift(n) if row["delivered"] == 72 else 0.9})
    finding = found_in(rows)[claim.text]
    assert (finding.verdict, finding.kind) == (verdict, PREDICTED) and finding.paper.startswith(f"{level} ± 0.1")
    middle = level + np.median([shift(n) for n in range(8)])
    assert f"median over 8 evolutions {middle:.3g} (95 % interval " in finding.ours
    assert f"within {level - 0.05:.2g} to {level + 0.05:.2g}, does not if it lies outside" in finding.statistics


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

    rows = changed(paper, clean)
    finding = found_in(rows)[claims.EXCEPTIONS.text]
    without = [row for row in rows if not row["use_hop_count"]]
    assert (finding.verdict, finding.kind) == (verdict, PREDICTED)
    assert finding.ours.startswith(f"{sum(row['delivered'] == 72 for row in without)} of {len(without)} runs; median ")
    assert "within 2 % to 8 %, does not if it lies outside" in finding.statistics


@pytest.mark.parametrize("claim, name", [(claims.SCOUTS, "fraction_scouts"), (claims.FORGET, "p_vector_forget")])
@pytest.mark.parametrize(
    "n, told",
    [
        (8, "0.435 (95 % interval 0.4 to 0.47), median of 8 evolutions"),
        (2, "0.405, median of 2 evolutions"),
        (1, "0.4 in one evolution"),
    ],
)
def test_equality_is_told_among_swarms_with_hop_counts_too(paper, claim, name, n, told):
    """Most that fail lost hop counts by chance, which makes them equal to the others and hides what else differs."""
    paper = [row for row in paper if row["replicate"] < n]
    rows = changed(
        paper,
        lambda row, k: {name: 0.5 - (0.4 + 0.01 * k) * (row["use_hop_count"] and row["delivered"] < 72)},
    )
    finding = found_in(rows)[claim.text]
    assert finding.kind == FITTED
    among = f"difference of the means with hop counts alone {told} with 10 such runs of both groups"
    assert f"; {among}; difference of the means; " in finding.ours


def test_without_failures_among_swarms_with_hop_counts_that_is_said(paper):
    finding = found_in([row for row in paper if row["delivered"] == 72 or not row["use_hop_count"]])[claims.SCOUTS.text]
    assert (
        "hop counts alone: no evolution with 10 such runs of both groups; difference of the means; median over"
        in finding.ours
    )
