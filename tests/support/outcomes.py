"""Rows of experiments with outcomes that no run has."""

from iswarm_mj.paper.studies.experiment import Plan, row_of
from iswarm_mj.search.pool import outcome_of
from iswarm_mj.tasks.measures import Measures

PLAN = Plan()


def rows_of(entries, outcome):
    """Return rows whose outcomes are a function of the entry."""
    return [row_of(entry, outcome(entry)) for entry in entries]


def done(job, time, delivered=66, collisions=280, carriage=50.0):
    """Return the outcome of a run that reached its goal after `time` steps; None for never."""
    measures = Measures(delivered, delivered, collisions, carriage, time)
    return outcome_of(measures, time or job.steps, 0.0)
