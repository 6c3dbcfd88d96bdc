"""A sweep that is started from the page is the command that it shows."""

import csv
import shlex
from dataclasses import replace

import numpy as np
import pytest
from support.page import Browser, opened, stop_threads, wait, work
from support.sessions import PAGE_SCENARIO

from iswarm_mj.player import sweeps
from iswarm_mj.player.sweeps import sweep_words, swept_settings


@pytest.fixture
def started(monkeypatch):
    """The command lines that were started, none of which runs."""
    commands = []

    class Process:
        returncode = None

        def __init__(self, words, **_):
            commands.append(words)

        def poll(self):
            return self.returncode

        def terminate(self):
            self.returncode = -15

        def wait(self, timeout):
            assert self.returncode is not None

    monkeypatch.setattr(sweeps.subprocess, "Popen", Process)
    return commands


def test_words_state_the_settings_of_the_run_and_the_values():
    scenario = replace(PAGE_SCENARIO.set("p_vector_forget", 0.75), robots=12)
    words = sweep_words(
        scenario, "p_vector_forget", np.array([0.0, 0.5, 1.0]), n_worlds=2, n_steps=9
    )
    text = shlex.join(words)
    assert text.startswith("sweep run --seed 3 --robots 12 --engine planar --arena.size 24.0")
    assert text.endswith("--worlds 2 --steps 9 --over p-vector-forget=0,0.5,1")
    assert "--p-vector-forget" not in text


def test_whole_numbers_stay_whole_and_differ():
    words = sweep_words(PAGE_SCENARIO, "robots", np.linspace(4, 6, 5), n_worlds=1, n_steps=3)
    assert words[-1] == "robots=4,5,6"
    assert "--robots" not in words


def test_large_whole_numbers_are_written_with_all_digits():
    words = sweep_words(PAGE_SCENARIO, "robots", np.array([1e6, 2e6]), n_worlds=1, n_steps=3)
    assert words[-1] == "robots=1000000,2000000"


def test_settings_that_are_no_numbers_cannot_be_swept():
    swept = swept_settings(PAGE_SCENARIO)
    assert {"robots", "p_vector_forget", "optics.baud_rate"} <= swept.keys()
    assert not {"seed", "task", "use_hop_count", "optics.mode"} & swept.keys()


def test_one_sweep_runs_at_a_time_and_can_be_stopped(still, started):
    page, browser = still
    browser.set("setting", "p vector forget")
    assert (browser.value("from"), browser.value("to")) == (0.0, 1.0)
    browser.set("values", 3)
    browser.press("Run the sweep")
    browser.press("Run the sweep")
    work(page)
    assert "a sweep is running; wait for it, or stop it" in browser.notifications
    (words,) = started
    assert words[1:6] == ["-P", "-m", "iswarm_mj", "sweep", "run"]
    assert words[-4:-1] == ["--over", "p-vector-forget=0,0.5,1", "--out"]
    assert "The sweep runs, since 0 s." in browser.text

    browser.press("Stop the sweep")
    work(page)
    assert "The sweep ended: it was stopped" in browser.text
    assert not browser.handle(browser.find("Stop the sweep")).visible


def test_an_empty_range_is_refused(still, started):
    page, browser = still
    browser.set("from", 2.0)
    browser.set("to", 1.0)
    browser.press("Run the sweep")
    work(page)
    assert "to must be above from, 2 (got 1.0)" in browser.notifications[-1]
    assert not started


def test_settings_have_the_names_and_the_units_of_the_page(still, started, recordings):
    page, browser = still
    label = next(
        label for label in browser.inputs[browser.find("setting")].choices if "µF" in label
    )
    browser.set("setting", label)
    browser.set("from", 1.0)
    browser.set("to", 2.0)
    browser.set("values", 2)
    browser.press("Run the sweep")
    work(page)
    (words,) = started
    assert words[-3].endswith("=1e-06,2e-06")
    assert (recordings / "sweep-1").is_dir()  # no other page takes it

    browser.press("Stop the sweep")
    work(page)
    assert [path.name for path in recordings.iterdir()] == ["sweep-1"]  # and no messages


@pytest.mark.slow
def test_a_sweep_gives_a_table_and_a_figure(tmp_path):
    with opened(replace(PAGE_SCENARIO, robots=6), port=8460, out=tmp_path) as page:
        stop_threads(page)
        browser = Browser(page)
        page.session.advance()
        browser.set("setting", "p vector forget")
        for name, value in {"values": 2, "worlds": 1, "steps": 3}.items():
            browser.set(name, value)
        browser.press("Run the sweep")

        def has_ended():
            work(page)
            return "Table and figure" in browser.text

        wait(has_ended)
        rows = [*csv.DictReader((tmp_path / "sweep-1" / "sweep.csv").open())]
        assert [float(row["p_vector_forget"]) for row in rows] == [0.0, 1.0]
        assert (tmp_path / "sweep-1" / "sweep.png").exists()
