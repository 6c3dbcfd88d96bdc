"""Searches from end to end: their tables, their optimisers, and that no interruption changes a byte."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import asdict, astuple, replace

import numpy as np
import pytest

from iswarm_mj.commands import main as cli
from iswarm_mj.experiments.analysis.evolution_best import best_of, by_replicate, genome_of
from iswarm_mj.experiments.runner import pool, resumable
from iswarm_mj.experiments.runner.checkpoint import Journal
from iswarm_mj.experiments.runner.jobs import Job, Outcome, run_job
from iswarm_mj.experiments.runner.optimisers import METHODS, CmaEs, generator, optimiser
from iswarm_mj.experiments.runner.pool import Execution
from iswarm_mj.experiments.runner.search import (
    BEST,
    CHECKPOINT,
    TABLE,
    Search,
    replicate_seed,
    run_search,
    run_seed,
    summary,
)
from iswarm_mj.experiments.runner.search_table import Place
from iswarm_mj.simulation.initial import robots_for
from iswarm_mj.strategy.evolution import Operators, ranges, to_vector
from iswarm_mj.strategy.genome import PRESETS, Genome, load_genome
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.serialization import to_dict
from iswarm_mj.utils.tables import read_table

GOAL = to_vector(PRESETS["type2"])
SEARCH = Search(generations=6, population=5, seed=3, evaluations=2)


def worth(genome):
    """Fitness without noise, 1000 at most: how near a genome is to that of type 2."""
    return float(1000 - 80 * np.abs(to_vector(genome) - GOAL).sum())


def pretend(monkeypatch, breaks_after=None):
    """Jobs without physics, finished in an order that depends on the workers; returns those that were begun."""
    begun = []

    def run_jobs(jobs, execution):
        for index in np.random.default_rng(execution.workers).permutation(len(jobs)):
            if breaks_after is not None and len(begun) >= breaks_after:
                raise KeyboardInterrupt
            job = jobs[index]
            begun.append(job)
            noise = np.random.default_rng(job.seed).normal(0, 20)
            picked = int(noise) % 70 + 2
            yield (
                int(index),
                Outcome(picked - 1, picked, job.n_robots, None, None, job.steps, worth(job.genome) + noise),
            )

    monkeypatch.setattr(resumable, "run_jobs", run_jobs)
    return begun


def contents(out):
    return {path.name: path.read_bytes() for path in out.iterdir()}


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
        assert all(row["seed"] == run_seed(SEARCH, Place(*place)) for row, place in zip(rows, places, strict=True))

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

    def test_tells_its_settings(self, done):
        _, _, settings, _ = done
        assert settings == {"version": settings["version"], **json.loads(json.dumps(to_dict(SEARCH)))}

    def test_the_best_is_a_genome_file(self, done):
        out, rows, _, _ = done
        assert load_genome(str(out / BEST)) == best_of(rows).genome

    def test_files(self, done):
        assert sorted(contents(done[0])) == sorted([CHECKPOINT, TABLE, BEST, "fitness.png", "fitness.svg"])


def test_the_best_is_not_the_luckiest():
    lucky, proven, tried = Genome(), Genome(fraction_scouts=0.2), Genome(fraction_scouts=0.3)
    runs = [(lucky, 9.0), (proven, 5.0), (proven, 6.0), (tried, 8.0), (proven, 7.0), (tried, 7.0)]
    rows = [{**asdict(genome), "fitness": fitness} for genome, fitness in runs]
    assert best_of(rows) == (proven, 6.0, 3)
    assert best_of(rows[:3]) == (lucky, 9.0, 1)


def test_a_fitness_of_almost_nothing_has_no_sign(tmp_path):
    rows = [{"generation": 0, "delivered": 0, "fitness": -0.02, **asdict(Genome())}]
    told = summary(replace(SEARCH, generations=1), rows, best_of(rows), tmp_path)
    assert "fitness  0 on average" in told and "best  0 on average" in told


def test_seeds_differ_and_are_seeds():
    seeds = {
        run_seed(replace(SEARCH, seed=s), Place(g, i, k, r))
        for s in range(5)
        for g in range(20)
        for i in range(10)
        for k in range(2)
        for r in range(3)
    }
    assert len(seeds) == 6000 and max(seeds) < 2**32 - 1 and min(seeds) >= 0
    assert run_seed(SEARCH, Place(1, 2, 0)) != run_seed(SEARCH, Place(2, 1, 0))
    assert len({replicate_seed(seed, r) for seed in range(20) for r in range(20)}) == 400


def test_generations_and_seeds_have_random_numbers_of_their_own():
    assert len({generator(seed, generation).random() for seed in range(5) for generation in range(20)}) == 100
    search, found = optimiser("random", Operators(), 10, 3), []
    for _ in range(4):
        found += [individual.genome for individual in search.ask()]
        search.tell([1.0] * 10)
    assert len(set(found)) == 40


class TestReplicates:
    """Three searches at once."""

    THREE = replace(SEARCH, replicates=3)

    @pytest.fixture(autouse=True)
    def no_figures(self, monkeypatch):
        monkeypatch.setattr("iswarm_mj.experiments.runner.search.draw_fitness", lambda *_: None)

    def rows(self, search, out):
        run_search(search, out)
        return read_table(out / TABLE)[0]

    @pytest.mark.parametrize("method", METHODS)
    def test_each_is_the_search_with_its_seed(self, monkeypatch, tmp_path, method):
        """The first that of the seed itself; no replicate learns from another."""
        pretend(monkeypatch)
        search = replace(self.THREE, method=method)
        together = by_replicate(self.rows(search, tmp_path / "three"))
        assert [len(rows) for rows in together] == [60] * 3 and replicate_seed(3, 0) == 3
        for number, rows in enumerate(together):
            alone = replace(search, seed=replicate_seed(3, number), replicates=1)
            expected = self.rows(alone, tmp_path / str(number))
            assert [row | {"replicate": 0} for row in rows] == expected
            assert {row["replicate"] for row in rows} == {number}

    def test_a_generation_of_all_is_one_set_of_jobs(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        sets, run_jobs = [], resumable.run_jobs

        def counted(jobs, execution):
            sets.append(len(jobs))
            return run_jobs(jobs, execution)

        monkeypatch.setattr(resumable, "run_jobs", counted)
        self.rows(self.THREE, tmp_path / "out")
        assert sets == [30] * 6

    def test_the_best_of_all_and_of_each(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        rows = self.rows(self.THREE, tmp_path)
        files = [tmp_path / f"best-{number}.json" for number in range(3)]
        assert [load_genome(str(file)) for file in files] == [best_of(mine).genome for mine in by_replicate(rows)]
        assert (tmp_path / BEST).read_bytes() in [file.read_bytes() for file in files]
        assert load_genome(str(tmp_path / BEST)) == best_of(rows).genome
        told = summary(self.THREE, rows, best_of(rows), tmp_path)
        assert "paper, 3 times 6 generations of 5" in told and "runs  180, of which" in told
        top = [best_of(mine).fitness for mine in by_replicate(rows)]
        for number, fitness in enumerate(top):
            assert re.search(rf"replicate {number}  0 of 60 delivered all, fitness \d+, best {fitness:.0f} over", told)
        assert "replicate 3" not in told

    @pytest.mark.parametrize("engine", ["mujoco", "mjx", "planar"])
    def test_an_interruption_changes_nothing(self, monkeypatch, tmp_path, engine):
        """With batches a generation that is known in part is run again as a whole, in all replicates."""
        monkeypatch.setattr(pool, "can_use_warp", lambda: True)
        pretend(monkeypatch)
        run_search(self.THREE, tmp_path / "whole", execution=Execution(engine, workers=1))
        for number, breaks_after in enumerate((0, 17, 30, 100, 179)):
            out = tmp_path / str(number)
            pretend(monkeypatch, breaks_after)
            with pytest.raises(KeyboardInterrupt):
                run_search(self.THREE, out, execution=Execution(engine, workers=2))
            begun = pretend(monkeypatch)
            run_search(self.THREE, out, resume=True, execution=Execution(engine, workers=3))
            assert contents(out) == contents(tmp_path / "whole")
            assert len(begun) == 180 - (breaks_after if engine == "mujoco" else breaks_after // 30 * 30)

    def test_another_number_is_refused(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        for had, wanted, message in (
            (SEARCH, self.THREE, r"\(replicates: the default there, 3 now\)"),
            (self.THREE, SEARCH, r"\(replicates: 3 there, the default now\)"),
        ):
            out = tmp_path / str(had.replicates)
            run_search(had, out)
            before = contents(out)
            with pytest.raises(UserError, match=message):
                run_search(wanted, out, resume=True)
            assert contents(out) == before

    def test_one_has_the_files_of_before(self, monkeypatch, tmp_path):
        """A checkpoint neither names replicates nor has them in its keys; one best genome."""
        pretend(monkeypatch)
        run_search(SEARCH, tmp_path)
        head, *lines = (tmp_path / CHECKPOINT).read_bytes().splitlines()
        assert b"replicates" not in head and json.loads(lines[0][9:])[0] == [0, 0, 0]
        assert sorted(contents(tmp_path)) == [BEST, CHECKPOINT, TABLE]


class TestResume:
    @pytest.fixture(autouse=True)
    def no_figures(self, monkeypatch):
        """Figures follow from the table and take most of the time; `TestTable` has them."""
        monkeypatch.setattr("iswarm_mj.experiments.runner.search.draw_fitness", lambda *_: None)

    @pytest.mark.parametrize("method", METHODS)
    def test_an_interruption_changes_nothing(self, monkeypatch, tmp_path, method):
        search = replace(SEARCH, method=method)
        pretend(monkeypatch)
        run_search(search, tmp_path / "whole", execution=Execution(workers=1))
        for number, breaks_after in enumerate((0, 1, 13, 20, 59)):
            out = tmp_path / str(number)
            pretend(monkeypatch, breaks_after)
            with pytest.raises(KeyboardInterrupt):
                run_search(search, out, execution=Execution(workers=2))
            begun = pretend(monkeypatch)
            run_search(search, out, resume=True, execution=Execution(workers=3))
            assert contents(out) == contents(tmp_path / "whole")
            assert len(begun) == 60 - breaks_after

    def test_with_mjx_a_generation_in_parts_is_one_batch_again(self, monkeypatch, tmp_path):
        """The end came between lines of the second generation, then of that again, at another run."""
        begun = pretend(monkeypatch)
        run_search(SEARCH, tmp_path / "whole", execution=Execution("mjx"))
        batch = begun[10:20]
        out = tmp_path / "out"
        for runs in (17, 4):
            pretend(monkeypatch, runs)
            with pytest.raises(KeyboardInterrupt):
                run_search(SEARCH, out, resume=True, execution=Execution("mjx"))
        begun = pretend(monkeypatch)
        run_search(SEARCH, out, resume=True, execution=Execution("mjx"))
        assert len(begun) == 50 and begun[:10] == batch
        assert contents(out) == contents(tmp_path / "whole")

    def test_a_finished_search_is_not_run_again(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        run_search(SEARCH, tmp_path / "out")
        before = contents(tmp_path / "out")
        begun = pretend(monkeypatch)
        run_search(SEARCH, tmp_path / "out", resume=True)
        assert contents(tmp_path / "out") == before and begun == []

    def test_the_table_is_there_after_each_generation(self, monkeypatch, tmp_path):
        pretend(monkeypatch, breaks_after=35)
        with pytest.raises(KeyboardInterrupt):
            run_search(SEARCH, tmp_path / "out")
        assert len(read_table(tmp_path / "out" / TABLE)[0]) == 30
        assert not (tmp_path / "out" / BEST).exists()

    def test_half_written_files_go(self, monkeypatch, tmp_path):
        out = tmp_path / "out"
        out.mkdir()
        for name in (TABLE, "fitness.svg"):
            (out / f".123-{name}").write_text("half")
        (out / ".123-mine").write_text("mine")
        pretend(monkeypatch)
        run_search(SEARCH, out)
        assert len(contents(out)) == 4 and (out / ".123-mine").read_text() == "mine"

    def test_what_is_in_the_way_is_refused(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        run_search(SEARCH, tmp_path)
        before = contents(tmp_path)
        refusals = [
            (
                SEARCH,
                False,
                r"^out must be .* without a search \(got .*\); continue the search with `resume`$",
            ),
            (replace(SEARCH, seed=4), True, r"different settings \(seed: 3 there, 4 now\)"),
            (replace(SEARCH, operators=Operators(span=0.1)), True, r"\(operators\.span: 0\.05 there, 0\.1 now\)"),
        ]
        for search, resume, message in refusals:
            with pytest.raises(UserError, match=message):
                run_search(search, tmp_path, resume=resume)
            assert contents(tmp_path) == before
        (tmp_path / CHECKPOINT).unlink()
        with pytest.raises(UserError, match=r"without a search \(got .*\); this one lacks its checkpoint\.jsonl$"):
            run_search(SEARCH, tmp_path, resume=True)

    def test_another_engine_is_refused(self, monkeypatch, tmp_path):
        begun = pretend(monkeypatch)
        for name, one, other, message in (
            ("c", "mujoco", "mjx", r"\(engine: the default there, mjx now, impl: the default there, jax now\)"),
            ("mjx", "mjx", "mujoco", r"\(engine: mjx there, the default now, impl: jax there, the default now\)"),
        ):
            run_search(SEARCH, tmp_path / name, execution=Execution(one))
            before = contents(tmp_path / name)
            begun.clear()
            with pytest.raises(UserError, match=message):
                run_search(SEARCH, tmp_path / name, resume=True, execution=Execution(other))
            run_search(SEARCH, tmp_path / name, resume=True, execution=Execution(one))
            assert contents(tmp_path / name) == before and begun == []
        assert read_table(tmp_path / "mjx" / TABLE)[1]["engine"] == "mjx"

    def test_checkpoints_of_before_there_were_engines_orders_and_replicates_go_on(self, monkeypatch, tmp_path):
        """Their settings name none of these, nor mutations of Booleans; the files in the end do not either."""
        begun = pretend(monkeypatch)
        run_search(SEARCH, tmp_path / "whole")
        settings = to_dict(SEARCH)
        assert not re.search("engine|update_order|replicates|boolean_mutation", json.dumps(settings))
        with Journal(tmp_path / "whole" / CHECKPOINT, settings) as journal:
            runs = dict(list(journal.entries.items())[:27])
        (tmp_path / "old").mkdir()
        with Journal(tmp_path / "old" / CHECKPOINT, settings) as journal:
            for key, entry in runs.items():
                journal.add(key, entry)
        begun.clear()
        run_search(SEARCH, tmp_path / "old", resume=True)
        assert contents(tmp_path / "old") == contents(tmp_path / "whole") and len(begun) == 33

    def test_a_checkpoint_of_another_program_is_refused(self, monkeypatch, tmp_path):
        """Of the same settings and versions, but with a genome that does not follow from them."""
        pretend(monkeypatch)
        run_search(SEARCH, tmp_path)
        with Journal(tmp_path / CHECKPOINT, to_dict(SEARCH)) as journal:
            entry = journal.entries[2, 4, 0]
            entry["genome"] = list(astuple(Genome()))
            journal.settle()
        with pytest.raises(UserError, match=r"another genome in generation 2 than this version of the program"):
            run_search(SEARCH, tmp_path, resume=True)


class TestOptimisers:
    def fitness(self, method, generations=60):
        """Fitness of each genome by generation."""
        search, found = optimiser(method, Operators(), 10, seed=1), []
        for _ in range(generations):
            found.append([worth(individual.genome) for individual in search.ask()])
            search.tell(found[-1])
        return np.array(found)

    @pytest.mark.parametrize("method", ["paper", "cmaes"])
    def test_searches_beat_chance(self, method):
        chance, found = self.fitness("random"), self.fitness(method)
        assert found[-20:].mean() > max(found[:5].mean(), chance.mean()) + 3 * chance.std() / np.sqrt(50)
        assert found.max() > chance.max()

    def test_random_search_does_not_learn(self):
        chance = self.fitness("random", 200)
        assert abs(chance[:100].mean() - chance[100:].mean()) < 3 * chance.std() / np.sqrt(500)

    @pytest.mark.parametrize("method", METHODS)
    def test_genomes_lie_in_their_ranges(self, method):
        operators = Operators(density_min=0.1, density_max=0.2)
        search, (low, high) = optimiser(method, operators, 10, seed=2), ranges(operators)
        for _ in range(30):
            population = search.ask()
            vectors = np.array([to_vector(individual.genome) for individual in population])
            assert len(population) == 10 and (vectors >= low).all() and (vectors <= high).all()
            search.tell([1000 * v[0] for v in vectors])  # the densest are the fittest
        assert vectors[:, 0].max() <= 0.2 and (method == "random" or vectors[:, 0].mean() > 0.17)

    def test_cma_es_begins_again_when_it_has_converged(self, monkeypatch):
        search = CmaEs(Operators(), 10, seed=0)
        first, starts = search._search, []
        for _ in range(400):
            spread = np.std([to_vector(i.genome)[0] for i in search.ask()])
            search.tell([worth(Genome())] * 10)
            starts.append(spread)
            if search._search is not first:
                break
        assert search._search is not first
        assert np.std([to_vector(i.genome)[0] for i in search.ask()]) > 0.02


TINY = [
    "--arena.size=15",
    "--arena.dump-size=3",
    "--arena.dust-area-size=3",
    "--arena.dust-area-offset=5",
    "--arena.n-dust=24",
    "--operators.density-min=0.0556",
    "--operators.density-max=0.0556",
    "--steps=20",
    "--seed=7",
]
"""12 robots; JAX compiles once."""


def command(out, *flags):
    return [sys.executable, "-m", "iswarm_mj", "evolve", *TINY, *flags, "--out", str(out)]


def killed_at(lines, delay, out, *flags):
    """Run `iswarm evolve` and kill -9 it when the checkpoint has so many lines, a little later; whether it lived."""
    path = out / CHECKPOINT
    with subprocess.Popen(
        command(out, *flags, "--resume"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        while process.poll() is None and not (path.exists() and path.read_bytes().count(b"\n") >= lines):
            time.sleep(0.002)
        time.sleep(delay)
        lived = process.poll() is None
        if lived:
            os.kill(process.pid, signal.SIGKILL)
    assert process.returncode == (-signal.SIGKILL if lived else 0)
    return lived


KILLED = """
import os, signal, sys
from iswarm_mj.commands.main import main
from iswarm_mj.experiments.runner.checkpoint import Journal

