"""The panel shows what the session has, and lets it do what the panel offers."""

import time
import warnings
from dataclasses import replace

import numpy as np
import pytest
from support.page import (
    SCENARIO,
    Browser,
    draw,
    drawn_place,
    opened,
    selected_robot,
    send_drag,
    send_ray,
    stop_threads,
    wait,
    work,
)
from support.rrd import read
from support.sessions import PAGE_SCENARIO, begun

from iswarm_mj.player.panel import BUILD, DROP, LIFE, REMOVE
from iswarm_mj.player.session import Activity
from iswarm_mj.player.view import SwarmView
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.tasks.foraging import Forager
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

TEAMS = Teams({"type1": (0.5, PRESETS["type1"]), "type2": (0.5, PRESETS["type2"])})


def place_of(session, robot):
    """Return where a robot is [mm]."""
    return session.snapshots[-1].frames.pose[0, robot, :2] * 1e3


# Settings.


def test_the_strategy_of_the_start_can_be_chosen_again():
    """The very object comes back with its values, also if its file is gone or never was."""
    scenario = replace(SCENARIO, robots=10, strategy=TEAMS)
    with opened(scenario, port=8350) as page:
        stop_threads(page)
        browser = Browser(page)
        session = page.session
        session.advance()
        name = browser.value("strategy")

        browser.set("strategy", "type2")
        work(page)
        session.reset()
        session.advance()
        work(page)
        browser.set("strategy", name)
        work(page)
        assert session.start.genome == PRESETS["type2"]
        assert session.wanted.strategy is TEAMS


def test_inputs_of_a_strategy_that_waits_stand_beside_those_of_what_runs(still):
    """Rules of what runs change it, while those of the other strategy wait."""
    page, browser = still
    forget = browser.find("p vector forget")
    browser.set("strategy", "forager")
    work(page)
    names = {(control.is_live, control.name) for control in browser.inputs.values()}
    assert (True, "p_vector_forget") in names
    assert (False, "random_turn") in names
    assert browser.find("p vector forget") == forget  # its folder is left alone
    assert "**Reset** applies: strategy type1 → forager." in browser.text

    browser.set("p vector forget", 0.875)
    browser.set("random_turn", 30.0)
    work(page)
    assert page.session.now.genome.p_vector_forget == 0.875
    assert page.session.wanted.strategy == Forager(random_turn=30.0)
    assert not browser.notifications


def test_another_strategy_brings_its_values(still):
    page, browser = still
    browser.set("strategy", "type2")
    work(page)
    assert browser.value("density of robots") == PRESETS["type2"].density_of_robots


def test_a_slider_that_is_moved_does_not_jump_back(still):
    page, browser = still
    browser.set("density of robots", 0.125)
    browser.set("p vector forget", 0.5)
    page.session.work()
    browser.set("p vector forget", 0.625)  # which the session takes later
    draw(page)
    assert browser.value("p vector forget") == 0.625
    assert browser.value("density of robots") == 0.125
    work(page)
    assert page.session.now.genome.p_vector_forget == 0.625


def test_inputs_take_and_show_values_in_the_units_of_the_page(still):
    page, browser = still
    browser.set("gripper.work_tool_object", 3.3)
    work(page)
    assert page.session.wanted.config.gripper.work_tool_object == 0.0033
    assert browser.value("gripper.work_tool_object") == 3.3

    browser.set("gripper.release_gap", 30.0)
    work(page)
    note = browser.note("gripper.release_gap")
    assert "release gap [µm] must be a number, between 1 and 20 µm" in note

    browser.set("gripper.release_gap", 19.0)
    work(page)
    assert not browser.note("gripper.release_gap")
    assert browser.value("gripper.release_gap") == 19.0


def test_inputs_that_are_removed_are_removed_once(still):
    """viser would warn of another removal."""
    page, browser = still
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("forager", "type1", "neural"):
            browser.set("strategy", name)
            work(page)
            page.session.reset()
            work(page)
    assert set(browser.inputs) == browser.shown_inputs


