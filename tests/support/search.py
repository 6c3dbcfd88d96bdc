"""A search without physics, whose fitness is how near a genome is to a goal."""

import sqlite3
from dataclasses import fields, replace

import numpy as np

from iswarm_mj.search import pool
from iswarm_mj.search.methods import to_vector
from iswarm_mj.search.pool import outcome_of
from iswarm_mj.search.search import Search
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.measures import Measures

GOAL = to_vector(PRESETS["type2"])
SEARCH = Search(generations=6, population=5, evaluations=2, scenario=Scenario(seed=3))


def seeded(search, seed, **changes):
    """Return a search with another seed and other changes."""
    return replace(search, scenario=replace(search.scenario, seed=seed), **changes)


def worth(genome):
    """Return the fitness without noise, 1000 at most: how near a genome is to that of type 2."""
    return float(1000 - 80 * np.abs(to_vector(genome) - GOAL).sum())


def genome_of(row):
    """Return the genome of a row."""
    return Genome(*(row[field.name] for field in fields(Genome)))


def pretend(monkeypatch, breaks_after=None):
    """Replace jobs by ones without physics, and return the list of those that were begun.

    They finish in an order that depends on the number of workers.

    Args:
        monkeypatch: fixture.
        breaks_after: jobs after which the user interrupts; None for never.
    """
    begun = []

    def run_jobs(jobs, execution):
        for index in np.random.default_rng(execution.workers).permutation(len(jobs)):
            if breaks_after is not None and len(begun) >= breaks_after:
                raise KeyboardInterrupt
            job = jobs[index]
            begun.append(job)
            noise = np.random.default_rng(job.seed).normal(0, 20)
            picked = int(noise) % 70 + 2
            measures = Measures(picked - 1, picked, job.n_robots, None, None)
            yield int(index), outcome_of(measures, job.steps, worth(job.genome) + noise)

    monkeypatch.setattr(pool, "run_jobs", run_jobs)
    return begun


def contents(out):
    """Return the bytes of the files of a directory by their names, and the rows of journals."""
    contents_of_files = {}
    for path in out.iterdir():
        if path.suffix == ".sqlite":
            with sqlite3.connect(path) as journal:
                contents_of_files[path.name] = sorted(journal.execute("SELECT * FROM runs"))
        else:
            contents_of_files[path.name] = path.read_bytes()
    return contents_of_files
