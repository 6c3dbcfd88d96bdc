"""Rows of experiments with outcomes that no run has."""

import numpy as np

from iswarm_mj.experiments.analysis.measures import PAPER_FITNESS
from iswarm_mj.experiments.runner.experiment import Plan, row_of
from iswarm_mj.experiments.runner.pool import outcome_of
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.tasks.measures import Measures

PLAN = Plan()


def rows_of(entries, outcome):
    """Rows with outcomes by a function of the entry."""
    return [row_of(entry, outcome(entry)) for entry in entries]


def done(job, time, delivered=66, collisions=280, carriage=50.0):
    """Outcome of a run that reached its goal after `time` steps, or did not, where it is None."""
    return outcome_of(Measures(delivered, delivered, collisions, carriage, time), time or job.steps, 0.0)


def type_rows(one, two):
    """Rows of the paper's types that finish about these steps, with a standard deviation of 30."""
    rng, rows = np.random.default_rng(0), []
    for entry in EXPERIMENTS["types"].entries(PLAN):
        if entry.labels["type"] in PAPER_FITNESS:
            k, second = entry.labels["repeat"], entry.labels["type"] == "type2"
            time = round((two if second else one) + rng.normal(0, 30))
            points = 2880 + 10 * (800 - time) - 5
            outcome = done(entry.job, time, 72) | {"fitness": float(points)}
            gathers = (0.5 if second else 0.3) + 0.001 * k if k < 6 else None
            rows.append({**row_of(entry, outcome), "aggregation": gathers})
    return rows
