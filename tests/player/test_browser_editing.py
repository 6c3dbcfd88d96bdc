"""The page in Chromium: settings, files and toggles as a user changes them."""

import os
import re
import shutil
import time

import numpy as np
import pytest
from support.chromium import open_tab, pixel_of, started_chromium
from support.page import CONFIG, click_with, clients, drawn_lines, opened, wait

from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player.panel import BUILD
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.scenario_flags import made_of
from iswarm_mj.strategy.library import STRATEGIES
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.utils.units import RD

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("chromium") is None, reason="needs Chromium"),
]

WALK = """
from dataclasses import dataclass

from iswarm_mj.tasks.aggregation import Beeclust


@dataclass(frozen=True)
class {name}(Beeclust):
    longest_wait: float = {wait}
"""
DUST_AREA = (7.0 * RD, 0.0)
"""Place on a dust area of `CONFIG` [mm]."""


@pytest.fixture(scope="module")
def browser():
    """Chromium without a window on the screen."""
    with started_chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def played():
    """The page of a swarm that cleans."""
    with opened(Scenario(CONFIG, robots=20, engine=PlanarSettings(), seed=3), port=8410) as played:
        yield played


@pytest.fixture(scope="module")
def tab(browser, played):
    """A tab that shows this page, after its first control step."""
    return tab_after_a_step(browser, played)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A user's file with two strategies."""
    file = tmp_path_factory.mktemp("own") / "walk.py"
    write(file, wait=20.0)
    return file


@pytest.fixture(scope="module")
def own(file):
    """The page of two teams of that file."""
    names = [f"{file}:{name}=0.5" for name in ("Walk", "Turn")]
    scenario = Scenario(
        CONFIG,
        strategy=Teams(
            {name: (0.5, made_of(STRATEGIES, f"{file}:{name}")) for name in ("Walk", "Turn")}
        ),
        strategy_name=" ".join(names),
        task=Aggregation(spot_radius=4.0, spot_offset=7.0),
        robots=10,
        engine=PlanarSettings(),
    )
    with opened(scenario, port=8420) as own:
        yield own


@pytest.fixture(scope="module")
def own_tab(browser, own):
    """A tab that shows the page of teams, after its first control step."""
    return tab_after_a_step(browser, own)


def tab_after_a_step(browser, page):
    """Return a tab that shows a page, after its first control step."""
    tab = open_tab(browser, page.url)
    tab.get_by_text("Step", exact=True).click()
    wait(lambda: page.session.step == 1)
    return tab


def write(file, wait, text=""):
    """Write the user's file, with a time of change of its own as an editor would."""
    before = file.stat().st_mtime_ns if file.exists() else 0
    strategies = [WALK.format(name=name, wait=wait) for name in ("Walk", "Turn")]
    file.write_text("\n".join(strategies) + text)
    if before:
        os.utime(file, ns=(before + 10**9, before + 10**9))


def number_box(tab, label):
    """Return the box of a number by its label."""
    return tab.locator(f"xpath=//*[text()='{label}']/following::input[@inputmode][1]")


def test_a_number_applies_on_enter_or_when_its_box_is_left_and_not_at_each_key(tab, played):
    session = played.session
    values = []
    change = session.change
    session.change = lambda name, value: (values.append(value), change(name, value))
    tab.get_by_role("tab", name="Rules").click()
    box = number_box(tab, "p vector forget")
    box.click()
    box.press("Control+a")
    tab.keyboard.type("0.3", delay=150)
    time.sleep(1)
    assert not values
    assert session.now.genome.p_vector_forget == 0.29

    tab.keyboard.press("Enter")
    wait(lambda: session.now.genome.p_vector_forget == 0.3)
    box.press("Control+a")
    tab.keyboard.type("0.45", delay=100)
    tab.keyboard.press("Tab")
    wait(lambda: session.now.genome.p_vector_forget == 0.45)
    assert values == ["0.3", "0.45"]
    session.change = change


def test_a_reset_takes_the_good_change_and_the_bad_one_was_refused_where_it_was_entered(
    tab, played
):
    session = played.session
    tab.get_by_role("tab", name="World").click()
    for label, text in {"robots": "5000", "seed": "9"}.items():
        box = number_box(tab, label)
        box.click()
        box.press("Control+a")
        tab.keyboard.type(text)
        tab.keyboard.press("Enter")
    sentence = tab.get_by_text(re.compile(r"robots must be .*\(got 5000\)"))
    sentence.wait_for()
    assert sentence.bounding_box()["y"] - number_box(tab, "robots").bounding_box()["y"] < 60
    wait(lambda: number_box(tab, "robots").input_value() == "20")

    click_with(played, BUILD, *DUST_AREA)
    tab.get_by_text("Not possible").wait_for()
    click_with(played, BUILD, 0.0, -8.0 * RD)
    tab.get_by_text("obstacles 0 → 1").wait_for()
    tab.get_by_text("Reset", exact=True).first.click()
    wait(lambda: session.step == 0)
    assert session.now.seed == 9
    assert len(session.now.config.arena.obstacles) == 1
    assert session.now.n_robots == 20


