"""What browsers send to the inputs of a page: legal values reach the session, and others change
nothing."""

import random
import warnings
from contextlib import contextmanager
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from support.page import Browser, wait, wait_for
from support.rrd import read

from iswarm_mj import SwarmConfig, play
from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player.controls import Control
from iswarm_mj.player.inbox import MOST_CLICKS
from iswarm_mj.player.panel import DROP
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.tasks.foraging import Foraging
from iswarm_mj.utils.errors import ConfigError, UserError

CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))
TEAMS = Teams({"type1": (0.5, PRESETS["type1"]), "type2": (0.5, PRESETS["type2"])})
SCENARIOS = {
    "cleaning": {"engine": PlanarSettings()},
    "teams": {"engine": PlanarSettings(), "strategy": TEAMS},
    "foraging": {"engine": PlanarSettings(), "task": Foraging()},
    "aggregation": {
        "engine": MujocoSettings(),
        "task": Aggregation(spot_radius=4.0, spot_offset=7.0),
        "strategy": Beeclust(),
    },
}


@contextmanager
def shown(threads=True, **scenario):
    """A page and a browser that shows it; without threads a test does their work."""
    page = play(Scenario(CONFIG, robots=10, seed=3, **scenario), port=8330)
    if not threads:
        page._stop.set()
        for thread in page._threads:
            thread.join()
    browser = Browser(page)
    try:
        yield page, browser
    finally:
        browser.close()
        page.close()


@pytest.fixture
def still():
    """A page whose session has taken a step; tests do the work of its threads."""
    with shown(threads=False, engine=PlanarSettings()) as (page, browser):
        page.session.advance()
        yield page, browser


def work(page):
    """Do what is due, and draw."""
    page.session.work()
    page._panel_at = -np.inf
    page._draw(0.0, 0.04)


def ray_onto(x, y):
    """Return a click on the arena from above, at a place [mm]."""
    return SimpleNamespace(ray_origin=(x, y, 90.0), ray_direction=(0.0, 0.0, -1.0))


FLOAT = Control("width", "", 0.5, low=0.0, high=2.0, unit="rd")
WHOLE = Control("count", "", 3, low=1, high=9)
FREE = Control("free", "", 1.0)
SWITCH = Control("switch", "", True)
WORD = Control("word", "", "red", choices=("red", "blue"))


@pytest.mark.parametrize(
    ("control", "value", "expected"),
    [
        (FLOAT, 1, 1.0),
        (FLOAT, 0.25, 0.25),
        (WHOLE, 4.0, 4),
        (FREE, -1e300, -1e300),
        (SWITCH, False, False),
        (WORD, "blue", "blue"),
    ],
)
def test_values_that_a_control_takes(control, value, expected):
    found = control.check(value)
    assert found == expected and type(found) is type(control.value)


@pytest.mark.parametrize(
    ("control", "value"),
    [
        (FLOAT, value)
        for value in (-0.1, 2.1, float("nan"), float("inf"), 10**400, "1", None, True, [1.0], {})
    ]
    + [(WHOLE, value) for value in (0, 10, 4.5, float("nan"), -(10**400), "4", True, b"4")]
    + [(FREE, value) for value in (float("nan"), float("-inf"), 10**400, "1")]
    + [(SWITCH, value) for value in (1, 0, "true", None)]
    + [(WORD, value) for value in ("green", "", 1, None, ["red"], "/tmp/red.py:X")],
)
def test_values_that_a_control_refuses(control, value):
    with pytest.raises(ConfigError, match=f"{control.name} must be"):
        control.check(value)


def test_a_refused_value_is_answered_and_the_input_keeps_the_old_one(still):
    page, browser = still
    session = page.session
    before = (session.wanted, session.now)
    for label, value in (
        ("p vector forget", 5.0),
        ("robots", 0),
        ("strategy", "red"),
        ("engine", "warp"),
        ("colour by", "red"),
    ):
        old = browser.value(label)
        browser.set(label, value)
        work(page)
        assert browser.value(label) == old
        assert (
            f"{label} must be" in browser.notifications[-1]
            and f"{value}" in browser.notifications[-1]
        )
    assert (session.wanted, session.now) == before and page._error is None