add = Journal.add

def add_and_die(journal, key, entry):
    add(journal, key, entry)
    if len(journal.entries) == 5:
        os.kill(os.getpid(), signal.SIGKILL)

Journal.add = add_and_die
main(sys.argv[1:])
"""


def test_killed_and_resumed(tmp_path):
    """The process is really killed, in the second generation; the files are the same as without."""
    flags = ["--generations=3", "--population=4", "--workers=1"]
    cli.main(command(tmp_path / "whole", *flags)[3:])
    given = [sys.executable, "-c", KILLED, *command(tmp_path / "out", *flags)[3:]]
    assert subprocess.run(given, stdout=subprocess.DEVNULL, timeout=600).returncode == -signal.SIGKILL
    assert (tmp_path / "out" / CHECKPOINT).read_bytes().count(b"\n") == 6
    cli.main([*command(tmp_path / "out", *flags)[3:], "--resume"])
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    rows, _ = read_table(tmp_path / "out" / TABLE)
    assert len(rows) == 12 and {row["n_robots"] for row in rows} == {12} and len({row["fitness"] for row in rows}) > 6


def test_generations_as_batches(small, tmp_path):
    """Two generations in MJX, with swarms of two sizes; their first steps are those of MuJoCo C."""
    out = tmp_path / "out"
    flags = [
        "--engine=mjx",
        "--generations=2",
        "--population=2",
        "--operators.elite=1",
        "--operators.density-max=0.07",
        "--steps=6",
    ]
    cli.main(command(out, *flags)[3:])
    rows, settings = read_table(out / TABLE)
    assert (settings["engine"], settings["impl"]) == ("mjx", "jax")
    sizes = [row["n_robots"] for row in rows]
    assert len(rows) == 4 and max(sizes[:2]) != max(sizes[2:]) and min(sizes[:2]) < max(sizes[:2])
    for row in rows:
        alone = run_job(Job(small, genome_of(row), row["n_robots"], row["seed"], row["steps"]))
        assert (row["steps"], row["delivered"], row["picked"]) == (6, alone.delivered, alone.picked)
    assert sum(row["picked"] for row in rows) > 0
    before = contents(out)
    cli.main([*command(out, *flags)[3:], "--resume"])
    assert contents(out) == before


@pytest.mark.parametrize(
    "flags, message",
    [
        ("--engine abacus", r"\('mujoco', 'planar', 'mjx'\)"),
        ("--engine mjx --backend ray", r"--backend must be processes with --engine mjx \(got 'ray'\)"),
        ("--generations 0", r"--generations must be a whole number between 1 and 100000 \(got 0\)"),
        ("--population 1", r"--population must be .*\(got 1\)"),
        ("--population 2", r"--operators\.elite must be below --population \(got 2\)"),
        ("--replicates 0", r"--replicates must be a whole number between 1 and 1000 \(got 0\)"),
        ("--evaluations 0", r"--evaluations must be .*\(got 0\)"),
        ("--steps 0", r"--steps must be .*\(got 0\)"),
        ("--seed -1", r"--seed must be .*\(got -1\)"),
        ("--workers -1", r"--workers must be .*\(got -1\)"),
        ("--method bees", r"\('paper', 'cmaes', 'random'\)"),
        ("--backend abacus", r"\('processes', 'ray'\)"),
        ("--operators.span nan", r"--operators\.span must be .*\(got nan\)"),
        ("--operators.density-max 2", r"--operators\.density-max must be .*\(got 2\.0\)"),
        ("--arena.n-dust 0", r"--arena\.n-dust must be .*\(got 0\)"),
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


def test_a_search_is_summed_up(capfd, tmp_path, monkeypatch):
    pretend(monkeypatch)
    cli.main(["evolve", "--generations=4", "--population=5", "--seed=3", "--out", str(tmp_path / "out")])
    out, error = capfd.readouterr()
    rows, _ = read_table(tmp_path / "out" / TABLE)
    assert "paper, 4 generations of 5, seed 3" in out and "runs  20, of which" in out and error == ""
    assert f"p_vector_forget = {best_of(rows).genome.p_vector_forget:.3g}" in out


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_killed_at_five_random_moments(tmp_path, method):
    """One search, killed five times, with two workers."""
    flags = ["--generations=5", "--population=4", "--workers=2", "--evaluations=2", f"--method={method}"]
    subprocess.run(command(tmp_path / "whole", *flags), check=True, stdout=subprocess.DEVNULL)
    generator = np.random.default_rng()
    moments = [(int(generator.integers(0, 41)), generator.uniform(0, 0.5)) for _ in range(5)]
    lived = [killed_at(*moment, tmp_path / "out", *flags) for moment in sorted(moments)]
    print(f"{method}: killed at lines and seconds after {sorted(moments)}: {lived}")
    subprocess.run([*command(tmp_path / "out", *flags), "--resume"], check=True, stdout=subprocess.DEVNULL)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
