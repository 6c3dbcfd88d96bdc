"""What is said on stderr while something runs."""

import sys
import threading
import time

import pytest

from iswarm_mj.utils import progress
from iswarm_mj.utils.progress import Progress, duration, waiting


@pytest.fixture
def clock(monkeypatch):
    """A clock that is set by hand."""
    now = [100.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: now[0])
    return now


def test_rate_and_remaining_time_leave_the_first_call_out(clock):
    bar = Progress(100, "step", "run", waiting="compiling")
    assert bar.line() == "run: 0 of 100 steps, compiling"
    clock[0] += 60  # compilation
    bar.update(20)
    assert bar.line() == "run: 20 of 100 steps"
    clock[0] += 10
    bar.update(20)
    bar.say("all well")
    assert bar.line() == "run: 40 of 100 steps, 2 steps/s, about 30 s left, all well"


def test_texts_are_due_once_a_second(clock):
    bar = Progress(10, "run")
    assert [bar.is_due(), bar.is_due()] == [True, False]
    clock[0] += 1.1
    assert bar.is_due()


def test_what_was_done_before_is_no_part_of_the_rate(clock):
    bar = Progress(10, "run", done=4)
    bar.update()
    clock[0] += 20
    bar.update(2)
    assert bar.line() == "7 of 10 runs, 0.1 runs/s, about 30 s left"


def test_lines_are_written_where_there_is_no_terminal(monkeypatch, capsys):
    monkeypatch.setattr(progress, "PATIENCE", 0.01)
    monkeypatch.setattr(progress, "INTERVAL", 0.05)
    with Progress(3, "step", waiting="compiling the step") as bar:
        _until(capsys, "iswarm: compiling the step\n")
        bar.update()
        _until(capsys, "iswarm: 1 of 3 steps\n")
    capsys.readouterr()
    time.sleep(0.15)
    assert capsys.readouterr().err == ""


def test_what_is_quick_or_hidden_says_nothing(monkeypatch, capsys):
    with Progress(3, "step", waiting="compiling") as bar, waiting("placing"):
        bar.update(3)
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    with Progress(3, "step", waiting="compiling", hidden=True), waiting("placing", hidden=True):
        time.sleep(0.1)
    assert capsys.readouterr().err == ""


def test_a_long_preparation_is_explained(monkeypatch, capsys):
    monkeypatch.setattr(progress, "PATIENCE", 0.01)
    with waiting("placing 9 robots"):
        _until(capsys, "iswarm: placing 9 robots\n")


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (89, "89 s"), (91, "2 min"), (3600, "60 min"), (9000, "2.5 h")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def _until(capsys, wanted):
    """Wait for a text on stderr; fails by the time limit of the tests if it does not come."""
    said = ""
    while wanted not in said:
        time.sleep(0.01)
        said += capsys.readouterr().err


def test_nothing_is_said_after_what_ended_the_block(monkeypatch, capfd):
    """Neither in the middle of a line: whoever waits has told all when an error's sentence follows."""
    is_telling = threading.Event()

    def slow(text, **_):
        is_telling.set()
        time.sleep(0.2)
        sys.stderr.write(f"{text}\n")

    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr(progress, "print", slow, raising=False)
    with pytest.raises(RuntimeError), waiting("compiling"):
        is_telling.wait()
        raise RuntimeError
    sys.stderr.write("the error\n")
    assert capfd.readouterr().err == "iswarm: compiling\nthe error\n"