# Changes that wait.


def test_what_cannot_be_is_refused_where_it_is_entered_and_other_changes_wait(still):
    """The sentence stands beneath the input, which shows its old value again."""
    page, browser = still
    session = page.session
    browser.set("seed", 9)
    browser.set("robots", 5000)
    work(page)
    assert "robots must be" in browser.note("robots")
    assert "5000" in browser.note("robots")
    assert browser.value("robots") == 10
    assert "**Reset** applies: seed" in browser.text

    browser.set("a click can", BUILD)
    browser.click(7.0 * RD, 0.0)  # on a dust area
    browser.click(20.0, -20.0)
    work(page)
    assert "obstacle" in browser.notifications[-1]
    browser.set("run", "Reset")
    work(page)
    assert session.now.seed == 9
    assert len(session.now.config.arena.obstacles) == 1
    assert session.step == 0


def test_a_strategy_that_does_not_fit_waits_and_the_rest_is_reset(still):
    """Its own settings can be changed only once it is chosen, so it is no mistake to choose it."""
    page, browser = still
    session = page.session
    browser.set("seed", 9)
    work(page)
    browser.set("strategy", "beeclust")
    work(page)
    work(page)
    assert "Beeclust follows the light of the task" in browser.note("strategy")
    assert browser.value("strategy") == "beeclust"
    assert not browser.notifications

    browser.set("run", "Reset")
    work(page)
    assert session.step == 0
    assert session.now.seed == 9
    assert session.now.get("strategy") == "type1"
    assert session.wanted.get("strategy") == "beeclust"
    assert "The **strategy** goes on waiting, as it does not fit yet" in browser.text

    session.advance()
    browser.set("strategy", "type1")
    work(page)
    work(page)
    assert session.misfit is None
    assert not browser.note("strategy")


def test_settings_of_a_task_that_does_not_fit_make_it_fit():
    session = begun()
    session.want("task", "aggregation")
    assert session.misfit.name == "task"
    assert "spot_offset must be at most 3 rd" in session.misfit.sentence
    session.want("spot_offset", 5.0)
    session.set("p_vector_forget", 0.75)
    session.want("spot_radius", 4.0)
    assert session.misfit is None
    session.reset()
    assert session.now.task == Aggregation(spot_radius=4.0, spot_offset=5.0)
    assert session.now.genome.p_vector_forget == 0.75


def test_a_reset_that_fails_keeps_what_waits(still, monkeypatch):
    page, browser = still
    session = page.session
    browser.set("seed", 9)
    work(page)

    def refuse(_):
        raise UserError("no memory is left")

    with monkeypatch.context() as patch:
        patch.setattr(type(session.wanted), "run", refuse)
        browser.set("run", "Reset")
        work(page)
    assert browser.notifications == ["no memory is left"]
    assert session.step == 1
    assert session.wanted.seed == 9

    browser.set("run", "Reset")
    work(page)
    assert session.now.seed == 9


def test_the_page_says_what_is_prepared_and_since_when(still):
    page, browser = still
    session = page.session
    began = time.monotonic() - 12
    session.activity = Activity("the next step: compiling forager on foraging", began)
    draw(page)
    assert "**Preparing** the next step: compiling forager on foraging, 12 s so far" in browser.text

    session.activity = None
    draw(page)
    assert "Preparing" not in browser.text


