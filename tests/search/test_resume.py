"""Searches that end early and are resumed, and directories that a search refuses."""

from dataclasses import replace

import pytest
from support.search import SEARCH, contents, pretend, seeded

from iswarm_mj.engines.registry import find_engine
from iswarm_mj.search.methods import Operators
from iswarm_mj.search.pool import Execution
from iswarm_mj.search.search import BEST, TABLE, run_search
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import read_table


@pytest.fixture(autouse=True)
def no_figure(monkeypatch):
    """Leave out the figure, which follows from the table and takes most of the time."""
    monkeypatch.setattr("iswarm_mj.search.search.draw_fitness", lambda *_: None)


@pytest.mark.parametrize("breaks_after", [0, 33])
@pytest.mark.parametrize(("method", "engine"), [("paper", "mujoco"), ("cmaes", "planar")])
def test_an_interruption_changes_nothing(monkeypatch, tmp_path, method, engine, breaks_after):
    """Batches repeat a generation that is known in part as a whole, in all replicates."""
    monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: True)
    settings = find_engine(engine).usual()
    search = replace(SEARCH, method=method, replicates=2)
    pretend(monkeypatch)
    run_search(search, tmp_path / "whole", Execution(settings, workers=1))

    out = tmp_path / "interrupted"
    pretend(monkeypatch, breaks_after)
    with pytest.raises(KeyboardInterrupt):
        run_search(search, out, Execution(settings, workers=2))
    jobs = pretend(monkeypatch)
    run_search(search, out, Execution(settings, workers=3))
    assert contents(out) == contents(tmp_path / "whole")
    n_kept = breaks_after if engine == "mujoco" else breaks_after // 20 * 20
    assert len(jobs) == 120 - n_kept


def test_the_table_is_written_after_each_generation(monkeypatch, tmp_path):
    pretend(monkeypatch, breaks_after=35)
    with pytest.raises(KeyboardInterrupt):
        run_search(SEARCH, tmp_path)
    assert len(read_table(tmp_path / TABLE)[0]) == 30
    assert not (tmp_path / BEST).exists()


def test_files_that_a_killed_search_left_half_written_are_removed(monkeypatch, tmp_path):
    for name in (f".123-{TABLE}", ".123-fitness.svg", ".123-mine"):
        (tmp_path / name).write_text("half")
    pretend(monkeypatch)
    run_search(SEARCH, tmp_path)
    hidden = {path.name for path in tmp_path.glob(".123-*")}
    assert hidden == {".123-mine"}


def test_a_finished_search_is_not_run_again_unless_it_is_asked_for(monkeypatch, tmp_path):
    pretend(monkeypatch)
    run_search(SEARCH, tmp_path)
    before = contents(tmp_path)
    jobs = pretend(monkeypatch)
    run_search(SEARCH, tmp_path)
    assert jobs == []
    assert contents(tmp_path) == before

    run_search(seeded(SEARCH, 4), tmp_path, again=True)
    assert len(jobs) == 60
    assert contents(tmp_path) != before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scenario": Scenario(seed=4)}, r"different settings \(seed: 3 there, 4 now\)"),
        ({"replicates": 3}, r"\(replicates: 1 there, 3 now\)"),
        ({"operators": Operators(span=0.1)}, r"\(operators\.span: 0\.05 there, 0\.1 now\)"),
    ],
)
def test_the_directory_of_another_search_is_refused(monkeypatch, tmp_path, change, message):
    pretend(monkeypatch)
    run_search(SEARCH, tmp_path)
    before = contents(tmp_path)
    jobs = pretend(monkeypatch)
    with pytest.raises(UserError, match=message):
        run_search(replace(SEARCH, **change), tmp_path)
    assert contents(tmp_path) == before
    assert jobs == []
