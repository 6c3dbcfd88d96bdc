"""Tables of sweeps: worlds that have not finished take the time limit."""

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


def rows(*finished_at):
    return [{**ROW, "world": world, "finished_at": step} for world, step in enumerate(finished_at)]


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
    assert sweep.summary(rows(*finished_at), ["density"])[1].split()[2] == shown