def test_messages_change_values_of_inputs_alone(still):
    page, browser = still
    uuid = browser.find("p vector forget")
    state = browser.handle(uuid)._impl
    for name in (
        "removed",
        "update_cb",
        "sync_cb",
        "props",
        "is_button",
        "gui_api",
        "uuid",
        "nothing",
    ):
        before = dict(vars(state))
        browser.send(uuid, {name: 7})
        browser.send(uuid, {"value": 0.5, name: 7})
        assert vars(state) == before
    browser.send("no input", {"value": 1.0})
    browser.send(uuid, {"value": 0.75})
    work(page)
    assert page.session.now.genome.p_vector_forget == 0.75


def test_no_file_is_imported_because_a_message_names_it(still, tmp_path):
    page, browser = still
    mark, file = tmp_path / "mark", tmp_path / "evil.py"
    file.write_text(f"open({str(mark)!r}, 'w').close()\nclass X:\n    pass\n")
    for label in ("strategy", "task", "engine"):
        browser.set(label, f"{file}:X")
        work(page)
        assert not mark.exists() and f"{label} must be" in browser.notifications[-1]


def test_the_strategy_of_the_start_can_be_chosen_again():
    """The very object, with its values, also if its file is gone or never was."""
    with shown(threads=False, engine=PlanarSettings(), strategy=TEAMS) as (page, browser):
        page.session.advance()
        name = browser.value("strategy")
        browser.set("strategy", "type2")
        work(page)
        page.session.reset()
        page.session.advance()
        work(page)
        browser.set("strategy", name)
        work(page)
        assert (
            page.session.wanted.strategy is TEAMS and page.session.start.genome == PRESETS["type2"]
        )


def test_actions_that_fail_are_shown(still, capfd):
    page, browser = still
    page._panel.view.toggle = None
    browser.set("draw", "trails")
    work(page)
    assert "TypeError" in browser.notifications[-1]
    assert capfd.readouterr().err.count("Traceback") == 1


def test_a_recording_that_cannot_begin_is_not_ticked(still, tmp_path):
    page, browser = still
    (tmp_path / "file").touch()
    page.session._out = tmp_path / "file" / "folder"
    browser.set("record for Rerun", True)
    work(page)
    assert "NotADirectoryError" in browser.notifications[-1]
    assert browser.value("record for Rerun") is False


def test_a_file_that_cannot_be_made_is_answered(still, monkeypatch):
    page, browser = still
    browser.set("Save as TOML", True)
    assert b"iswarm run --config FILE" in browser.files[-1]

    def refuse():
        raise UserError("no key can state the teams")

    monkeypatch.setattr(page.session, "toml", refuse)
    browser.set("Save as TOML", True)
    work(page)
    assert browser.notifications == ["no key can state the teams"] and len(browser.files) == 1


def test_inputs_of_a_strategy_that_waits_stand_beside_those_of_what_runs(still):
    """Each is of one of both: the rules of what runs change it, and the others wait."""
    page, browser = still
    session, panel = page.session, page._panel
    forget = browser.find("p vector forget")
    browser.set("strategy", "beeclust")
    work(page)
    names = {(control.is_live, control.name) for control in browser.inputs.values()}
    assert (True, "p_vector_forget") in names and (False, "longest_wait") in names
    assert browser.find("p vector forget") == forget  # its folder is left alone
    assert "**Reset** applies: strategy." in panel._status.content
    browser.set("p vector forget", 0.875)
    browser.set("longest wait", 25.0)
    work(page)
    assert session.now.genome.p_vector_forget == 0.875
    assert session.wanted.strategy == Beeclust(longest_wait=25.0)
    assert not browser.notifications


def test_another_strategy_brings_its_values_and_a_moved_slider_stays(still):
    page, browser = still
    browser.set("strategy", "type2")
    work(page)
    assert browser.value("density of robots") == PRESETS["type2"].density_of_robots
    browser.set("density of robots", 0.125)
    page._panel_at = -np.inf
    browser.set("p vector forget", 0.5)
    page.session.work()
    browser.set("p vector forget", 0.625)  # which the session takes later
    page._draw(0.0, 0.04)
    assert browser.value("p vector forget") == 0.625 and browser.value("density of robots") == 0.125
    work(page)
    assert page.session.now.genome.p_vector_forget == 0.625


