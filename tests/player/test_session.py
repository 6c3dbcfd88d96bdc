"""A session is a run that somebody plays with: it pauses, changes, begins again, and is recorded."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.page import CONFIG, SCENARIO
from support.rrd import read
from support.sessions import PAGE_SCENARIO, assert_same, begun, names_of, state, steps

from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.schema import Frames
from iswarm_mj.player.changes import Change
from iswarm_mj.player.faults import describe
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.simulation.compiled_loop import _advance
from iswarm_mj.simulation.decide import decide_packed
from iswarm_mj.simulation.run import Run
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.foraging import Forager, Foraging
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.recorder import Recorder

# Control steps.


def test_a_session_is_a_run():
    run = Run(replace(SCENARIO, steps=1000))
    for _ in range(6):
        run.advance()
    assert_same(state(begun(n=6).run), state(run))


def test_it_plays_until_it_is_ahead_of_what_is_shown():
    session = Session(PAGE_SCENARIO)
    assert not session.work()
    assert session.step == 0

    session.is_playing = True
    session.work()
    session.work()
    assert session.step == 2
    session.shown = 0.0
    session.work()
    assert session.step == 2


def test_its_rate_is_that_of_the_steps_after_the_first_which_compiles(monkeypatch):
    session = Session(PAGE_SCENARIO)
    advance = session.run.advance
    seconds = 0.0

    def advance_in_a_quarter_of_a_second():
        nonlocal seconds
        seconds += 0.25
        return advance()

    monkeypatch.setattr("time.perf_counter", lambda: seconds)
    monkeypatch.setattr(session.run, "advance", advance_in_a_quarter_of_a_second)
    session.advance()
    assert math.isinf(session.rate)
    session.advance()
    assert session.rate == 4


def test_its_lines_have_whole_steps_while_another_is_added(monkeypatch):
    """A page that plots in the middle of a step sees no metric ahead of its step."""
    session = begun(n=2)
    lengths = set()

    class ArraysReadInBetween(dict):
        def __getitem__(self, name):
            lengths.update(len(values) for values in session.lines.values())
            return super().__getitem__(name)

    arrays = Frames.arrays
    monkeypatch.setattr(Frames, "arrays", lambda frames: ArraysReadInBetween(arrays(frames)))
    session.advance()
    assert lengths == {3}
    assert session.lines["step"] == [0, 1, 2, 3]


def test_a_reset_begins_again_with_the_same_seed():
    session = begun(n=3)
    first = state(session.run)
    session.reset()
    assert session.step == 0
    assert session.version == 2
    assert_same(state(steps(session, 3).run), first)


# Settings.


def test_settings_that_wait_for_a_reset():
    session = begun()
    session.set("robots", 15)
    assert session.run.settings.n_robots == 20
    assert session.now.n_robots == 20
    session.reset()
    assert session.run.settings.n_robots == 15


def test_before_the_first_step_no_setting_waits():
    session = Session(PAGE_SCENARIO)
    session.set("arena.size", 30.0)
    session.work()
    assert session.run.config.arena.size == 30


def test_before_the_first_step_changes_are_kept_where_a_setting_changes():
    session = Session(PAGE_SCENARIO, [Change.parse("2:kill=1"), Change.parse("3:kill=19")])
    session.change("kill", "5")
    session.change("kill", "18")
    session.set("robots", 15)
    session.work()
    assert len(session.is_alive) == 15
    assert names_of(session.changes) == ["0:kill=5"]
    assert np.flatnonzero(~session.is_alive).tolist() == [5]
    assert names_of(session.waiting) == ["2:kill=1"]
    assert next_message(session).startswith("the change 0:kill=18 is left out: there is no robot")
    assert next_message(session).startswith("the change 3:kill=19 is left out: there is no robot")


def test_rules_do_not_pass_to_another_class_of_strategy_that_waits():
    """It may have fields of the same name."""
    session = begun()
    session.want("strategy", "forager")
    session.set("weight_find_dump", 0.5)
    assert session.now.genome.weight_find_dump == 0.5
    assert session.wanted.strategy == Forager()


def test_rules_pass_to_a_strategy_of_the_same_class_that_waits():
    session = begun()
    session.want("strategy", "type2")
    session.set("p_vector_forget", 0.625)
    assert session.now.genome.p_vector_forget == 0.625
    assert session.wanted.genome == replace(PRESETS["type2"], p_vector_forget=0.625)
    assert session.now.get("strategy") == "type1"
    assert session.wanted.get("strategy") == "type2"
    assert session.pending["strategy"] == "type1 → type2"
    assert "p vector forget" not in session.pending


def test_nothing_waits_at_first():
    assert not begun(replace(PAGE_SCENARIO, robots=None)).pending


def test_settings_of_a_task_that_waits():
    parts = {"strategy": Forager(), "task": Foraging()}
    session = begun(PageScenario(CONFIG, robots=12, engine=PlanarSettings(), **parts))
    session.want("task", "cleaning")
    wanted = session.wanted
    with pytest.raises(UserError, match="Forager and Cleaning have no setting source_radius"):
        session.want("source_radius", 3.0)
    assert session.wanted is wanted
    assert "task" in session.pending
    assert session.now.task == Foraging()


# Faults.


def next_message(session):
    """Return the first message of a session that was not shown, without waiting for one."""
    return session.messages.get_nowait()


def post(session, call):
    """Have a session do something, and do it."""
    session.post(call)
    session.work()


def test_a_fault_pauses_and_its_traceback_is_printed_once(capsys, monkeypatch):
    session = begun()
    monkeypatch.setattr(session.run, "advance", lambda: 1 / 0)
    for _ in range(2):
        session.is_playing = True
        assert session.work()
        assert not session.is_playing
        assert next_message(session).startswith("ZeroDivisionError: division by zero")
    assert capsys.readouterr().err.count("Traceback") == 1


def test_a_reset_that_fails_leaves_the_run_as_it_was(monkeypatch):
    session = begun()
    monkeypatch.setattr(PageScenario, "run", lambda _: [][0])
    post(session, session.reset)
    assert next_message(session).startswith("IndexError")
    assert session.step == 1
    assert session.now == PAGE_SCENARIO


def test_after_a_fault_a_reset_works(monkeypatch):
    session = begun()
    monkeypatch.setattr(session.run, "advance", lambda: 1 / 0)
    session.is_playing = True
    session.work()
    next_message(session)

    post(session, session.reset)
    assert session.step == 0
    assert session.version == 2
    session.is_playing = True
    session.work()
    assert session.step == 1
    assert session.messages.empty()


def test_an_error_of_a_step_is_shown_once(monkeypatch):
    session = Session(PAGE_SCENARIO)

    def refuse():
        raise UserError("Walk.act raised ValueError")

    monkeypatch.setattr(session.run, "advance", refuse)
    session.is_playing = True
    session.work()
    assert not session.is_playing
    assert not session.work()
    assert next_message(session) == "Walk.act raised ValueError"
    assert session.messages.empty()


def test_a_fault_names_the_line_of_a_users_file(tmp_path):
    file = tmp_path / "walk.py"
    file.write_text("def act():\n    raise ValueError('no\\nway')\n")
    space = {}
    exec(compile(file.read_text(), str(file), "exec"), space)
    with pytest.raises(ValueError, match="no") as raised:
        space["act"]()
    assert describe(raised.value).startswith(f"ValueError: no ({file}, line 2);")


# Recordings.


def recorded_steps(path):
    """Return the control steps that a recording has."""
    return read(path)["/world/robots/body"]["step"]


def test_a_recording_that_cannot_be_completed_is_let_go(tmp_path, monkeypatch):
    session = begun(out=tmp_path)
    session.start_recording()

    def refuse(_):
        raise OSError("No space left on device")

    monkeypatch.setattr(Recorder, "save", refuse)
    post(session, session.reset)
    assert next_message(session).startswith("OSError: No space left on device")
    assert session.version == 1
    assert not session.is_recording
    post(session, session.reset)
    assert session.version == 2


def test_a_recording_is_complete_where_the_areas_on_the_floor_move(tmp_path):
    """It has them from its start, so that what follows would be drawn on the old floor."""
    session = begun(out=tmp_path)
    session.start_recording()
    steps(session, 1)
    session.set("optics.error_in_communication", 0.5)  # moves no area
    assert session.is_recording
    session.set("arena.dump_size", 6.0)
    assert not session.is_recording
    assert recorded_steps(tmp_path / "play-1.rrd") == [1, 2]


def test_a_recording_is_complete_where_another_run_begins(tmp_path):
    session = begun(out=tmp_path)
    session.start_recording()
    session.want("arena.size", 26.0)
    session.reset()
    assert not session.is_recording
    assert recorded_steps(tmp_path / "play-1.rrd") == [1]


def test_a_refused_reset_leaves_the_recording_alone(tmp_path, monkeypatch):
    session = begun(out=tmp_path)
    session.start_recording()

    def refuse(_):
        raise UserError("the settings do not fit each other")

    with monkeypatch.context() as patch, pytest.raises(UserError, match="do not fit"):
        patch.setattr(PageScenario, "run", refuse)
        session.reset()
    assert session.is_recording
    assert session.version == 1
    session.stop_recording()


def test_the_number_of_recordings_is_limited(tmp_path, monkeypatch):
    monkeypatch.setattr("iswarm_mj.player.session.MOST_RECORDINGS", 2)
    session = begun(out=tmp_path)
    for _ in range(2):
        session.start_recording()
        session.start_recording()  # which goes on
        session.stop_recording()
    with pytest.raises(UserError, match="this page has made 2 recordings, as many as it can"):
        session.start_recording()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["play-1.rrd", "play-2.rrd"]


# Robots and balls.


def test_a_dead_robot_stays_where_it_is():
    session = begun()
    session.change("kill", "1")
    poses = [session.snapshots[-1].frames.pose[0, 1]]
    for _ in range(3):
        session.advance()
        poses.append(session.snapshots[-1].frames.pose[0, 1])
    assert not session.is_alive[1]
    assert session.is_alive.sum() == 19
    moved = np.ptp(poses, axis=0)[:2]
    np.testing.assert_allclose(moved, 0, atol=2e-4)  # others may push it
    session.change("revive", "1")
    assert session.is_alive.all()


def test_earlier_changes_of_a_setting_are_kept():
    session = begun()
    session.change("p_vector_forget", "0.5")
    session.advance()
    session.change("p_vector_forget", "0.6")
    assert names_of(session.changes) == ["1:p_vector_forget=0.5", "2:p_vector_forget=0.6"]


# Memory; the last test, as programs that were let go are compiled again.


@pytest.mark.slow
def test_programs_of_earlier_sizes_are_let_go():
    session = Session(PAGE_SCENARIO)
    for robots in (7, 8, 9):
        session.want("robots", robots)
        session.reset()
        steps(session, 2)
        assert math.isfinite(session.rate)
    assert decide_packed._cache_size() + _advance._cache_size() <= 2
    session.reset()
    assert math.isinf(session.rate)
