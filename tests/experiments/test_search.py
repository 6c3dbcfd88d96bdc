"""Searches from end to end: their tables, their optimisers, and that no interruption changes a byte."""

import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from helpers_search import SEARCH, contents, genome_of, pretend, worth

from iswarm_mj.commands import main as cli
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.experiments.analysis.evolution import best_of, by_replicate
from iswarm_mj.experiments.runner import pool
from iswarm_mj.experiments.runner.evolution import METHODS, Operators, generator, proposals, ranges, to_vector
from iswarm_mj.experiments.runner.experiment import run_seed
from iswarm_mj.experiments.runner.pool import Execution
from iswarm_mj.experiments.runner.search import (
    BEST,
    CHECKPOINT,
    TABLE,
    replicate_seed,
    run_search,
)
from iswarm_mj.strategy.genome import Genome, load_genome
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.tables import read_table

pytestmark = pytest.mark.usefixtures("few_pixels")


class TestTable:
    @pytest.fixture
    def done(self, monkeypatch, tmp_path):
        begun = pretend(monkeypatch)
        run_search(SEARCH, tmp_path / "out")
        rows, settings = read_table(tmp_path / "out" / TABLE)
        return tmp_path / "out", rows, settings, begun

    def test_holds_every_run_once(self, done):
        _, rows, _, begun = done
        places = [(row["generation"], row["individual"], row["evaluation"]) for row in rows]
        assert places == [(g, i, k) for g in range(6) for i in range(5) for k in range(2)]
        assert len(begun) == 60 and {job.seed for job in begun} == {row["seed"] for row in rows}
        assert all(row["seed"] == run_seed(3, *place) for row, place in zip(rows, places, strict=True))

    def test_a_row_says_what_was_run_and_what_came_of_it(self, done):
        _, rows, _, begun = done
        by_seed = {job.seed: job for job in begun}
        for row in rows:
            job = by_seed[row["seed"]]
            assert job.genome == genome_of(row) and job.steps == row["steps"] == 800
            assert row["n_robots"] == job.n_robots == row["collisions"]
            assert job.n_robots == robots_for(SEARCH.config.arena, row["density_of_robots"])
            assert row["fitness"] == worth(job.genome) + np.random.default_rng(row["seed"]).normal(0, 20)
        for one, other in zip(rows[::2], rows[1::2], strict=True):
            mean = (one["fitness"] + other["fitness"]) / 2
            assert one["genome_fitness"] == other["genome_fitness"] == mean
            assert genome_of(one) == genome_of(other)

    def test_the_elite_is_run_again_with_other_seeds(self, done):
        _, rows, _, _ = done
        of = {(row["generation"], row["individual"]): row for row in rows}
        for g in range(1, 6):
            order = sorted(range(5), key=lambda i, g=g: -of[g - 1, i]["genome_fitness"])
            for place in (0, 1):
                row = of[g, place]
                assert (row["origin"], row["parent"], row["second_parent"]) == ("elite", order[place], None)
                assert genome_of(row) == genome_of(of[g - 1, order[place]])
                assert row["seed"] != of[g - 1, order[place]]["seed"]
        assert {of[0, i]["origin"] for i in range(5)} == {"random"}

    def test_files(self, done):
        out, rows, _, _ = done
        assert sorted(contents(out)) == sorted([CHECKPOINT, TABLE, BEST, "fitness.png", "fitness.svg"])
        assert load_genome(str(out / BEST)) == best_of(rows).genome


class TestReplicates:
    """Three searches at once."""

    @pytest.mark.parametrize("method", METHODS)
    def test_each_is_the_search_with_its_seed(self, monkeypatch, tmp_path, method):
        """The first that of the seed itself; no replicate learns from another; a generation of all is a set of jobs."""
        begun, sets, run_jobs = pretend(monkeypatch), [], pool.run_jobs
        monkeypatch.setattr(pool, "run_jobs", lambda jobs, how: sets.append(len(jobs)) or run_jobs(jobs, how))
        monkeypatch.setattr("iswarm_mj.experiments.runner.search.draw_fitness", lambda *_: None)
        search = replace(SEARCH, replicates=3, method=method)
        run_search(search, tmp_path / "three")
        together = by_replicate(read_table(tmp_path / "three" / TABLE)[0])
        assert len(begun) == 180 and sets == [30] * 6 and replicate_seed(3, 0) == 3
        for number, rows in enumerate(together):
            out = tmp_path / str(number)
            run_search(replace(search, seed=replicate_seed(3, number), replicates=1), out)
            assert [row | {"replicate": 0} for row in rows] == read_table(out / TABLE)[0]
            assert load_genome(str(tmp_path / "three" / f"best-{number}.json")) == best_of(rows).genome
        whole = [row for rows in together for row in rows]
        assert load_genome(str(tmp_path / "three" / BEST)) == best_of(whole).genome

    @pytest.mark.parametrize(
        "at_once, engine, sets",
        [(60, "planar", [60]), (25, "planar", [20] * 3), (3, "planar", [10] * 6), (60, "mjx", [60])],
    )
    def test_batches_of_planar_take_generations_that_depend_on_none(self, monkeypatch, tmp_path, at_once, engine, sets):
        """MJX's time grows with a batch, and the table of a search in workers with each generation."""
        pretend(monkeypatch)
        monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
        monkeypatch.setattr("iswarm_mj.experiments.runner.search.AT_ONCE", at_once)
        monkeypatch.setattr("iswarm_mj.experiments.runner.search.draw_fitness", lambda *_: None)
        search = replace(SEARCH, method="random")
        found, run_jobs = [], pool.run_jobs
        run_search(search, tmp_path / "alone")
        monkeypatch.setattr(pool, "run_jobs", lambda jobs, how: found.append(len(jobs)) or run_jobs(jobs, how))
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
    seeds = {
        run_seed(replicate_seed(s, r), g, i, k)
        for s in range(5)
        for g in range(20)
        for i in range(10)
        for k in range(2)
        for r in range(3)
    }
    assert len(seeds) == 6000 and max(seeds) < 2**32 - 1 and min(seeds) >= 0
    assert run_seed(3, 1, 2, 0) != run_seed(3, 2, 1, 0)
    assert len({replicate_seed(seed, r) for seed in range(20) for r in range(20)}) == 400