def test_a_rebuild_removes_each_input_once(still):
    page, browser = still
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("forager", "type1", "neural"):
            browser.set("strategy", name)
            work(page)
            page.session.reset()
            work(page)
    alive = page._server.gui._gui_input_handle_from_uuid
    assert set(browser.inputs) == set(alive)


def test_an_action_gets_the_value_that_was_checked(still):
    """JavaScript sends 30 for 30.0, and perhaps 7.0 for 7."""
    page, browser = still
    values = []
    panel = page._panel
    panel._inputs.add(Control("width", "", 0.5, low=0.0, high=60.0), values.append)
    panel._inputs.add(Control("count", "", 3, low=1, high=9), values.append)
    browser.set("width", 30)
    browser.set("count", 7.0)
    browser.set("count", 7)  # which it has
    browser.set("count", 10)
    assert values == [30.0, 7]
    assert [type(value) for value in values] == [float, int]


def test_a_value_is_taken_though_its_browser_has_left(still):
    """Otherwise the page would show a value that the session does not have."""
    page, browser = still
    identifier = browser.find("p vector forget")
    browser.close()
    browser.send(identifier, {"value": 0.75})
    page._server._connected_clients[0] = browser
    work(page)
    assert page.session.now.genome.p_vector_forget == 0.75


def test_browsers_see_an_input_once_its_values_are_taken(still, monkeypatch):
    page, _ = still
    inputs, buffer = page._panel._inputs, page._server._websock_server.get_message_buffer()
    held_back = []
    register = inputs._register

    def note_and_register(*arguments):
        held_back.append(buffer.atomic_counter > 0)
        register(*arguments)

    monkeypatch.setattr(inputs, "_register", note_and_register)
    inputs.add(WORD)
    inputs.add_button("button", print)
    inputs.add_buttons(WORD, print)
    assert held_back == [True, True, True] and buffer.atomic_counter == 0


def test_a_flood_of_values_and_clicks_leaves_little_to_do(still):
    page, browser = still
    for k in range(2000):
        browser.set("p vector forget", k % 2 / 4)
        browser.set("seed", 5 + k % 2)
    assert len(page.session.inbox) == 2
    for _ in range(200):
        browser.set("Play", True)
        page._panel.click = DROP
        page._clicked(ray_onto(5.0, 5.0))
    assert len(page.session.inbox) == 2 + MOST_CLICKS
    page._draw(0.0, 0.04)
    assert browser.notifications == [
        "30 clicks wait already, as something takes long; click again when the page has done them"
    ]
    work(page)
    assert not page.session.inbox and page.session.wanted.seed == 6


def test_fast_ticks_of_the_recording_leave_no_file_behind(still, tmp_path):
    page, browser = still
    page.session._out = tmp_path / "recordings"
    for _ in range(20):
        browser.set("record for Rerun", True)
        browser.set("record for Rerun", False)
    work(page)
    assert not page.session.is_recording and not page.session._out.exists()


def test_the_tick_shows_that_a_reset_has_completed_the_recording(still, tmp_path):
    page, browser = still
    page.session._out = tmp_path
    browser.set("record for Rerun", True)
    work(page)
    assert browser.value("record for Rerun") is True
    assert "Recording to" in page._panel._recording.content
    browser.set("run", "Reset")
    work(page)
    assert browser.value("record for Rerun") is False
    assert "Recorded" in page._panel._recording.content
    assert read(tmp_path / "play-1.rrd")["/world/robots/body"]["step"] == [1]


AFFORDABLE = {
    "robots": (6, 9),
    "arena.size": (20.0, 28.0),
    "density_of_robots": (0.005, 0.03),
}
"""Ranges of the settings that together make the number of robots and balls: a large arena at a high
density has thousands of robots, whose arena MuJoCo compiles for minutes."""


