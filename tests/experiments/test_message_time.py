"""The study of messages that take time: which runs it is made of, and what it finds in made-up rows."""

import re
from dataclasses import replace

import pytest

from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, TOO_FEW, UNDECIDED
from iswarm_mj.experiments.runner.experiment import Plan, row_of
from iswarm_mj.experiments.runner.jobs import Outcome
from iswarm_mj.experiments.studies import message_time
from iswarm_mj.tasks.measures import Measures

ENTRIES = message_time.entries(Plan())


def made_rows(time, entries=ENTRIES):
    """Rows whose runs take different times about a function of setting and use of hop counts."""
    rows = []
    for entry in entries:
        k, at = entry.labels["repeat"], time(entry.labels["setting"], entry.labels["use_hop_count"])
        rows.append(row_of(entry, Outcome(Measures(66, 70, 2800 + k, 60.0 + k, at + k), at + k, 0.0)))
    return rows


def test_runs_differ_in_message_time_and_hop_counts_alone():
    assert len(ENTRIES) == 5 * 2 * 12 and len({entry.job.seed for entry in ENTRIES}) == 5 * 2 * 12
    for entry in ENTRIES:
        job, labels = entry.job, entry.labels
        optics, rate = job.config.optics, labels["setting"].split()[0]
        assert optics.baud_rate == (0.0 if rate == "no" else float(rate))
        assert (optics.photodiodes_while_emitting == "all") == ("all" in labels["setting"])
        assert job.genome.use_hop_count == labels["use_hop_count"]
        usual = replace(optics, baud_rate=0.0, photodiodes_while_emitting="front")
        assert replace(job.config, optics=usual) == Plan().config


def test_slower_rates_are_told_from_those_that_are_not():
    rows = made_rows(lambda name, uses: (150 if uses else 800) + {"1000": 100, "2000": -30}.get(name[:4], 0))
    fast, middle, slow, _, *hops = message_time.findings(rows)
    assert (fast.verdict, middle.verdict, slow.verdict) == (UNDECIDED, FAILS, HOLDS)
    assert slow.ours.startswith("median 256 ") and "12 of 12 and 12 of 12 runs" in slow.ours
    found = [re.search(r"two-sided p = (\S+), .* p = (\S+) by Holm for 4 tests", f.statistics) for f in (fast, slow)]
    assert found[0][2] == "1" and float(found[1][2]) == pytest.approx(4 * float(found[1][1]), rel=0.02)
    times = [finding for finding in hops if "more quickly" in finding.claim]
    assert [finding.verdict for finding in times] == [HOLDS] * 4 and times[2].claim.endswith("messages at 1000 bit/s")


@pytest.mark.parametrize("rate", [30000, 2000, 1000])
def test_three_runs_of_each_are_too_few(rate):
    rows = made_rows(lambda name, uses: 150, message_time.entries(Plan(quick=True)))
    said = {finding.claim: finding.verdict for finding in message_time.findings(rows)}
    assert said[f"Messages at {rate} bit/s slow a swarm with hop counts down"] == TOO_FEW


def test_draws_each_setting(tmp_path):
    (path,) = message_time.draw(made_rows(lambda name, uses: 150), tmp_path)
    assert path.name == "message_time.png" and path.stat().st_size > 10_000
