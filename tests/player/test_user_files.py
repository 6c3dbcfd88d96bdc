"""Strategies and tasks of users' files are read again where they have changed."""

import os
import time

import pytest
from support.page import CONFIG, Browser, draw, opened, stop_threads, work

from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.player.user_files import UserCode
from iswarm_mj.simulation.scenario_flags import made_of
from iswarm_mj.strategy.library import STRATEGIES
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.utils.errors import UserError

WALK = """
from dataclasses import dataclass

from iswarm_mj.tasks.aggregation import Beeclust


@dataclass(frozen=True)
class Walk(Beeclust):
    longest_wait: float = {wait}
    turn: float = 1.0
"""
BROKEN = "\nclass Walk(\n"


@pytest.fixture
def file(tmp_path):
    """A user's file with a strategy."""
    file = tmp_path / "walk.py"
    file.write_text(WALK.format(wait=20.0))
    return file


def scenario_of(strategy):
    """Return a small scenario of a strategy that is named as --strategy names it."""
    return PageScenario(
        CONFIG,
        strategy=made_of(STRATEGIES, strategy),
        strategy_name=strategy,
        task=Aggregation(spot_radius=4.0, spot_offset=7.0),
        robots=8,
        engine=PlanarSettings(),
    )


@pytest.fixture
def session(file):
    """A session of that strategy, which has not begun to move."""
    return Session(scenario_of(f"{file}:Walk"))


def edit(file, text):
    """Write a file, with a time of change of its own as an editor would."""
    status = file.stat()
    file.write_text(text)
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns + 1_000_000_000))


def look(session):
    """Let a session look at its files, as it does twice a second."""
    session._looked_at = -1e9
    session.work()


def test_a_reset_reads_an_edited_file_and_keeps_what_was_changed_on_the_page(session, file):
    session.want("turn", 3.0)
    edit(file, WALK.format(wait=25.0))
    session.reset()
    assert session.now.get("longest_wait") == 25.0
    assert session.now.get("turn") == 3.0
    assert session.now is session.wanted


def test_an_error_of_the_file_is_shown_with_its_line_and_the_old_code_goes_on(session, file):
    edit(file, BROKEN)
    session.reset()
    sentence = session.messages.get_nowait()
    assert "SyntaxError" in sentence
    assert f"{file}, line 2" in sentence
    assert sentence.endswith("correct it there; the old code goes on")
    assert session.file_error == sentence
    assert session.version == 2
    assert session.now.get("longest_wait") == 20.0

    edit(file, WALK.format(wait=30.0))
    session.reset()
    assert not session.file_error
    assert session.messages.empty()
    assert session.now.get("longest_wait") == 30.0


def test_a_misspelt_method_is_named_with_the_one_that_is_meant(session, file):
    methods = ["init", "act", "pick"]
    text = "from iswarm_mj import Strategy\n\nclass Walk(Strategy):\n"
    edit(file, text + "".join(f"    def {method}(self):\n        pass\n" for method in methods))
    session.reset()
    sentence = session.messages.get_nowait()
    assert sentence.startswith("Walk has no method picks; rename pick, which it has, to picks")


def test_a_class_that_no_longer_fits_leaves_the_old_code(session, file):
    edit(
        file,
        WALK.format(wait="'long'") + "\n    def act(self, memory, seen, key):\n        1 / 0\n",
    )
    session.reset()
    assert "the old code goes on" in session.messages.get_nowait()
    assert session.now.get("longest_wait") == 20.0


def test_a_file_without_changes_keeps_the_very_object(session):
    strategy = session.now.strategy
    session.reset()
    assert session.now.strategy is strategy


def test_a_change_on_disk_is_stated_and_read_by_itself_if_wished(session, file):
    edit(file, WALK.format(wait=25.0))
    look(session)
    assert session.changed_files == ["walk.py"]
    assert session.version == 1

    session.reloads_by_itself = True
    look(session)
    assert session.version == 2
    assert not session.changed_files
    assert session.now.get("longest_wait") == 25.0

    edit(file, BROKEN)
    look(session)
    assert session.version == 2  # the run goes on
    assert session.file_error
    look(session)
    assert session.messages.qsize() == 1


