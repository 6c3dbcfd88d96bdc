"""Signals end a command at any moment, with their code, and what was recorded stays readable."""

import json
import signal
import time

import pytest
from helpers_rrd import read
from helpers_signals import ENDLESS, SMALL, start

from iswarm_mj.output.saved import load

SWALLOWED = """
import gc, time, iswarm_mj.workflows.clean as clean
def collect(*_):  # of what a callback of the collector raises, Python only tells
    print("collecting", flush=True)
    while True:
        pass
def advance(*_):
    gc.callbacks[:] = [collect]
    gc.collect()
    gc.callbacks.clear()
    time.sleep(600)
clean._advance = advance
"""


ANNOUNCED = """
import os, signal
from iswarm_mj.output import results
write = results.write_result
def announced(*given):
    results.write_result = write
    write(*given)
    os.kill(os.getpid(), signal.SIGTERM)
results.write_result = announced
"""


def ended(process, number=None):
    """The error output of a process that the signal ended, which it is sent, or sends itself as SIGTERM."""
    if number is None:
        number = signal.SIGTERM
    else:
        process.send_signal(number)
    error = process.communicate(timeout=300)[1]
    assert process.returncode == 128 + number, error
    assert error.splitlines()[-1].startswith("iswarm: interrupted") and "Trace" not in error
    return error


def check(out):
    """Result, trajectory and recording of the same interrupted run."""
    content = json.loads((out / "result.json").read_text())
    frames = load(out).arrays
    assert content["interrupted"] and frames["step"][-1] == content["steps"]
    assert frames["delivered"][-1] == content["delivered"] and frames["collisions"][-1] == content["collisions"]
    assert read(out / "clean.rrd")["/world/robots/body"]["step"] == frames["step"].tolist()
    assert {path.name for path in out.iterdir()} == {"clean.rrd", "result.json", "trajectory.npz"}
    return content


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, *(pytest.param(n, marks=pytest.mark.slow) for n in (signal.SIGINT, signal.SIGHUP))]
)
def test_in_the_middle_of_a_run(tmp_path, number):
    old = tmp_path / "trajectory.npz"
    old.write_text("of an earlier run")
    with start("clean", *ENDLESS, "--seed", 5, "--out", tmp_path) as process:
        recording = tmp_path / "clean.rrd"
        while process.poll() is None and (not recording.exists() or recording.stat().st_size < 300_000):
            time.sleep(0.02)
        ended(process, number)
    assert check(tmp_path)["steps"] >= 63  # a block of frames is the start and these


LOADING = """
import sys, time
class Loader:  # of a library that makes an ImportError of whatever happens while it is loaded
    def find_spec(self, name, *_):
        if name == "mujoco":
            try:
                print("loading", flush=True)
                time.sleep(1)
            except BaseException as error:
                raise ImportError("initialization failed") from error
sys.meta_path.insert(0, Loader())
"""


def test_where_a_library_is_loaded_they_wait(tmp_path):
    with start("clean", *SMALL, "--out", tmp_path, before=LOADING) as process:
        assert process.stdout.readline() == "loading\n"
        ended(process, signal.SIGTERM)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_where_python_only_reports_it(tmp_path):
    with start("clean", *SMALL, "--seed", 5, "--out", tmp_path, before=SWALLOWED) as process:
        assert process.stdout.readline() == "collecting\n"
        ended(process, signal.SIGTERM)
    assert check(tmp_path)["steps"] == 0


@pytest.mark.slow
def test_between_the_announcement_and_the_recording(tmp_path):
    with start("clean", *SMALL, "--out", tmp_path, before=ANNOUNCED) as process:
        ended(process)
    assert check(tmp_path)["steps"] == 0