def test_a_session_states_what_it_compiles(monkeypatch):
    session = begun()
    stated = []
    session.want("robots", 12)
    session.reset()
    monkeypatch.setattr(session.run, "advance", lambda: stated.append(session.activity) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        session.advance()
    assert stated[0].text == (
        "the next step: compiling type1 on cleaning for 12 robots with the engine planar"
    )
    assert session.activity is None


# Errors.


def test_actions_that_fail_are_shown(still, monkeypatch, capfd):
    page, browser = still
    monkeypatch.setattr(SwarmView, "draw", None)
    browser.set("trails", True)
    work(page)
    assert "TypeError" in browser.notifications[-1]
    assert capfd.readouterr().err.count("Traceback") == 1


def test_a_file_that_cannot_be_made_is_answered(still, monkeypatch):
    page, browser = still
    browser.press("Save as TOML")
    assert b"iswarm run --config FILE" in browser.files[-1]

    def refuse():
        raise UserError("no key can state the teams")

    monkeypatch.setattr(page.session, "toml", refuse)
    browser.press("Save as TOML")
    work(page)
    assert browser.notifications == ["no key can state the teams"]
    assert len(browser.files) == 1


def test_the_page_says_why_no_command_repeats_the_run(still, monkeypatch):
    page, browser = still
    draw(page)
    assert "This command repeats the run so far" in browser.text
    assert "iswarm run" in browser.text

    def refuse():
        raise UserError("no flag can state the teams")

    monkeypatch.setattr(page.session, "command", refuse)
    draw(page)
    assert "no flag can state the teams" in browser.text
    assert "iswarm run" not in browser.text


# Recordings.


def test_a_recording_that_cannot_begin_is_not_ticked(still, recordings):
    page, browser = still
    recordings.parent.touch()  # a file where a directory is to be
    browser.set("record for Rerun", True)
    work(page)
    assert "NotADirectoryError" in browser.notifications[-1]
    assert browser.value("record for Rerun") is False


def test_fast_ticks_of_the_recording_leave_no_file_behind(still, recordings):
    page, browser = still
    for _ in range(20):
        browser.set("record for Rerun", True)
        browser.set("record for Rerun", False)
    work(page)
    assert not page.session.is_recording
    assert not recordings.exists()


def test_the_tick_shows_that_a_reset_has_completed_the_recording(still, recordings):
    page, browser = still
    browser.set("record for Rerun", True)
    work(page)
    assert browser.value("record for Rerun") is True
    assert "Recording to" in browser.text

    browser.set("run", "Reset")
    work(page)
    assert browser.value("record for Rerun") is False
    assert "Recorded" in browser.text
    assert read(recordings / "play-1.rrd")["/world/robots/body"]["step"] == [1]


# Clicks on the arena.


def test_a_click_on_a_robot_selects_it_and_shows_what_it_knows(page, browser):
    page.session.advance()
    x, y = place_of(page.session, 5)
    slanted = np.array([0.1, 0.6, -0.8])
    half_height = np.array([x + 0.1, y, 0.5])
    send_ray(page, origin=half_height - 90 * slanted, direction=2 * slanted)
    assert selected_robot(page) == 5
    wait(lambda: "**Robot 5**" in browser.text)
    assert "| remembers |" in browser.text
    assert "20 robots · cleaning, type1" in browser.text


def test_clicks_kill_a_robot_and_drop_a_ball_at_once(still):
    page, browser = still
    session = page.session
    browser.set("a click can", LIFE)
    browser.click(*place_of(session, 5))
    browser.set("a click can", DROP)
    browser.click(0.0, 20.0)
    work(page)
    assert [change.name for change in session.changes] == ["kill", "ball"]
    assert not session.is_alive[5]


def test_clicks_that_wait_for_a_reset(still):
    page, browser = still
    session = page.session
    browser.set("a click can", REMOVE)
    for _ in range(2):
        browser.click(*place_of(session, 5))
    browser.set("a click can", BUILD)
    browser.click(20.0, -20.0)
    browser.click(-20.0, -20.0)
    browser.click(-20.5, -19.5)  # takes the second one away
    work(page)
    assert session.run.settings.n_robots == 10
    assert "**Reset** applies: robots 10 → 8; obstacles 0 → 1." in browser.text
    assert session.wanted.n_robots == 8
    assert session.wanted.config.arena.obstacles == ((7.07, -7.07, 1.0, 1.0, 0.0),)


def drag(page, robot, x, y, phase="end"):
    """Drag a robot to a place [mm], seen from above with a slant."""
    camera = np.array([0.0, -60.0, 90.0])
    half_height = page.session.scene.height * 500
    pointer = camera + 0.5 * (np.array([x, y, half_height]) - camera)
    send_drag(page, robot, camera, pointer, phase)


def test_a_robot_that_is_dragged_stands_where_the_drag_ends(still):
    page, browser = still
    session = page.session
    drag(page, 5, 18.0, -18.0, phase="start")
    drag(page, 5, 18.0, -18.0, phase="update")
    assert not session.inbox
    drag(page, 5, 18.0, -18.0)
    work(page)
    np.testing.assert_allclose(place_of(session, 5), [18.0, -18.0], atol=0.01)
    (change,) = session.changes
    assert (change.step, change.name) == (1, "move")

    drag(page, 5, 900.0, 0.0, phase="start")
    drag(page, 5, 900.0, 0.0)  # beyond the walls
    work(page)
    assert (
        "place of robot 5 must be such that robots stand within the walls"
        in (browser.notifications[-1])
    )
    assert len(session.changes) == 1


def test_a_drag_that_outlives_its_run_or_its_browser_has_no_effect(still):
    page, browser = still
    drag(page, 5, 18.0, -18.0, phase="start")
    page.session.reset()
    drag(page, 5, 18.0, -18.0)
    assert not page.session.inbox

    drag(page, 5, 18.0, -18.0, phase="start")
    browser.close()
    drag(page, 5, 18.0, -18.0)
    assert not page.session.inbox


def test_cameras_follow_the_selected_robot(still):
    page, browser = still
    session = page.session
    browser.click(*place_of(session, 5))
    browser.set("follow the selected robot", True)
    draw(page)
    start = np.array(browser.camera.position)
    np.testing.assert_allclose(start[:2], drawn_place(page, 5), atol=1e-3)

    x, y = drawn_place(page, 5)
    session.change("move", "5,6.0,6.0")
    draw(page, elapsed=10.0)
    moved = np.array(browser.camera.position) - start
    np.testing.assert_allclose(moved, [6.0 * RD - x, 6.0 * RD - y, 0.0], atol=1e-3)

    browser.set("follow the selected robot", False)
    session.change("move", "5,-6.0,6.0")
    draw(page)
    np.testing.assert_allclose(np.array(browser.camera.position) - start, moved)


def test_a_share_of_the_robots_fails_at_a_click(still):
    page, browser = still
    browser.set("share that fails", 0.3)
    browser.press("Let them fail now")
    work(page)
    assert page.session.is_alive.sum() == 7
    assert [str(change) for change in page.session.changes] == ["1:fail=0.3"]
    assert "dead" in browser.text


def test_each_team_has_its_rules_and_its_share():
    scenario = replace(SCENARIO, robots=10, strategy=TEAMS)
    with opened(scenario, port=8395) as page:
        stop_threads(page)
        browser = Browser(page)
        page.session.advance()
        work(page)
        assert "cleaning, type1 50 % and type2 50 %" in browser.text
        browser.set("type2.p_vector_forget", 0.75)
        work(page)
        now = page.session.now
        assert now.get("type2.p_vector_forget") == 0.75
        assert now.get("type1.p_vector_forget") == PRESETS["type1"].p_vector_forget
        assert [str(change) for change in page.session.changes] == ["1:type2.p_vector_forget=0.75"]
        page.session.advance()


def test_fewer_robots_are_explained_by_their_density():
    """An obstacle takes floor, and robots by default stand on a share of it."""
    session = begun(replace(PAGE_SCENARIO, robots=None))
    obstacle = (8.0, -8.0, 2.0, 2.0, 0.0)
    session.want("arena.obstacles", (obstacle,))
    text = session.pending["robots"]
    assert text.endswith("as robots stand on 11.8 % of the free floor")
    assert session.pending["obstacles"] == "0 → 1"
