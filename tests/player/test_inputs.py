"""Messages of browsers to inputs: legal values reach the session, and others change nothing."""

import random
from contextlib import contextmanager
from threading import Event

import pytest
from support.page import (
    CONFIG,
    Browser,
    assert_no_error,
    assert_serves,
    draw,
    inputs,
    is_held_back,
    opened,
    send_drag,
    wait,
    wait_for,
    work,
)
from support.sessions import assert_copies_repeat

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player.controls import Control
from iswarm_mj.player.inbox import MOST_CLICKS
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.next_start import NextStart
from iswarm_mj.player.panel import CLICK_EFFECTS, DROP, LIFE
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.tasks.foraging import Foraging
from iswarm_mj.utils.constraints import Within

# Single messages.


def test_a_refused_value_is_answered_and_the_input_keeps_the_old_one(still):
    page, browser = still
    wanted = page.session.wanted
    now = page.session.now
    refused = {
        "p vector forget": 5.0,
        "robots": 0,
        "strategy": "red",
        "engine": "warp",
        "colour by": "red",
    }
    for label, value in refused.items():
        before = browser.value(label)
        browser.set(label, value)
        work(page)
        assert browser.value(label) == before
        assert f"{label} must be" in browser.note(label)
        assert str(value) in browser.note(label)
    assert not browser.notifications
    assert page.session.wanted == wanted
    assert page.session.now == now
    assert_no_error(page)


def test_messages_change_values_of_inputs_alone(still):
    page, browser = still
    uuid = browser.find("p vector forget")
    attributes = ["removed", "update_cb", "sync_cb", "props", "is_button", "gui_api", "uuid"]
    for name in [*attributes, "nothing"]:
        before = browser.properties(uuid)
        browser.send(uuid, {name: 7})
        browser.send(uuid, {"value": 0.5, name: 7})
        assert browser.properties(uuid) == before
    browser.send("no input", {"value": 1.0})

    browser.send(uuid, {"value": 0.75})
    work(page)
    assert page.session.now.genome.p_vector_forget == 0.75


def test_no_file_is_imported_because_a_message_names_it(still, tmp_path):
    page, browser = still
    mark = tmp_path / "mark"
    file = tmp_path / "evil.py"
    file.write_text(f"open({str(mark)!r}, 'w').close()\nclass X:\n    pass\n")
    for label in ("strategy", "task", "engine"):
        browser.set(label, f"{file}:X")
        work(page)
        assert not mark.exists()
        assert f"{label} must be" in browser.note(label)


def test_an_action_gets_the_value_that_was_checked(still):
    """JavaScript sends 30 for 30.0, and perhaps 7.0 for 7."""
    page, browser = still
    values = []
    inputs(page).add(Control("width", "", 0.5, limits=Within(0.0, 60.0)), values.append)
    inputs(page).add(Control("count", "", 3, limits=Within(1, 9)), values.append)
    browser.set("width", 30)
    browser.set("count", 7.0)
    browser.set("count", 7)  # which it has
    browser.set("count", 10)
    assert values == [30.0, 7]
    assert [type(value) for value in values] == [float, int]


def test_a_value_is_taken_though_its_browser_has_left(still):
    """Otherwise the page would show a value that the session does not have."""
    page, browser = still
    uuid = browser.find("p vector forget")
    browser.close()
    browser.send(uuid, {"value": 0.75})
    browser.open()
    work(page)
    assert page.session.now.genome.p_vector_forget == 0.75


def test_browsers_see_an_input_once_its_values_are_taken(still, monkeypatch):
    """A value that came earlier would be lost."""
    page, _ = still
    held_back = []
    register = Inputs._register

    def note_and_register(*arguments):
        held_back.append(is_held_back(page))
        register(*arguments)

    monkeypatch.setattr(Inputs, "_register", note_and_register)
    word = Control("word", "", "red", choices=("red", "blue"))
    inputs(page).add(word)
    inputs(page).add_button("button", print)
    inputs(page).add_buttons(word, print)
    assert held_back == [True, True, True]
    assert not is_held_back(page)


