"""What is done on the page is a run: bit by bit that of `Run`, and of the command that is
copied."""

import math
import re
import shlex
import tomllib
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from support.rrd import read

from iswarm_mj.commands.main import parse
from iswarm_mj.config.swarm import ArenaConfig, OpticsConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player.changes import Change, edit
from iswarm_mj.player.controls import controls, is_live
from iswarm_mj.player.faults import describe
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.simulation.compiled_loop import _advance
from iswarm_mj.simulation.decide import decide_packed
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.scenario_flags import toml
from iswarm_mj.strategy.genome import PRESETS, TYPE1
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.tasks.foraging import Forager, Foraging
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

CONFIG = SwarmConfig(ArenaConfig(size=24.0, n_dust=12, dust_area_offset=7.0))
SCENARIO = PageScenario(CONFIG, robots=20, seed=3, engine=PlanarSettings())


def state(run: Run) -> list[np.ndarray]:
    params, state = run.arrays()
    return [
        np.asarray(leaf) for leaf in jax.tree.leaves((params.conditions, params.strategy, state))
    ]


def assert_same(one: Run, other: Run) -> None:
    for a, b in zip(state(one), state(other), strict=True):
        np.testing.assert_array_equal(a, b)


def steps(session: Session, n: int) -> Session:
    for _ in range(n):
        session.advance()
    return session


def assert_copies_repeat(session: Session, path: Path) -> None:
    """The command that is copied and the file that is saved give the same state after as many
    steps."""
    command = re.sub(r"^iswarm (run|play)|--steps \d+", "", session.command())
    path.write_text(re.sub(r"steps = \d+", "", session.toml()))
    for arguments in (shlex.split(command), ["--config", str(path)]):
        assert_same(steps(parse(["play", *arguments]).session(), session.step).run, session.run)


def test_a_session_is_a_run():
    run = Run(Scenario(CONFIG, robots=20, engine=PlanarSettings(), seed=3, steps=1000))
    for _ in range(6):
        run.advance()
    assert_same(steps(Session(SCENARIO), 6).run, run)


