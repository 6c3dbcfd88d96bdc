"""Searches from end to end: their tables, their optimisers, and that no interruption changes a
byte."""

from dataclasses import asdict, replace
from itertools import product

import numpy as np
import pytest
from support.search import SEARCH, contents, genome_of, pretend, seeded, worth

from iswarm_mj.commands import main as cli
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.search import pool
from iswarm_mj.search.best import best_of, by_replicate
from iswarm_mj.search.methods import METHODS, Operators, generator, ranges, to_vector
from iswarm_mj.search.pool import Execution
from iswarm_mj.search.search import (
    BEST,
    CHECKPOINT,
    TABLE,
    replicate_seed,
    run_search,
)
from iswarm_mj.search.seeds import run_seed
from iswarm_mj.strategy.genome import Genome, load_genome
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.tables import read_table

pytestmark = pytest.mark.usefixtures("few_pixels")


def without_figures(monkeypatch):
    """They follow from the table and take most of the time."""
    monkeypatch.setattr("iswarm_mj.search.search.draw_fitness", lambda *_: None)


def test_the_table_and_files(monkeypatch, tmp_path):
    """Every run once, with what was run and what came of it; the elite is run again with other
    seeds."""
    begun, out = pretend(monkeypatch), tmp_path / "out"
    run_search(SEARCH, out)
    rows, _ = read_table(out / TABLE)
    assert sorted(contents(out)) == sorted([CHECKPOINT, TABLE, BEST, "fitness.png", "fitness.svg"])
    assert load_genome(str(out / BEST)) == best_of(rows).genome
    places = [(row["generation"], row["individual"], row["evaluation"]) for row in rows]
    assert places == [(g, i, k) for g in range(6) for i in range(5) for k in range(2)]
    by_seed = {job.seed: job for job in begun}
    assert len(begun) == 60 and by_seed.keys() == {row["seed"] for row in rows}
    for row, place in zip(rows, places, strict=True):
        job = by_seed[row["seed"]]
        assert (
            row["seed"] == run_seed(3, *place)
            and job.genome == genome_of(row)
            and job.steps == row["steps"] == 800
        )
        assert row["n_robots"] == job.n_robots == row["collisions"]
        assert job.n_robots == robots_for(SEARCH.config.arena, row["density_of_robots"])
        assert row["fitness"] == worth(job.genome) + np.random.default_rng(row["seed"]).normal(
            0, 20
        )
    for one, other in zip(rows[::2], rows[1::2], strict=True):
        assert (
            one["genome_fitness"]
            == other["genome_fitness"]
            == (one["fitness"] + other["fitness"]) / 2
        )
        assert genome_of(one) == genome_of(other)
    of = {(row["generation"], row["individual"]): row for row in rows}
    for g in range(1, 6):
        order = sorted(range(5), key=lambda i, g=g: -of[g - 1, i]["genome_fitness"])
        for row, parent in ((of[g, place], of[g - 1, order[place]]) for place in (0, 1)):
            assert (row["origin"], row["parent"], row["second_parent"]) == (
                "elite",
                parent["individual"],
                None,
            )
            assert genome_of(row) == genome_of(parent) and row["seed"] != parent["seed"]
    assert {of[0, i]["origin"] for i in range(5)} == {"random"}


class TestReplicates:
    """Three searches at once."""

    @pytest.mark.parametrize("method", ["paper", "cmaes"])
    def test_each_is_the_search_with_its_seed(self, monkeypatch, tmp_path, method):
        """The first that of the seed itself; no replicate learns from another; a generation of all
        is a set of jobs."""
        begun, sets, run_jobs = pretend(monkeypatch), [], pool.run_jobs
        monkeypatch.setattr(
            pool, "run_jobs", lambda jobs, how: sets.append(len(jobs)) or run_jobs(jobs, how)
        )
        without_figures(monkeypatch)
        search = replace(SEARCH, replicates=3, method=method)
        run_search(search, tmp_path / "three")
        together = by_replicate(read_table(tmp_path / "three" / TABLE)[0])
        assert len(begun) == 180 and sets == [30] * 6 and replicate_seed(3, 0) == 3
        for number, rows in enumerate(together):
            out = tmp_path / str(number)
            run_search(seeded(search, replicate_seed(3, number), replicates=1), out)
            assert [row | {"replicate": 0} for row in rows] == read_table(out / TABLE)[0]
            assert (
                load_genome(str(tmp_path / "three" / f"best-{number}.json")) == best_of(rows).genome
            )
        whole = [row for rows in together for row in rows]
        assert load_genome(str(tmp_path / "three" / BEST)) == best_of(whole).genome

    @pytest.mark.parametrize(
        "at_once, engine, sets",
        [(25, "planar", [20] * 3), (3, "mjx", [10] * 6)],
    )
    def test_batches_of_planar_take_generations_that_depend_on_none(
        self, monkeypatch, tmp_path, at_once, engine, sets
    ):
        """MJX's time grows with a batch, and the table of a search in workers with each
        generation."""
        pretend(monkeypatch)
        monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
        monkeypatch.setattr("iswarm_mj.search.search.AT_ONCE", at_once)
        without_figures(monkeypatch)
        search = replace(SEARCH, method="random")
        found, run_jobs = [], pool.run_jobs
        run_search(search, tmp_path / "alone")
        monkeypatch.setattr(
            pool, "run_jobs", lambda jobs, how: found.append(len(jobs)) or run_jobs(jobs, how)
        )
        run_search(search, tmp_path / "out", Execution(find_engine(engine).usual()))
        assert found == sets
        assert read_table(tmp_path / "out" / TABLE)[0] == read_table(tmp_path / "alone" / TABLE)[0]


