"""Medians in the table of a sweep: worlds that have not finished count as the time limit."""

import pytest

from iswarm_mj.search import sweep

ROW = {
    "density": 0.1,
    "seed": 0,
    "n_robots": 5,
    "max_steps": 100,
    "goal": 3,
    "delivered": 3,
    "fault": None,
}


def medians(rows):
    """Medians as the table of the sweep shows them, by their headings."""
    headings, line = sweep.summary(rows, ["density"])
    return dict(zip(headings.split(), line.split(), strict=True))


@pytest.mark.parametrize(
    ("finished_at", "shown"),
    [
        ((40, None, None), ">100"),
        ((40, 60, None), "60"),
        ((40, None), ">100"),
        ((40, 50), "45"),
        ((40, 100, 100), "100"),
    ],
)
def test_medians_count_the_time_limit(finished_at, shown):
    rows = [{**ROW, "world": k, "finished_at": step} for k, step in enumerate(finished_at)]
    assert medians(rows)["finished"] == shown


@pytest.mark.parametrize(
    ("collisions", "shown"),
    [(0, "0"), (7716, "7716"), (16546, "16546"), (9999.6, "10000"), (83.216, "83.22")],
)
def test_medians_are_no_powers_of_ten(collisions, shown):
    rows = [{**ROW, "finished_at": 40, "collisions": collisions}]
    assert medians(rows)["collisions"] == shown
