"""Fits of laboratories whose parameters are known: `tools/research/synthetic_laboratories.py`."""

import numpy as np
import pytest
from synthetic_laboratories import coverage, judge, laboratory

WITHOUT, WITH = 2, 4
"""Laboratories without and with releases."""


def widths(verdicts):
    """Return widths after the proposed measurement over those that were predicted."""
    return np.array([verdict.width / verdict.predicted_width for verdict in verdicts])


@pytest.mark.slow
def test_intervals_hold_in_fifty_laboratories():
    verdicts = [judge(seed) for seed in range(50)]

    counts = coverage(verdicts)
    n_covered = sum(covered for covered, _ in counts.values())
    n = sum(total for _, total in counts.values())
    assert 0.9 <= n_covered / n <= 0.99
    # 95 % of 50 intervals, and what chance does to that in one of a thousand.
    assert all(covered >= 0.84 * total for covered, total in counts.values())

    without_releases = [verdict for verdict in verdicts if verdict.n_releases == 0]
    assert len(without_releases) > 15
    assert not any(verdict.determined["work_tool_object"] for verdict in without_releases)
    with_many = [verdict for verdict in verdicts if verdict.n_releases >= 8]
    assert all(verdict.determined["work_tool_object"] for verdict in with_many)

    assert np.median(widths(verdicts)) == pytest.approx(1, abs=0.1)
    assert np.median([verdict.width / verdict.width_before for verdict in without_releases]) < 0.3


def test_intervals_hold_in_two_laboratories():
    """One without releases, and one with them."""
    assert not any(row[0] == "release" for row in laboratory(WITHOUT).rows)
    verdicts = [judge(WITHOUT), judge(WITH)]
    assert [verdict.determined["work_tool_object"] for verdict in verdicts] == [False, True]
    for verdict in verdicts:
        assert all(verdict.covered.values())
    assert widths(verdicts) == pytest.approx(1, abs=0.25)
    assert verdicts[0].width < 0.4 * verdicts[0].width_before