def test_the_best_is_not_the_luckiest():
    lucky, proven, tried = Genome(), Genome(fraction_scouts=0.2), Genome(fraction_scouts=0.3)
    runs = [(lucky, 9.0), (proven, 5.0), (proven, 6.0), (tried, 8.0), (proven, 7.0), (tried, 7.0)]
    rows = [{**asdict(genome), "fitness": fitness} for genome, fitness in runs]
    assert best_of(rows) == (proven, 6.0, 3)
    assert best_of(rows[:3]) == (lucky, 9.0, 1)


def test_seeds_differ_and_are_seeds():
    """Of replicates and runs; random numbers of generations are their own."""
    replicates = [replicate_seed(s, r) for s in range(20) for r in range(20)]
    places = product(replicates[:60], range(10), range(5), range(2))
    seeds = [run_seed(seed, *place) for seed, *place in places]
    assert len(set(replicates)) == 400 and len(set(seeds)) == 6000
    assert (
        max(seeds) < 2**32 - 1 and min(seeds) >= 0 and run_seed(3, 1, 2, 0) != run_seed(3, 2, 1, 0)
    )
    assert (
        len({generator(seed, generation).random() for seed in range(5) for generation in range(20)})
        == 100
    )
    search = METHODS["random"](Operators(), 10, 3)
    assert len({individual.genome for _ in range(4) for individual in next(search)}) == 40


class TestOptimisers:
    def fitness(self, method, generations=60):
        """Fitness of each genome by generation."""
        search, found = METHODS[method](Operators(), 10, seed=1), [None]
        for _ in range(generations):
            found.append([worth(individual.genome) for individual in search.send(found[-1])])
        return np.array(found[1:])

    @pytest.mark.parametrize("method", ["paper", "cmaes"])
    def test_searches_beat_chance(self, method):
        chance, found = self.fitness("random"), self.fitness(method)
        assert found[-20:].mean() > max(
            found[:5].mean(), chance.mean()
        ) + 3 * chance.std() / np.sqrt(50)
        assert found.max() > chance.max()

    @pytest.mark.parametrize("method", METHODS)
    def test_genomes_lie_in_their_ranges(self, method):
        operators = Operators(density_min=0.1, density_max=0.2)
        search, (low, high), fitness = (
            METHODS[method](operators, 10, seed=2),
            ranges(operators),
            None,
        )
        for _ in range(30):
            population = search.send(fitness)
            vectors = np.array([to_vector(individual.genome) for individual in population])
            assert len(population) == 10 and (vectors >= low).all() and (vectors <= high).all()
            fitness = [1000 * v[0] for v in vectors]  # the densest are the fittest
        assert vectors[:, 0].max() <= 0.2 and (method == "random" or vectors[:, 0].mean() > 0.17)

    def test_cma_es_begins_again_when_it_has_converged(self):
        """It converges to points that are alike, and never stays there."""
        search, spreads = METHODS["cmaes"](Operators(), 10, seed=0), []
        population = next(search)
        for _ in range(400):
            spreads.append(np.std([to_vector(individual.genome)[0] for individual in population]))
            population = search.send([1.0] * 10)
        converged = int(np.argmin(spreads))
        assert max(spreads[converged + 1 :]) > 5 * spreads[converged]


@pytest.mark.filterwarnings("error")
def test_only_the_papers_method_needs_room_for_an_elite(monkeypatch, tmp_path):
    begun = pretend(monkeypatch)
    cli.main(
        [
            "evolve",
            "--method=cmaes",
            "--generations=3",
            "--population=2",
            "--out",
            str(tmp_path / "out"),
        ]
    )
    assert len(begun) == 6