def test_the_first_strategy_comes_back_with_its_present_code(session, file):
    edit(file, WALK.format(wait=25.0))
    session.reset()
    session.want("strategy", "beeclust")
    session.want("strategy", f"{file}:Walk")
    assert session.wanted.get("longest_wait") == 25.0


def test_an_edit_while_another_strategy_is_wanted_is_not_missed(session, file):
    session.want("strategy", "beeclust")
    look(session)
    edit(file, WALK.format(wait=25.0))
    session.want("strategy", f"{file}:Walk")
    look(session)
    session.reset()
    assert session.now.get("longest_wait") == 25.0


def test_a_file_that_was_away_is_read_once_it_is_back(session, file):
    session.advance()
    status = file.stat()
    file.unlink()
    look(session)
    assert session.changed_files == ["walk.py"]
    session.reset()
    assert "does not exist" in session.file_error
    file.write_text(WALK.format(wait=25.0))
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns + 1_000_000_000))
    look(session)
    session.reset()
    assert session.now.get("longest_wait") == 25.0
    assert not session.file_error


def test_an_edit_while_the_task_does_not_fit_is_read(session, file):
    session.advance()
    session.want("task", "cleaning")
    assert session.misfit
    edit(file, WALK.format(wait=25.0))
    session.reset()
    assert session.now.get("longest_wait") == 25.0
    assert session.wanted.get("longest_wait") == 25.0
    assert session.wanted.get("task") == "cleaning"
    assert session.misfit


def test_an_object_of_a_file_is_read_again_and_keeps_what_was_changed(tmp_path):
    file = tmp_path / "mine.py"
    text = "from iswarm_mj.tasks.aggregation import Beeclust\nmine = Beeclust(longest_wait={})\n"
    file.write_text(text.format(20.0))
    session = Session(scenario_of(f"{file}:mine"))
    session.want("leaving", 9.0)
    edit(file, text.format(33.0))
    session.reset()
    assert session.now.get("longest_wait") == 33.0
    assert session.now.get("leaving") == 9.0


def test_no_command_repeats_a_run_whose_file_has_changed(session, file):
    session.advance()
    assert "walk.py:Walk" in session.command()
    edit(file, BROKEN)
    for text in (session.command, session.toml):
        with pytest.raises(UserError, match=r"walk\.py changed after the run began"):
            text()
    session.reset()
    assert session.changed_files == ["walk.py"]  # its error leaves the old code
    with pytest.raises(UserError, match=r"walk\.py changed after the run began"):
        session.check_code()
    edit(file, WALK.format(wait=25.0))
    session.reset()
    assert "walk.py:Walk" in session.command()


def test_teams_keep_their_names_and_changed_values(file, tmp_path):
    second = tmp_path / "turn.py"
    second.write_text(WALK.format(wait=10.0).replace("Walk", "Turn"))
    scenario = scenario_of(f"{file}:Walk=0.5 {second}:Turn=0.5")
    before = UserCode().including(scenario)
    edit(second, WALK.format(wait=15.0).replace("Walk", "Turn"))
    walk, turn = before.read_again(scenario).renewed(scenario, before).strategy.teams
    assert (walk.name, walk.strategy.longest_wait) == ("Walk", 20.0)
    assert (turn.name, turn.strategy.longest_wait) == ("Turn", 15.0)


def test_nothing_can_be_reloaded_without_a_file():
    session = Session(PageScenario(CONFIG, robots=8, engine=PlanarSettings()))
    with pytest.raises(UserError, match="strategy and task are of no file"):
        session.reload()


def test_the_page_offers_to_reload_where_there_is_a_file(file):
    with opened(scenario_of(f"{file}:Walk"), port=8390) as page:
        stop_threads(page)
        browser = Browser(page)
        draw(page)
        assert browser.handle(browser.find("Reload code")).visible
        edit(file, BROKEN)
        page.session._looked_at = time.monotonic() - 10
        work(page)
        assert "**walk.py** changed on disk" in browser.text

        browser.press("Reload code")
        work(page)
        assert "SyntaxError" in browser.notifications[-1]
        assert "the old code goes on" in browser.text
