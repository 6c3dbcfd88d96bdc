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
    headings, line = sweep.summary(rows, ["density"])
    median_of = dict(zip(headings.split(), line.split(), strict=True))
    assert median_of["finished"] == shown