def test_a_flood_of_values_and_clicks_leaves_little_to_do(still):
    page, browser = still
    inbox = page.session.inbox
    for number in range(2000):
        browser.set("p vector forget", number % 2 / 4)
        browser.set("seed", 5 + number % 2)
    assert len(inbox) == 2

    browser.set("a click can", DROP)
    for _ in range(200):
        browser.press("Play")
        browser.click(5.0, 5.0)
    assert len(inbox) == 2 + MOST_CLICKS
    draw(page)
    assert browser.notifications == [
        "30 clicks wait already, as something takes long; click again when the page has done them"
    ]

    work(page)
    assert not inbox
    assert page.session.wanted.seed == 6


# Many random messages.

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
"""Fields of the scenarios of pages that get random messages."""
AFFORDABLE = {
    "robots": (6, 9),
    "arena.size": (20.0, 28.0),
    "density_of_robots": (0.005, 0.03),
}
"""Ranges of the settings that together make the number of robots and balls: a large arena at a high
density has thousands of robots, whose arena MuJoCo compiles for minutes."""
LARGEST_NUMBER = 1e3
"""Largest number that a control without a limit gets."""
SHARE_OF_CLICKS = 0.1
"""Share of messages after which somebody clicks on the arena."""
LEFT_ALONE = ("run", "Lift and release the ball", "Run the sweep", "Save plots as PNG")
"""Buttons that are not clicked at random: resets have their number, and the others take long."""


def legal_value(control, rng):
    """Return a value that a control takes, of a size that tests can afford."""
    if control.name in AFFORDABLE:
        low, high = AFFORDABLE[control.name]
        return rng.randint(low, high) if isinstance(low, int) else rng.uniform(low, high)
    if control.choices:
        return rng.choice([choice for choice in control.choices if choice != "mjx"])
    if isinstance(control.value, bool):
        return rng.random() < 0.5
    return legal_number(control, rng)


