"""The panel shows what the session has, and lets it do what the panel offers."""

import warnings
from dataclasses import replace

import numpy as np
from support.page import (
    SCENARIO,
    Browser,
    draw,
    opened,
    selected_robot,
    send_ray,
    stop_threads,
    wait,
    work,
)
from support.rrd import read

from iswarm_mj.player.panel import BUILD, DROP, LIFE, REMOVE
from iswarm_mj.player.view import SwarmView
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.aggregation import Beeclust
from iswarm_mj.utils.errors import UserError

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
    browser.set("strategy", "beeclust")
    work(page)
    names = {(control.is_live, control.name) for control in browser.inputs.values()}
    assert (True, "p_vector_forget") in names
    assert (False, "longest_wait") in names
    assert browser.find("p vector forget") == forget  # its folder is left alone
    assert "**Reset** applies: strategy." in browser.text

    browser.set("p vector forget", 0.875)
    browser.set("longest wait", 25.0)
    work(page)
    assert page.session.now.genome.p_vector_forget == 0.875
    assert page.session.wanted.strategy == Beeclust(longest_wait=25.0)
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
    assert "release gap [µm] must be a number, between 1 and 20 µm" in browser.notifications[-1]


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


# Errors.


def test_actions_that_fail_are_shown(still, monkeypatch, capfd):
    page, browser = still
    monkeypatch.setattr(SwarmView, "toggle", None)
    browser.set("draw", "trails")
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
    assert "**Reset** applies: robots, obstacles." in browser.text
    assert session.wanted.n_robots == 8
    assert session.wanted.config.arena.obstacles == ((7.07, -7.07, 1.0, 1.0, 0.0),)
