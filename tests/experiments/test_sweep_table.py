"""Tables of sweeps: worlds that have not finished take the time limit."""

from iswarm_mj.experiments.runner import sweep

ROW = {"density": 0.1, "seed": 0, "n_robots": 5, "max_steps": 100, "goal": 3, "delivered": 3, "fault": None}


def rows(*finished_at):
    return [{**ROW, "world": world, "finished_at": step} for world, step in enumerate(finished_at)]


def test_medians_count_the_time_limit():
    assert sweep.summary(rows(40, None, None), ["density"])[1].split()[:3] == ["0.1", "3", "100"]
