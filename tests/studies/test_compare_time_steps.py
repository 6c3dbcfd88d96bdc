"""Ratios of finishing times at two time steps, and their verdicts."""

import compare_time_steps
import numpy as np
import pytest

from iswarm_mj.engines.settings import REFINEMENT


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (0.97, 1.03, "converged"),
        (0.95, 1.05, "converged"),
        (0.94, 1.03, "undecided"),
        (1.04, 1.2, "undecided"),
        (0.9, 1.2, "undecided"),
        (1.06, 1.2, "differs"),
        (0.7, 0.94, "differs"),
    ],
)
def test_verdicts(low, high, verdict):
    assert compare_time_steps.verdict(low, high) == verdict


@pytest.mark.parametrize(("n_worlds", "seed"), [(48, 0), (512, 1)])
def test_the_interval_of_the_ratio_is_that_of_the_normal_distribution(n_worlds, seed):
    """Logarithms of 48 worlds and more have nearly normal means."""
    rng = np.random.default_rng(seed)
    default = np.exp(rng.normal(5.0, 0.3, n_worlds))
    finer = np.exp(rng.normal(5.1, 0.4, n_worlds))
    low, high = compare_time_steps.ratio_interval(default, finer)

    difference = np.log(default).mean() - np.log(finer).mean()
    error = np.hypot(np.log(default).std(), np.log(finer).std()) / np.sqrt(n_worlds)
    expected = np.exp(difference + 1.96 * error * np.array([-1, 1]))
    np.testing.assert_allclose([low, high], expected, rtol=0.1 * error)


def test_worlds_that_do_not_finish_count_with_all_steps(monkeypatch):
    steps = {REFINEMENT: np.array([100, 0, 100]), 10: np.array([100, 100, 0])}
    monkeypatch.setattr(
        compare_time_steps, "steps_to_goal", lambda preset, robots, refinement, _: steps[refinement]
    )
    arguments = compare_time_steps.parse_arguments(["--steps", "800"])
    row = compare_time_steps.row("type1", 0.118, arguments)
    assert (row["robots"], row["finished"], row["finished, finer"]) == (280, 2, 2)
    assert (row["steps"], row["steps, finer"], row["ratio"]) == (200.0, 200.0, 1.0)
