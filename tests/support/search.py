"""A search whose runs are pretended: their fitness is how near a genome is to a goal."""

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
    """Fitness without noise, 1000 at most: how near a genome is to that of type 2."""
    return float(1000 - 80 * np.abs(to_vector(genome) - GOAL).sum())


def genome_of(row):
    """Genome of a row."""
    return Genome(*(row[field.name] for field in fields(Genome)))


def pretend(monkeypatch, breaks_after=None):
    """Jobs without physics, finished in an order that depends on the workers; returns those that
    were begun."""
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
    """Bytes of the files of a directory by their names, and rows of journals."""
    found = {path.name: path.read_bytes() for path in out.iterdir() if path.suffix != ".sqlite"}
    for path in out.glob("*.sqlite"):
        with sqlite3.connect(path) as file:
            found[path.name] = sorted(file.execute("SELECT * FROM runs"))
    return found
