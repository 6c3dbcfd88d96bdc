"""Lines on stderr while something runs."""

import pytest

from iswarm_mj.utils import progress
from iswarm_mj.utils.progress import Progress, waiting


@pytest.fixture
def clock(monkeypatch):
    """Return a clock that is set by hand, as a list of its time [s]."""
    now = [100.0]
    monkeypatch.setattr("time.time", lambda: now[0])
    monkeypatch.setattr("tqdm.std.time", lambda: now[0])
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


def test_the_rate_is_without_the_first_call_and_earlier_steps(clock, capsys):
    """The first call compiles."""
    with Progress(100, "step", "run", done=10) as bar:
        clock[0] += 600
        bar.update(10)
        capsys.readouterr()

        clock[0] += 40
        bar.say("all well")
        bar.update(20)
        line = "iswarm: run: 40 of 100 steps,  2.00s/step, 02:00 left, all well\n"
        assert capsys.readouterr().err == line
    assert capsys.readouterr().err == ""


def test_quick_work_prints_nothing(monkeypatch, capsys):
    monkeypatch.setattr(progress, "PATIENCE", 600.0)
    with Progress(3, "step", waiting="compiling") as bar, waiting("placing"):
        bar.update(3)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "block", [lambda: waiting("placing 9 robots"), lambda: Progress(3, "step", waiting="placing")]
)
def test_a_long_preparation_is_explained(monkeypatch, capsys, block):
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    printed = ""
    with block():
        while "iswarm: placing" not in printed:
            printed += capsys.readouterr().err
