"""Results of a few experiments, for reports, and made-up searches."""

from dataclasses import asdict

import pytest
from support.findings import GRASP_SETTINGS, grasp_rows, replicated, search_rows, settings_of

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.paper.studies.experiment import Plan, row_of
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.search.pool import outcome_of
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.tables import write_table


def hop_count_outcome(job):
    """Return an outcome that is much better with hop counts."""
    if job.genome.use_hop_count:
        measures = Measures(66, 70, 2800, 60.0, 150 + job.seed % 20)
    else:
        measures = Measures(20, 70, 8400, 200.0, None)
    return outcome_of(measures, 9, 1.0)


def write_hop_count(directory, plan):
    """Write results of a comparison of hop counts, without its runs."""
    directory.mkdir(parents=True)
    entries = EXPERIMENTS["hop-count"].entries(plan)
    rows = [row_of(entry, hop_count_outcome(entry.job)) for entry in entries]
    settings = {"experiment": "hop-count", "engine": "mujoco", **asdict(plan)}
    write_table(directory / "hop_count.parquet", rows, settings)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return a directory of results: hop counts, those of a quick version, a search, and trials."""
    root = tmp_path_factory.mktemp("results")
    write_hop_count(root / "quick", Plan(quick=True, seed=9))
    write_hop_count(root / "full", Plan(config=SwarmConfig(optics=OpticsConfig(wall_range=2.0))))
    for name in ("evolve", "trials"):
        (root / name).mkdir()
    write_table(root / "evolve/evolution.parquet", search_rows(), settings_of())
    write_table(root / "trials/trials.parquet", grasp_rows(), GRASP_SETTINGS)
    (root / "trials/other.parquet").write_bytes(b"something else")
    return root


@pytest.fixture(scope="session")
def paper():
    """Return the rows of eight made-up evolutions that go as the paper's."""
    return replicated(8)


@pytest.fixture(scope="session")
def random():
    """Return the rows of eight made-up searches that learn nothing."""
    return replicated(8, seed=1, learns=False)


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch):
    """Use a fifth of the resamples, with which intervals are nearly as good."""
    monkeypatch.setattr("iswarm_mj.utils.intervals.RESAMPLES", 1999)
