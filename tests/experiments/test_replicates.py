"""Searches that advance together: each is what it is alone."""

import re
from dataclasses import replace

import pytest
from helpers_search import SEARCH, contents, pretend

from iswarm_mj.experiments.analysis.evolution import best_of, by_replicate
from iswarm_mj.experiments.runner import batches, pool
from iswarm_mj.experiments.runner.optimisers import METHODS
from iswarm_mj.experiments.runner.pool import Execution
from iswarm_mj.experiments.runner.search import (
    BEST,
    TABLE,
    replicate_seed,
    run_search,
    run_searches,
    summary,
)
from iswarm_mj.strategy.genome import load_genome
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import read_table


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
        sets, run_jobs = [], pool.run_jobs

        def counted(jobs, execution):
            sets.append(len(jobs))
            return run_jobs(jobs, execution)

        monkeypatch.setattr(pool, "run_jobs", counted)
        self.rows(self.THREE, tmp_path / "out")
        assert sets == [30] * 6

    def test_several_searches_at_once(self, monkeypatch, tmp_path):
        """Of a shorter one too, each is what it is alone; a generation of those that learn is one set of jobs."""
        pretend(monkeypatch)
        searches = [replace(SEARCH, method=method, generations=n) for method, n in zip(METHODS, (6, 6, 2), strict=True)]
        for search in searches:
            run_search(search, tmp_path / "alone" / search.method)
        sets, run_jobs = [], pool.run_jobs
        monkeypatch.setattr(pool, "run_jobs", lambda jobs, how: sets.append(len(jobs)) or run_jobs(jobs, how))
        run_searches({tmp_path / "all" / search.method: search for search in searches})
        assert sets == [10] * 2 + [20] * 6  # two generations of random search, six of the others
        for method in METHODS:
            assert contents(tmp_path / "all" / method) == contents(tmp_path / "alone" / method)

    @pytest.mark.parametrize(
        "at_once, engine, sets",
        [(60, "planar", [60]), (25, "planar", [20] * 3), (3, "planar", [10] * 6), (60, "mjx", [10] * 6)],
    )
    def test_batches_of_planar_take_generations_that_depend_on_none(self, monkeypatch, tmp_path, at_once, engine, sets):
        """MJX's time grows with a batch, and the table of a search in workers with each generation."""
        pretend(monkeypatch)
        monkeypatch.setattr(batches, "can_use_warp", lambda: True)
        search, execution = replace(SEARCH, method="random"), Execution(engine)
        found, run_jobs = [], pool.run_jobs
        monkeypatch.setattr(pool, "run_jobs", lambda jobs, how: found.append(len(jobs)) or run_jobs(jobs, how))
        run_search(search, tmp_path / "default", execution)
        assert found == ([60] if engine == "planar" else [10] * 6)
        found.clear()
        monkeypatch.setattr("iswarm_mj.experiments.runner.search.AT_ONCE", at_once)
        run_search(search, tmp_path / "other", execution)
        assert found == sets and contents(tmp_path / "other") == contents(tmp_path / "default")

    def test_several_interrupted_searches_go_on(self, monkeypatch, tmp_path):
        """With some runs of each there, the others not begun."""
        searches = {tmp_path / method: replace(SEARCH, method=method) for method in METHODS}
        pretend(monkeypatch, 40)
        with pytest.raises(KeyboardInterrupt):
            run_searches(searches, Execution(workers=1))
        begun = pretend(monkeypatch)
        run_searches(searches, Execution(workers=1), resume=True)
        assert len(begun) == 3 * 60 - 40
        for out, search in searches.items():
            run_search(search, tmp_path / "alone" / search.method)
            assert contents(out) == contents(tmp_path / "alone" / search.method)

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
        monkeypatch.setattr(batches, "can_use_warp", lambda: True)
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
            (SEARCH, self.THREE, r"\(replicates: 1 there, 3 now\)"),
            (self.THREE, SEARCH, r"\(replicates: 3 there, 1 now\)"),
        ):
            out = tmp_path / str(had.replicates)
            run_search(had, out)
            before = contents(out)
            with pytest.raises(UserError, match=message):
                run_search(wanted, out, resume=True)
            assert contents(out) == before