def test_a_compilation_is_stated_while_it_lasts(tab, played):
    """Another number of robots means another program."""
    session = played.session
    session.post(lambda: session.want("robots", 23))
    wait(lambda: session.wanted.n_robots == 23)
    tab.get_by_text("Reset", exact=True).first.click()
    tab.get_by_text("Step", exact=True).click()
    tab.get_by_text(re.compile("Preparing.* compiling .* so far")).wait_for()
    wait(lambda: session.step == 1)
    tab.get_by_text(re.compile("Preparing")).wait_for(state="detached")


def test_what_is_drawn_is_ticked(tab, played):
    tab.get_by_role("tab", name="Watch").click()
    links = tab.get_by_role("checkbox", name="links")
    trails = tab.get_by_role("checkbox", name="trails")
    assert links.is_checked()
    assert not trails.is_checked()
    trails.click()
    links.click()
    wait(lambda: drawn_lines(played) == {"trails"})
    assert trails.is_checked()
    assert not links.is_checked()
    tab.get_by_text("trail", exact=True).wait_for()


def test_each_team_has_its_rules(own_tab, own):
    session = own.session
    own_tab.get_by_text("aggregation, Walk 50 % and Turn 50 %").wait_for()
    own_tab.get_by_role("tab", name="Rules").click()
    own_tab.get_by_text("Rules of team Turn", exact=True).wait_for()
    box = own_tab.locator(
        "xpath=//*[text()='Rules of team Turn']/following::*[text()='longest wait']"
        "/following::input[@inputmode][1]"
    )
    box.click()
    box.press("Control+a")
    own_tab.keyboard.type("35")
    own_tab.keyboard.press("Enter")
    wait(lambda: session.now.get("Turn.longest_wait") == 35.0)
    assert session.now.get("Walk.longest_wait") == 20.0
    assert [str(change) for change in session.changes] == ["1:Turn.longest_wait=35.0"]


def test_a_file_is_edited_broken_and_mended(own_tab, own, file):
    session = own.session
    write(file, wait=25.0)
    own_tab.get_by_text("walk.py changed on disk").wait_for()
    own_tab.get_by_role("button", name="Reload code").click()
    wait(lambda: session.step == 0 and session.now.get("Walk.longest_wait") == 25.0)
    assert session.now.get("Turn.longest_wait") == 35.0  # which was changed on the page

    write(file, wait=30.0, text="\nclass Broken(\n")
    own_tab.get_by_text("Reset", exact=True).first.click()
    toast = own_tab.get_by_role("alert").filter(has_text="the old code goes on")
    toast.wait_for()
    text = toast.inner_text()
    assert "SyntaxError" in text
    assert re.search(r"walk.py, line \d+", text)
    assert "correct it there" in text
    assert session.now.get("Walk.longest_wait") == 25.0

    own_tab.get_by_role("checkbox", name="reload by itself").click()
    wait(lambda: session.reloads_by_itself)
    write(file, wait=40.0)
    wait(lambda: session.now.get("Walk.longest_wait") == 40.0)
    assert not session.file_error


def test_a_dragged_robot_stands_where_the_drag_ends(tab, played):
    session = played.session
    camera = clients(played)[0].camera
    poses = session.snapshots[-1].frames.pose[0] * 1e3
    robot = int(np.linalg.norm(poses[:, :2] - [0, 20], axis=-1).argmin())
    free = next(
        np.array(place)
        for place in ((12.0, 12.0), (-12.0, 12.0), (12.0, 20.0), (-12.0, 20.0))
        if np.linalg.norm(poses[:, :2] - place, axis=-1).min() > 5
    )
    start = pixel_of(camera, np.array([*poses[robot, :2], 0.5]))
    end = pixel_of(camera, np.array([*free, 0.5]))
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*np.add(start, end) / 2, steps=8)
    tab.mouse.move(*end, steps=8)
    time.sleep(0.5)
    tab.mouse.up()
    wait(lambda: session.changes and session.changes[-1].name == "move")
    place = session.snapshots[-1].frames.pose[0, robot, :2] * 1e3
    np.testing.assert_allclose(place, free, atol=0.5)