def legal(control, rng):
    """Return a value that a control takes, of a size that tests can afford."""
    if control.name in AFFORDABLE:
        low, high = AFFORDABLE[control.name]
        return rng.randint(low, high) if isinstance(low, int) else rng.uniform(low, high)
    if control.choices:
        return rng.choice([choice for choice in control.choices if choice != "mjx"])
    if isinstance(control.value, bool):
        return rng.random() < 0.5
    low, high = max(control.low, -1e3), min(control.high, 1e3)
    near = control.value + rng.choice((-1, 1)) * rng.random() * 0.2 * (abs(control.value) or 1)
    value = rng.choice((low, high, near, rng.uniform(low, high)))
    if isinstance(control.value, int):  # of substeps or balls; thousands of them would take minutes
        value = round(min(max(value, control.value // 2), 2 * control.value + 1))
    return min(max(value, control.low), control.high)


def hostile(control, rng, file):
    """A value that a control may refuse."""
    odd = [
        None,
        float("nan"),
        float("inf"),
        -5,
        1e308,
        10**30,
        -(10**400),
        "",
        "x" * 100_000,
        f"{file}:X",
    ]
    odd += [
        "'",
        '"',
        "\ud800",
        "\x00",
        [],
        [1, 2],
        {"a": 1},
        b"\xff",
        True,
        False,
        0.5,
        "type2",
        "1",
        "nan",
    ]
    return rng.choice(odd)


def settle(page, scenario):
    """Begin the first run again, whatever was done; it takes a step, which the page shows."""
    session, has_begun = page.session, Event()

    def begin():
        session.is_playing = False
        session.wanted = scenario
        session.reset()
        session.advance()
        has_begun.set()

    wait_for(session, lambda: not session.inbox)
    session.post(begin)
    wait_for(session, has_begun.is_set)
    assert session.step == 1 and session.now == scenario
    wait(lambda: "**step 1**" in page._panel._status.content)
    assert page._error is None and all(thread.is_alive() for thread in page._threads)


def play_monkey(page, browser, rng, n_events, n_resets, is_hostile, file):
    """Send random values to random inputs, with resets, steps and clicks in between."""
    session = page.session
    resets = set(rng.sample(range(n_events), n_resets))
    for event in range(n_events):
        if event in resets:
            browser.set("run", "Reset")
            browser.set("run", "Step")
            wait_for(session, lambda: not session.inbox)
        uuid, control = rng.choice([*browser.inputs.items()])
        if control.label in ("run", "Lift and release the ball"):
            continue
        if is_hostile:
            browser.send(uuid, {"value": hostile(control, rng, file)})
        else:
            browser.send(uuid, {"value": legal(control, rng)})
        if rng.random() < 0.1:
            page._clicked(ray_onto(rng.uniform(-30, 30), rng.uniform(-30, 30)))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory, in which recordings come to lie."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_monkey(name, folder, n_events, n_resets, seed, is_hostile=False):
    """Send values to a page, and return the notifications that it showed."""
    mark, file = folder / "mark", folder / "evil.py"
    file.write_text(f"open({str(mark)!r}, 'w').close()\n")
    rng = random.Random(seed)
    with shown(**SCENARIOS[name]) as (page, browser):
        scenario = page.session.start
        browser.set("Play", True)
        wait(lambda: page.session.step >= 2)
        play_monkey(page, browser, rng, n_events, n_resets, is_hostile, file)
        settle(page, scenario)
        assert not mark.exists()
        return browser.notifications


@pytest.mark.parametrize("name", ["foraging", "aggregation"])
def test_any_legal_values_leave_the_page_alive(name, folder, capfd):
    run_monkey(name, folder, n_events=100, n_resets=1, seed=1)
    assert "Traceback" not in capfd.readouterr().err


def test_any_hostile_values_leave_the_page_alive(folder, capfd):
    assert run_monkey("cleaning", folder, n_events=300, n_resets=1, seed=2, is_hostile=True)
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_many_legal_values_leave_the_page_alive(name, folder, capfd):
    run_monkey(name, folder, n_events=750, n_resets=6, seed=3)
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_many_hostile_values_leave_the_page_alive(name, folder, capfd):
    run_monkey(name, folder, n_events=250, n_resets=1, seed=4, is_hostile=True)
    assert "Traceback" not in capfd.readouterr().err