def test_play_pause_step_and_reset(monkeypatch):
    session = Session(SCENARIO)
    assert not session.work() and session.step == 0
    session.is_playing = True
    session.work()
    session.work()
    assert session.step == 2
    session.shown = 0.0
    session.work()
    assert session.step == 2  # not farther ahead of what is shown
    session.is_playing = False
    clock, advance = [0.0], session.run.advance
    with monkeypatch.context() as patch:
        patch.setattr("time.perf_counter", lambda: clock[0])
        patch.setattr(
            session.run, "advance", lambda: (clock.insert(0, clock[0] + 0.25), advance())[1]
        )
        session._laps.clear()
        session.advance()
    assert session.rate == 4
    first = state(session.run)
    session.reset()
    assert session.step == 0 and session.version == 2
    for a, b in zip(first, state(steps(session, 3).run), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_setting_changes_the_world_and_what_is_copied_repeats_it(tmp_path):
    session = steps(Session(SCENARIO), 2)
    session.set("p_vector_forget", 0.75)
    session.set("optics.error_in_communication", 0.5)
    session.set("use_hop_count", False)
    params, _ = session.run.arrays()
    np.testing.assert_array_equal(params.strategy.rules.p_vector_forget, np.float32([0.75]))
    np.testing.assert_array_equal(params.conditions.error_in_communication, np.float32([0.5]))
    steps(session, 3)
    session.change("kill", "4")
    session.change("ball", "2.5,-1.5")
    steps(session, 3)
    assert [str(change) for change in session.changes] == [
        "2:p_vector_forget=0.75",
        "2:optics.error_in_communication=0.5",
        "2:use_hop_count=false",
        "5:kill=4",
        "5:ball=2.5,-1.5",
    ]
    assert_copies_repeat(session, tmp_path / "play.toml")
    unchanged = steps(Session(SCENARIO), 8)
    assert not np.array_equal(
        unchanged.snapshots[-1].frames.pose, session.snapshots[-1].frames.pose
    )


def test_what_is_copied_of_another_task_and_strategy_repeats_it(tmp_path):
    arena = ArenaConfig(size=24.0, dust_area_offset=7.0, obstacles=((5.0, 5.0, 1.0, 2.0, 30.0),))
    task = Aggregation(spot_radius=4.0, spot_offset=7.0)
    own = {
        "strategy": Beeclust(longest_wait=20.0),
        "task": task,
        "robots": 12,
        "engine": PlanarSettings(),
    }
    scenario = PageScenario(SwarmConfig(arena), **own)
    session = steps(Session(scenario), 4)
    assert session.command().startswith("iswarm run ")
    assert_copies_repeat(session, tmp_path / "play.toml")
    before = session.snapshots[-1].frames.task["area_bright"]
    session.set("spot_radius", 3.0)  # of the task, while it runs
    steps(session, 3)
    np.testing.assert_allclose(
        session.snapshots[-1].frames.task["area_bright"][..., 2], 0.75 * before[..., 2]
    )
    assert [str(change) for change in session.changes] == ["4:spot_radius=3.0"]
    assert_copies_repeat(session, tmp_path / "play.toml")


def test_settings_without_effect_until_reset():
    session = steps(Session(SCENARIO), 1)
    session.set("robots", 15)
    assert session.run.settings.n_robots == 20 and session.now.n_robots == 20
    session.reset()
    assert session.run.settings.n_robots == 15
    session.set("arena.size", 30.0)  # before the first step: at once
    session.work()
    assert session.run.config.arena.size == 30


def test_rules_of_what_runs_change_while_another_strategy_waits():
    """They are carried into what waits where that is of the same class, and not into fields of the
    same name."""
    session = steps(Session(SCENARIO), 1)
    session.want("strategy", "forager")
    session.set("weight_find_dump", 0.5)
    assert session.now.genome.weight_find_dump == 0.5 and session.wanted.strategy == Forager()
    session.want("strategy", "type2")
    session.set("p_vector_forget", 0.625)
    assert session.now.genome.p_vector_forget == session.wanted.genome.p_vector_forget == 0.625
    assert session.wanted.genome == replace(PRESETS["type2"], p_vector_forget=0.625)
    assert session.wanted.get("strategy") == "type2" and session.now.get("strategy") == "type1"
    assert session.pending[0] == "strategy" and "p vector forget" not in session.pending
    assert not steps(Session(replace(SCENARIO, robots=None)), 1).pending


def test_settings_of_a_task_that_waits():
    own = {"strategy": Forager(), "task": Foraging(), "robots": 12, "engine": PlanarSettings()}
    session = steps(Session(PageScenario(CONFIG, **own)), 1)
    session.want("task", "cleaning")
    before = session.wanted
    with pytest.raises(UserError, match="Forager and Cleaning have no setting source_radius"):
        session.want("source_radius", 3.0)
    assert session.wanted is before
    assert "task" in session.pending and session.now.task == Foraging()


@pytest.mark.parametrize(
    "name", ["nothing", "config", "strategy_name", "optics.nothing", "optics", ""]
)
def test_settings_that_there_are_not(name):
    with pytest.raises(UserError, match="have no setting"):
        SCENARIO.set(name, 1.0)


def test_a_fault_pauses_and_is_explained_and_reset_works(capsys, monkeypatch):
    session = steps(Session(SCENARIO), 1)
    with monkeypatch.context() as patch:
        patch.setattr(session.run, "advance", lambda: 1 / 0)
        for _ in range(2):
            session.is_playing = True
            assert session.work() and not session.is_playing
            assert session.messages.get_nowait().startswith("ZeroDivisionError: division by zero")
        assert capsys.readouterr().err.count("Traceback") == 1
        patch.setattr(PageScenario, "run", lambda _: [][0])
        session.post(session.reset)
        session.work()
        assert session.messages.get_nowait().startswith("IndexError")
        assert session.step == 1 and session.now == SCENARIO
    session.post(session.reset)
    session.work()
    assert session.step == 0 and session.version == 2
    session.is_playing = True
    session.work()
    assert session.step == 1 and session.messages.empty()


def test_an_error_of_a_step_is_shown_once(monkeypatch):
    session = Session(SCENARIO)

    def refuse():
        raise UserError("Walk.act raised ValueError")

    monkeypatch.setattr(session.run, "advance", refuse)
    session.is_playing = True
    session.work()
    assert not session.is_playing and not session.work()
    assert (
        session.messages.get_nowait() == "Walk.act raised ValueError" and session.messages.empty()
    )


def test_a_recording_that_cannot_be_completed_is_let_go(capsys, tmp_path):
    session = Session(SCENARIO, out=tmp_path)

    class Full:
        def save(self):
            raise OSError("No space left on device")

    session._recorder = Full()
    for version in (1, 2):
        session.post(session.reset)
        session.work()
        assert session.version == version
    assert session.messages.get_nowait().startswith("OSError: No space left on device")


def test_a_recording_is_complete_where_the_areas_on_the_floor_move(tmp_path):
    """It has them from its start, so that what follows would be drawn on the old floor."""
    session = steps(Session(SCENARIO, out=tmp_path), 1)
    session.start_recording()
    steps(session, 1)
    session.set("optics.error_in_communication", 0.5)  # moves no area
    assert session.is_recording
    session.set("arena.dump_size", 6.0)
    assert not session.is_recording
    assert read(tmp_path / "play-1.rrd")["/world/robots/body"]["step"] == [1, 2]

    session.start_recording()
    session.want("arena.size", 26.0)
    session.reset()
    assert not session.is_recording
    assert read(tmp_path / "play-2.rrd")["/world/robots/body"]["step"] == [2]


def test_a_refused_reset_leaves_the_recording_alone(tmp_path, monkeypatch):
    session = steps(Session(SCENARIO, out=tmp_path), 1)
    session.start_recording()

    def refuse(_):
        raise UserError("the settings do not fit each other")

    with monkeypatch.context() as patch, pytest.raises(UserError, match="do not fit"):
        patch.setattr(PageScenario, "run", refuse)
        session.reset()
    assert session.is_recording and session.version == 1
    session.stop_recording()


def test_a_page_makes_so_many_recordings(tmp_path, monkeypatch):
    monkeypatch.setattr("iswarm_mj.player.session.MOST_RECORDINGS", 2)
    session = steps(Session(SCENARIO, out=tmp_path), 1)
    for _ in range(2):
        session.start_recording()
        session.start_recording()  # which goes on
        session.stop_recording()
    with pytest.raises(UserError, match="this page has made 2 recordings, as many as it can"):
        session.start_recording()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["play-1.rrd", "play-2.rrd"]


def test_a_fault_names_the_line_of_a_users_file(tmp_path):
    file = tmp_path / "walk.py"
    file.write_text("def act():\n    raise ValueError('no\\nway')\n")
    space = {}
    exec(compile(file.read_text(), str(file), "exec"), space)
    with pytest.raises(ValueError, match="no") as caught:
        space["act"]()
    assert describe(caught.value).startswith(f"ValueError: no ({file}, line 2);")


def test_programs_of_earlier_sizes_are_let_go():
    session = Session(SCENARIO)
    for robots in (7, 8, 9, 10):
        session.want("robots", robots)
        session.reset()
        steps(session, 2)
        assert math.isfinite(session.rate)
    assert decide_packed._cache_size() + _advance._cache_size() <= 2
    session.reset()
    assert math.isinf(session.rate)


def test_a_dead_robot_stays_where_it_is():
    session = steps(Session(SCENARIO), 1)
    session.change("kill", "1")
    places = [session.snapshots[-1].frames.pose[0, 1]]
    for _ in range(3):
        session.advance()
        places.append(session.snapshots[-1].frames.pose[0, 1])
    assert not session.is_alive[1] and session.is_alive.sum() == 19
    np.testing.assert_allclose(np.ptp(places, axis=0)[:2], 0, atol=2e-4)  # others may push it
    session.change("revive", "1")
    assert session.is_alive.all()


def test_a_ball_lies_where_it_was_dropped():
    session = steps(Session(SCENARIO), 1)
    session.change("ball", "9.0,9.0")
    balls = session.run.task_state
    distance = np.linalg.norm(balls.position[0] - np.array([9.0, 9.0]) * 2 * np.sqrt(2), axis=-1)
    assert distance.min() < 1e-4 and balls.is_lying[0, distance.argmin()]


def test_the_farthest_ball_is_dropped_of_those_delivered_if_there_are_any(begun):
    place, swarm = np.array([9.0, 9.0]) * RD, jax.tree.map(np.array, begun.run.arrays()[1].swarm)
    drop, balls = edit(begun.run, Change(1, "ball", "9.0,9.0")), swarm.task
    order = np.argsort(np.linalg.norm(balls.position[0] - place, axis=-1))
    balls.is_held[0, order[-1]] = True
    for wanted, delivered in ((order[-2], []), (order[2], order[:3])):
        balls.is_delivered[0, delivered] = True
        after = drop(swarm).task
        assert np.flatnonzero((after.position != balls.position).any(axis=-1)[0]).tolist() == [
            wanted
        ]
        np.testing.assert_allclose(after.position[0, wanted], place, rtol=1e-6)
        assert not after.is_delivered[0, wanted] and after.is_delivered.sum() == max(
            0, len(delivered) - 1
        )


IMPOSSIBLE = [
    "kill=20",
    "kill=x",
    "revive=-1",
    "ball=99,0",
    "ball=nan,0",
    "ball=3",
    "ball=a",
    "nothing=1",
    "robots=3",
]
IMPOSSIBLE += ["p_vector_forget=2", "use_hop_count=1"]


@pytest.fixture(scope="module")
def begun():
    """A session after a step."""
    return steps(Session(SCENARIO), 1)


@pytest.mark.parametrize("words", IMPOSSIBLE)
def test_impossible_changes_begin_no_session_and_change_nothing_later(begun, words):
    change = Change.parse(f"4:{words}")
    with pytest.raises(UserError):
        Session(SCENARIO, [change])
    before = state(begun.run)
    begun.post(lambda: begun.change(change.what, change.value))
    begun.work()
    assert begun.messages.get_nowait() and not begun.changes
    for a, b in zip(before, state(begun.run), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("text", ["", "5", "x:kill=1", "5:kill", "-1:kill=2"])
def test_texts_that_are_no_changes(text):
    with pytest.raises(UserError, match="STEP:SETTING=VALUE"):
        Change.parse(text)
    change = Change(5, "kill", "1")
    assert Change.parse(str(change)) == change


def test_controls_have_the_ranges_that_settings_declare():
    found = {control.name: control for control in controls(SCENARIO)}
    forget = found["p_vector_forget"]
    assert (forget.low, forget.high, forget.value, forget.is_live) == (0, 1, 0.29, True)
    assert found["strategy.priority_repulsion"].choices == ("higher", "scaled")
    assert found["robots"].value == 20 and not found["robots"].is_live
    own = {c.name: c for c in controls(PageScenario(strategy=Beeclust(), task=Aggregation()))}
    assert (
        own["longest_wait"].is_live
        and "p_vector_forget" not in own
        and "gripper.drop_rate" not in own
    )
    assert not is_live(SCENARIO, "fraction_scouts") and not is_live(SCENARIO, "arena.size")


def test_each_control_takes_its_own_value():
    for control in controls(SCENARIO):
        assert SCENARIO.set(control.name, control.value).get(control.name) == control.value
    sparse = SCENARIO.set("density_of_robots", 0.1)
    assert (
        sparse.n_robots
        == PageScenario(CONFIG, strategy=replace(TYPE1, density_of_robots=0.1)).n_robots
        != 20
    )
    paper = PageScenario(strategy=Beeclust()).set("strategy", "type2")
    assert paper.strategy == PRESETS["type2"]


def test_switches_of_a_genome_are_copied():
    """But not the density where the number of robots is given."""
    own = replace(TYPE1, use_hop_count=not TYPE1.use_hop_count)
    scenario = replace(SCENARIO, strategy=replace(own, density_of_robots=0.2))
    command = parse(["play", *shlex.split(Session(scenario).command())[2:-2]])
    assert command.session().start.genome == own


TEAMS = [
    "play",
    "--strategy",
    "type1=0.5",
    "type2=0.5",
    "--robots=10",
    "--engine=planar",
    "--arena.size=24",
]
TEAMS += ["--arena.n-dust=12", "--arena.dust-area-offset=7"]


CHANGED = ["--changes", "2:kill=3", "3:optics.error_in_communication=0.25"]


@pytest.mark.parametrize("own", [[], ["--type1.p-vector-forget=0.9"], CHANGED])
def test_what_is_copied_of_teams_repeats_them(own, tmp_path):
    session = steps(parse([*TEAMS, *own]).session(), 5)
    assert_copies_repeat(session, tmp_path / "play.toml")


def test_teams_of_python_are_copied_if_flags_can_state_them(tmp_path):
    def scenario(**teams):
        return replace(SCENARIO, strategy=Teams(teams), robots=10)

    own = replace(PRESETS["type2"], weight_find_dust=0.125)
    session = steps(Session(scenario(type1=(0.5, TYPE1), type2=(0.5, own))), 2)
    assert "--strategy type1=0.5 type2=0.5" in session.command()
    assert "--type2.weight-find-dust 0.125" in session.command()
    assert_copies_repeat(session, tmp_path / "play.toml")
    for teams in (
        {"red": (0.5, TYPE1), "blue": (0.5, own)},
        {"type1": (0.5, own), "red": (0.5, own)},
    ):
        with pytest.raises(UserError, match="no flag can state the names and shares of the teams"):
            Session(scenario(**teams)).command()


def test_a_class_of_no_file_is_not_copied():
    own = type("Own", (Beeclust,), {"__module__": "nowhere"})
    with pytest.raises(UserError, match="no command can name Own"):
        PageScenario(strategy=own(), task=Aggregation()).values()


ODD = [
    "🤖.py:Walk",
    'a"b',
    "a\\b",
    "a\nb\tc\x00\x1f\x7f\x80",
    "ä é ß",
    "'",
    "=",
    "# no comment",
    "\\u0041",
    " ",
]


@pytest.mark.parametrize("text", ODD)
def test_files_hold_any_text(text):
    values = {"strategy": text, "optics.größe": (1.5, text), "is": True, "n": 3, "x": 1e-300}
    found = tomllib.loads(toml(values).encode().decode())
    assert found == {
        "strategy": text,
        "optics": {"größe": [1.5, text]},
        "is": True,
        "n": 3,
        "x": 1e-300,
    }


def test_files_hold_no_text_that_is_not_utf_8():
    with pytest.raises(UserError, match="no TOML can hold"):
        toml({"strategy": "\udcff.py:Walk"})


def test_a_strategy_of_an_odd_file_is_repeated(tmp_path):
    file = tmp_path / "🤖 'a\\b\x7f.py"
    file.write_text(
        "from iswarm_mj.tasks.aggregation import Beeclust\n\n\nclass Walk(Beeclust):\n    pass\n"
    )
    session = parse(
        ["play", "--task=aggregation", f"--strategy={file}:Walk", "--robots=8", "--engine=planar"]
    ).session()
    assert_copies_repeat(steps(session, 1), tmp_path / "play.toml")


def test_earlier_changes_of_a_setting_are_kept():
    session = steps(Session(SCENARIO), 1)
    session.change("p_vector_forget", "0.5")
    session.advance()
    session.change("p_vector_forget", "0.6")
    assert [str(change) for change in session.changes] == [
        "1:p_vector_forget=0.5",
        "2:p_vector_forget=0.6",
    ]


def test_balls_are_refused_where_a_task_has_none():
    with pytest.raises(UserError, match="Aggregation has no balls"):
        Session(
            PageScenario(strategy=Beeclust(), task=Aggregation(), robots=4),
            [Change.parse("9:ball=0,0")],
        )


def test_a_swarm_that_fills_a_large_arena_is_within_the_range_of_its_control():
    """Whose number of robots follows from density and size, and is beyond the usual limit."""
    dense = PageScenario(
        SwarmConfig(ArenaConfig(size=1000.0)), strategy=replace(TYPE1, density_of_robots=0.9)
    )
    robots = next(control for control in controls(dense) if control.name == "robots")
    assert robots.value == dense.n_robots > 200_000 and robots.low <= robots.value <= robots.high


def test_whole_numbers_in_place_of_floats_may_become_floats():
    scenario = PageScenario(SwarmConfig(optics=OpticsConfig(wall_range=2)))
    control = next(control for control in controls(scenario) if control.name == "optics.wall_range")
    assert control.check(2.5) == 2.5 and isinstance(control.value, float)
