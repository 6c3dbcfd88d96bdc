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


def write_hop_count(directory, plan):
    """Results of a comparison of hop counts, without its runs."""

    def outcome(job):
        counts = job.genome.use_hop_count
        time = 150 + job.seed % 20 if counts else None
        delivered, factor, carriage = (66, 10, 60.0) if counts else (20, 30, 200.0)
        return outcome_of(Measures(delivered, 70, 280 * factor, carriage, time), 9, 1.0)

    directory.mkdir(parents=True)
    rows = [row_of(entry, outcome(entry.job)) for entry in EXPERIMENTS["hop-count"].entries(plan)]
    settings = {"experiment": "hop-count", "engine": "mujoco", **asdict(plan)}
    write_table(directory / "hop_count.parquet", rows, settings)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Directories with some results: hop counts, one quick, a search, trials."""
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
    """Eight made-up evolutions that go as the paper's."""
    return replicated(8)


@pytest.fixture(scope="session")
def random():
    """Eight made-up searches that learn nothing."""
    return replicated(8, seed=1, learns=False)


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch):
    """Intervals are nearly as good with a fifth of the resamples."""
    monkeypatch.setattr("iswarm_mj.paper.analysis.statistics.RESAMPLES", 1999)