def legal_number(control, rng):
    """Return a number that a control takes: at an end of its range, near its value, or any."""
    low = max(control.low, -LARGEST_NUMBER)
    high = min(control.high, LARGEST_NUMBER)
    size = abs(control.value) or 1
    near = control.value + rng.choice((-1, 1)) * rng.random() * 0.2 * size
    number = rng.choice((low, high, near, rng.uniform(low, high)))
    if isinstance(control.value, int):
        # Thousands of substeps or balls would take minutes.
        most = 2 * control.value + 1
        number = round(min(max(number, control.value // 2), most))
    return min(max(number, control.low), control.high)


def hostile_value(rng, file):
    """Return a value that controls may refuse, such as the name of a class in a file."""
    numbers = [float("nan"), float("inf"), -5, 0.5, 1e308, 10**30, -(10**400)]
    words = ["", "x" * 100_000, f"{file}:X", "type2", "1", "nan", "'", '"', "\ud800", "\x00"]
    no_value = [None, True, False, [], [1, 2], {"a": 1}, b"\xff"]
    return rng.choice(numbers + words + no_value)


def play_at_random(browser, rng, n_events, n_resets, choose):
    """Send random values to random inputs, with resets, steps and clicks in between.

    Args:
        browser: browser that sends them.
        rng: source of all that is random.
        n_events: number of values.
        n_resets: number of resets.
        choose: returns a value for a control, see `legal_value`.
    """
    session = browser.page.session
    resets = set(rng.sample(range(n_events), n_resets))
    for event in range(n_events):
        if event in resets:
            browser.set("run", "Reset")
            browser.set("run", "Step")
            wait_for(session, lambda: not session.inbox)

        uuid, control = rng.choice([*browser.inputs.items()])
        if control.label in LEFT_ALONE:
            continue
        browser.send(uuid, {"value": choose(control, rng)})
        if rng.random() < SHARE_OF_CLICKS:
            browser.click(rng.uniform(-30, 30), rng.uniform(-30, 30))


def assert_begins_again(browser, scenario):
    """Assert that the first run can begin again, takes a step, and that the page shows it."""
    session = browser.page.session
    has_begun = Event()

    def begin():
        session.is_playing = False
        session.next_start = NextStart.of(scenario)
        session.reset()
        session.advance()
        has_begun.set()

    wait_for(session, lambda: not session.inbox)
    session.post(begin)
    wait_for(session, has_begun.is_set)
    assert session.step == 1
    assert session.now == scenario
    wait(lambda: "**step 1**" in browser.text)
    assert_serves(browser.page)


@contextmanager
def browser_of(name):
    """Open the page of one of `SCENARIOS`; yield a browser that shows it."""
    scenario = Scenario(CONFIG, robots=10, seed=3, **SCENARIOS[name])
    with opened(scenario, port=8340) as page:
        browser = Browser(page)
        yield browser
        browser.close()


@pytest.fixture
def send_at_random(tmp_path, monkeypatch, capfd):
    """A function that sends random values to a page; returns the notifications that it showed."""
    monkeypatch.chdir(tmp_path)  # in which recordings come to lie
    mark = tmp_path / "mark"
    file = tmp_path / "evil.py"
    file.write_text(f"open({str(mark)!r}, 'w').close()\n")

    def choose_hostile(_, rng):
        return hostile_value(rng, file)

    def send(name, *, n_events, n_resets, seed, is_hostile=False):
        choose = choose_hostile if is_hostile else legal_value
        with browser_of(name) as browser:
            scenario = browser.page.session.start
            browser.press("Play")
            wait(lambda: browser.page.session.step >= 2)
            play_at_random(browser, random.Random(seed), n_events, n_resets, choose)
            assert_begins_again(browser, scenario)
        assert not mark.exists()
        assert "Traceback" not in capfd.readouterr().err
        return browser.notifications

    return send


@pytest.mark.slow
@pytest.mark.parametrize("name", ["foraging", "aggregation"])
def test_any_legal_values_leave_the_page_alive(name, send_at_random):
    send_at_random(name, n_events=100, n_resets=1, seed=1)


def test_any_hostile_values_leave_the_page_alive(send_at_random):
    assert send_at_random("cleaning", n_events=300, n_resets=1, seed=2, is_hostile=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_many_legal_values_leave_the_page_alive(name, send_at_random):
    send_at_random(name, n_events=750, n_resets=6, seed=3)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_many_hostile_values_leave_the_page_alive(name, send_at_random):
    send_at_random(name, n_events=250, n_resets=1, seed=4, is_hostile=True)


# The copied command after anything.


def play_as_a_monkey(page, browser, rng, n_events, *, n_resets, effects):
    """Do random things that a run remembers: steps, rules, clicks, drags, failures, resets.

    Args:
        page: page whose threads have ended.
        browser: browser that shows it.
        rng: source of all that is random.
        n_events: number of things.
        n_resets: number of resets among them.
        effects: what clicks on the arena may do.
    """
    resets = set(rng.sample(range(n_events), n_resets))
    for number in range(n_events):
        event = rng.choice(("step", "step", "rule", "rule", "click", "drag", "fail"))
        if number in resets:
            browser.set("run", "Reset")
        elif event == "step":
            browser.set("run", "Step")
        elif event == "rule":
            uuid, control = rng.choice([each for each in browser.inputs.items() if each[1].is_live])
            browser.send(uuid, {"value": legal_value(control, rng)})
        elif event == "click":
            browser.set("a click can", rng.choice(effects))
            browser.click(rng.uniform(-30, 30), rng.uniform(-30, 30))
        elif event == "drag":
            place = (rng.uniform(-15, 15), rng.uniform(-15, 15), 45.0)
            robot = rng.randrange(10)
            for phase in ("start", "end"):
                send_drag(page, robot, (0.0, 0.0, 90.0), place, phase)
        else:
            browser.set("share that fails", rng.choice((0.0, 0.1, 0.2)))
            browser.press("Let them fail now")
        work(page)


@pytest.mark.parametrize(
    ("n_events", "n_resets", "effects"),
    [
        (60, 1, (DROP, LIFE)),
        pytest.param(1000, 4, CLICK_EFFECTS, marks=pytest.mark.slow),
    ],
)
def test_after_random_events_the_copied_command_repeats_the_run(
    still, tmp_path, n_events, n_resets, effects
):
    page, browser = still
    play_as_a_monkey(page, browser, random.Random(5), n_events, n_resets=n_resets, effects=effects)
    for _ in range(2):
        browser.set("run", "Step")
        work(page)
    session = page.session
    assert len(session.changes) > 3
    assert_copies_repeat(session, tmp_path)
