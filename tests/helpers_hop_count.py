"""Results of a comparison of hop counts, without its runs."""

from dataclasses import asdict

from iswarm_mj.experiments.runner.experiment import row_of
from iswarm_mj.experiments.runner.jobs import outcome_of
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.tables import write_table


def write_hop_count(directory, plan):
    def outcome(job):
        counts = job.genome.use_hop_count
        time = 150 + job.seed % 20 if counts else None
        delivered, factor, carriage = (66, 10, 60.0) if counts else (20, 30, 200.0)
        return outcome_of(Measures(delivered, 70, 280 * factor, carriage, time), 9, 1.0)

    directory.mkdir(parents=True)
    rows = [row_of(entry, outcome(entry.job)) for entry in EXPERIMENTS["hop-count"].entries(plan)]
    settings = {"experiment": "hop-count", "engine": "mujoco", **asdict(plan)}
    write_table(directory / "hop_count.parquet", rows, settings)
