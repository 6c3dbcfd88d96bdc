"""Searches that end early and go on, whatever ended them; and what is refused."""

from dataclasses import replace

import pytest
from support.search import SEARCH, contents, pretend, seeded

from iswarm_mj.engines.registry import find_engine
from iswarm_mj.search.methods import Operators
from iswarm_mj.search.pool import Execution
from iswarm_mj.search.search import (
    BEST,
    TABLE,
    run_search,
)
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import read_table


class TestResume:
    @pytest.fixture(autouse=True)
    def no_figures(self, monkeypatch):
        """Figures follow from the table and take most of the time; `TestTable` has them."""
        monkeypatch.setattr("iswarm_mj.search.search.draw_fitness", lambda *_: None)

    @pytest.mark.parametrize(("method", "engine"), [("paper", "mujoco"), ("cmaes", "planar")])
    def test_an_interruption_changes_nothing(self, monkeypatch, tmp_path, method, engine):
        """With batches a generation that is known in part is run again as a whole, in all
        replicates."""
        monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
        monkeypatch.setattr("iswarm_mj.search.search.AT_ONCE", 1)
        search = replace(SEARCH, method=method, replicates=2)
        pretend(monkeypatch)
        run_search(
            search, tmp_path / "whole", execution=Execution(find_engine(engine).usual(), workers=1)
        )
        for number, breaks_after in enumerate((0, 33)):
            out = tmp_path / str(number)
            pretend(monkeypatch, breaks_after)
            with pytest.raises(KeyboardInterrupt):
                run_search(search, out, execution=Execution(find_engine(engine).usual(), workers=2))
            begun = pretend(monkeypatch)
            run_search(search, out, execution=Execution(find_engine(engine).usual(), workers=3))
            assert contents(out) == contents(tmp_path / "whole")
            assert len(begun) == 120 - (
                breaks_after if engine == "mujoco" else breaks_after // 20 * 20
            )

    def test_the_table_is_there_after_each_generation_and_half_written_files_go(
        self, monkeypatch, tmp_path
    ):
        out = tmp_path / "out"
        pretend(monkeypatch, breaks_after=35)
        with pytest.raises(KeyboardInterrupt):
            run_search(SEARCH, out)
        assert len(read_table(out / TABLE)[0]) == 30 and not (out / BEST).exists()
        for name in (TABLE, "fitness.svg"):
            (out / f".123-{name}").write_text("half")
        (out / ".123-mine").write_text("mine")
        pretend(monkeypatch)
        run_search(SEARCH, out)
        assert len(contents(out)) == 4 and (out / ".123-mine").read_text() == "mine"

    def test_what_is_in_the_way_is_refused_and_what_is_finished_not_run_again(
        self, monkeypatch, tmp_path
    ):
        pretend(monkeypatch)
        run_search(SEARCH, tmp_path)
        before, begun = contents(tmp_path), pretend(monkeypatch)
        run_search(SEARCH, tmp_path)
        for change, message in (
            ({"scenario": Scenario(seed=4)}, r"different settings \(seed: 3 there, 4 now\)"),
            ({"replicates": 3}, r"\(replicates: 1 there, 3 now\)"),
            ({"operators": Operators(span=0.1)}, r"\(operators\.span: 0\.05 there, 0\.1 now\)"),
        ):
            with pytest.raises(UserError, match=message):
                run_search(replace(SEARCH, **change), tmp_path)
        assert contents(tmp_path) == before and begun == []
        run_search(seeded(SEARCH, 4), tmp_path, again=True)
        assert len(begun) == 60 and contents(tmp_path) != before
