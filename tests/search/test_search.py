"""Searches from end to end: their tables, replicates, seeds and best genomes."""

from dataclasses import asdict, replace
from itertools import pairwise, product

import numpy as np
import pytest
from support.search import SEARCH, contents, genome_of, pretend, seeded, worth

from iswarm_mj.commands import main as cli
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.search import pool
from iswarm_mj.search.best import best_of, by_replicate
from iswarm_mj.search.pool import Execution
from iswarm_mj.search.rows import by
from iswarm_mj.search.search import BEST, CHECKPOINT, TABLE, replicate_seed, run_search
from iswarm_mj.search.seeds import run_seed
from iswarm_mj.strategy.genome import Genome, load_genome
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.tables import read_table

pytestmark = pytest.mark.usefixtures("few_pixels")


def rows_of(out):
    """Return the rows of the table of a search."""
    return read_table(out / TABLE)[0]


@pytest.fixture
def no_figure(monkeypatch):
    """Leave out the figure, which follows from the table and takes most of the time."""
    monkeypatch.setattr("iswarm_mj.search.search.draw_fitness", lambda *_: None)


@pytest.fixture
def job_counts(monkeypatch):
    """Return a list to which pretended runs add the number of jobs of each set."""
    pretend(monkeypatch)
    pretended_jobs = pool.run_jobs
    counts = []

    def run_jobs(jobs, execution):
        counts.append(len(jobs))
        return pretended_jobs(jobs, execution)

    monkeypatch.setattr(pool, "run_jobs", run_jobs)
    return counts


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """Return the directory of a search, and the jobs that it began."""
    out = tmp_path_factory.mktemp("search")
    with pytest.MonkeyPatch.context() as patch:
        jobs = pretend(patch)
        run_search(SEARCH, out)
    return out, jobs


class TestTable:
    """The search has 6 generations of 5 genomes, each run twice."""

    def test_the_files_are_complete(self, searched):
        out, _ = searched
        assert set(contents(out)) == {CHECKPOINT, TABLE, BEST, "fitness.png", "fitness.svg"}
        assert load_genome(str(out / BEST)) == best_of(rows_of(out)).genome

    def test_each_run_has_a_row_with_its_job_and_its_outcome(self, searched):
        out, jobs = searched
        rows = rows_of(out)
        job_of = {job.seed: job for job in jobs}
        assert len(jobs) == len(job_of) == len(rows) == 60
        for row, place in zip(rows, product(range(6), range(5), range(2)), strict=True):
            assert (row["generation"], row["individual"], row["evaluation"]) == place
            assert row["seed"] == run_seed(3, *place)

            job = job_of[row["seed"]]
            assert job.genome == genome_of(row)
            assert job.n_robots == row["n_robots"] == row["collisions"]
            assert job.n_robots == robots_for(SEARCH.config.arena, row["density_of_robots"])
            assert job.steps == row["steps"] == 800
            noise = np.random.default_rng(row["seed"]).normal(0, 20)
            assert row["fitness"] == worth(job.genome) + noise

    def test_the_fitness_of_a_genome_is_the_mean_of_its_runs(self, searched):
        out, _ = searched
        for first, second in by(rows_of(out), "generation", "individual").values():
            mean = (first["fitness"] + second["fitness"]) / 2
            assert first["genome_fitness"] == second["genome_fitness"] == mean
            assert genome_of(first) == genome_of(second)

    def test_the_two_fittest_pass_and_are_run_again_with_other_seeds(self, searched):
        out, _ = searched
        first_runs = [row for row in rows_of(out) if row["evaluation"] == 0]
        generations = list(by(first_runs, "generation").values())
        assert {row["origin"] for row in generations[0]} == {"random"}
        for before, after in pairwise(generations):
            ranking = sorted(before, key=lambda row: -row["genome_fitness"])
            for row, parent in zip(after[:2], ranking[:2], strict=True):
                assert row["origin"] == "elite"
                assert (row["parent"], row["second_parent"]) == (parent["individual"], None)
                assert genome_of(row) == genome_of(parent)
                assert row["seed"] != parent["seed"]


class TestReplicates:
    """Three searches at once."""

    @pytest.mark.usefixtures("no_figure")
    @pytest.mark.parametrize("method", ["paper", "cmaes"])
    def test_each_is_the_search_with_its_seed(self, job_counts, tmp_path, method):
        """No replicate learns from another, and a generation of all is a set of jobs."""
        search = replace(SEARCH, replicates=3, method=method)
        three = tmp_path / "three"
        run_search(search, three)
        assert job_counts == [30] * 6
        assert load_genome(str(three / BEST)) == best_of(rows_of(three)).genome

        for number, rows in enumerate(by_replicate(rows_of(three))):
            alone = tmp_path / str(number)
            run_search(seeded(search, replicate_seed(3, number), replicates=1), alone)
            assert [{**row, "replicate": 0} for row in rows] == rows_of(alone)
            assert load_genome(str(three / f"best-{number}.json")) == best_of(rows).genome

    def test_the_first_has_the_seed_of_the_search(self):
        assert replicate_seed(3, 0) == 3


@pytest.mark.usefixtures("no_figure")
@pytest.mark.parametrize(
    ("max_batch_runs", "engine", "counts"),
    [(25, "planar", [20] * 3), (3, "mjx", [10] * 6)],
)
def test_generations_of_random_search_share_a_batch(
    monkeypatch, job_counts, tmp_path, max_batch_runs, engine, counts
):
    """Other searches need the fitness of a generation before the next one."""
    monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
    monkeypatch.setattr("iswarm_mj.search.search.MAX_BATCH_RUNS", max_batch_runs)
    search = replace(SEARCH, method="random")
    run_search(search, tmp_path / "one by one")
    job_counts.clear()
    run_search(search, tmp_path / "in batches", Execution(find_engine(engine).usual()))
    assert job_counts == counts
    assert rows_of(tmp_path / "in batches") == rows_of(tmp_path / "one by one")


def test_the_best_is_not_the_luckiest():
    lucky = Genome()
    proven = Genome(fraction_scouts=0.2)
    tried_twice = Genome(fraction_scouts=0.3)
    runs = [
        (lucky, 9.0),
        (proven, 5.0),
        (proven, 6.0),
        (tried_twice, 8.0),
        (proven, 7.0),
        (tried_twice, 7.0),
    ]
    rows = [{**asdict(genome), "fitness": fitness} for genome, fitness in runs]
    assert best_of(rows) == (proven, 6.0, 3)
    assert best_of(rows[:3]) == (lucky, 9.0, 1)  # no genome has three runs


def test_replicates_and_runs_have_seeds_of_their_own():
    replicates = [replicate_seed(*place) for place in product(range(20), range(20))]
    assert len(set(replicates)) == 400

    seeds = set()
    for seed, *place in product(replicates[:60], range(10), range(5), range(2)):
        seeds.add(run_seed(seed, *place))
    assert len(seeds) == 6000
    assert 0 <= min(seeds) <= max(seeds) < 2**32 - 1
    assert run_seed(3, 1, 2, 0) != run_seed(3, 2, 1, 0)


@pytest.mark.filterwarnings("error")
def test_only_the_papers_method_needs_room_for_an_elite(monkeypatch, tmp_path):
    jobs = pretend(monkeypatch)
    out = str(tmp_path / "out")
    cli.main(["evolve", "--method=cmaes", "--generations=3", "--population=2", "--out", out])
    assert len(jobs) == 6