def test_generations_and_seeds_have_random_numbers_of_their_own():
    assert len({generator(seed, generation).random() for seed in range(5) for generation in range(20)}) == 100
    search = proposals("random", Operators(), 10, 3)
    assert len({individual.genome for _ in range(4) for individual in next(search)}) == 40


class TestOptimisers:
    def fitness(self, method, generations=60):
        """Fitness of each genome by generation."""
        search, found = proposals(method, Operators(), 10, seed=1), [None]
        for _ in range(generations):
            found.append([worth(individual.genome) for individual in search.send(found[-1])])
        return np.array(found[1:])

    @pytest.mark.parametrize("method", ["paper", "cmaes"])
    def test_searches_beat_chance(self, method):
        chance, found = self.fitness("random"), self.fitness(method)
        assert found[-20:].mean() > max(found[:5].mean(), chance.mean()) + 3 * chance.std() / np.sqrt(50)
        assert found.max() > chance.max()

    @pytest.mark.parametrize("method", METHODS)
    def test_genomes_lie_in_their_ranges(self, method):
        operators = Operators(density_min=0.1, density_max=0.2)
        search, (low, high), fitness = proposals(method, operators, 10, seed=2), ranges(operators), None
        for _ in range(30):
            population = search.send(fitness)
            vectors = np.array([to_vector(individual.genome) for individual in population])
            assert len(population) == 10 and (vectors >= low).all() and (vectors <= high).all()
            fitness = [1000 * v[0] for v in vectors]  # the densest are the fittest
        assert vectors[:, 0].max() <= 0.2 and (method == "random" or vectors[:, 0].mean() > 0.17)

    def test_cma_es_begins_again_when_it_has_converged(self):
        """It converges to points that are alike, and never stays there."""
        search, spreads = proposals("cmaes", Operators(), 10, seed=0), []
        population = next(search)
        for _ in range(400):
            spreads.append(np.std([to_vector(individual.genome)[0] for individual in population]))
            population = search.send([1.0] * 10)
        converged = int(np.argmin(spreads))
        assert max(spreads[converged + 1 :]) > 5 * spreads[converged]


@pytest.mark.parametrize(
    "flags, message",
    [
        ("--engine mjx --backend ray", r"--backend must be processes with --engine mjx and --impl jax \(got 'ray'\)"),
        ("--generations 0", r"--generations must be a whole number between 1 and 100000 \(got 0\)"),
        ("--population 2", r"--operators\.elite must be below --population \(got 2\)"),
        ("--replicates 0", r"--replicates must be a whole number between 1 and 1000 \(got 0\)"),
        ("--operators.span nan", r"--operators\.span must be .*\(got nan\)"),
        ("--operators.density-max 2", r"--operators\.density-max must be .*\(got 2\.0\)"),
    ],
)
def test_refusals(capfd, tmp_path, monkeypatch, flags, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        cli.main(["evolve", *flags.split()])
    out, error = capfd.readouterr()
    assert stop.value.code == 2 and out == "" and error.count("\n") < 9
    assert re.search(message, re.sub(r"[\s│]+", " ", error)) and not list(tmp_path.iterdir())


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("method", ["cmaes", "random"])
def test_only_the_papers_method_needs_room_for_an_elite(monkeypatch, tmp_path, method):
    begun = pretend(monkeypatch)
    cli.main(["evolve", "--method", method, "--generations=3", "--population=2", "--out", str(tmp_path / "out")])
    assert len(begun) == 6
