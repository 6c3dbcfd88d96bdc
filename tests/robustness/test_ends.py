"""Commands that signals end at any moment: with their exit code, nothing left running, files whole.

test_full_disk.py has those that a full disk ends.
"""

import json
import signal
import subprocess
import time
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import event
from support.attacks import attack, pick
from support.long_commands import (
    ARENA,
    COMMANDS,
    ENDLESS,
    RUN_FILES,
    assert_ended_by,
    assert_nothing_runs_on,
    assert_whole,
    has_begun,
    started,
    started_long,
)
from support.rrd import read

from iswarm_mj import load

SIGNALS = [signal.SIGTERM, signal.SIGINT, signal.SIGHUP]
"""Signals that end a command with a sentence."""
ALL_LONG = {
    "clean": f"clean {ARENA} --robots=30 {ENDLESS} --engine={{engine}} --out={{out}}",
    "run": f"run --task=foraging {ARENA} --robots=30 --steps=100000"
    " --engine={engine} --out={out}",
    "evolve": f"evolve {ARENA} --population=4 --steps=50 {{workers}}"
    " --engine={engine} --out={out}",
    "train": f"train {ARENA} --population=4 --worlds=1 --robots=4 --generations=1000"
    " --engine={engine} --out={out}",
    "sweep": f"sweep {ARENA} --over=robots=5,10,20,25 --steps=100000"
    " --engine={engine} --out={out}",
    "experiment": "experiment density {workers} --engine={engine} --out={out}",
    "bench": f"bench {ARENA} --robots=30 --steps=100000 --engine={{engine}}",
    "play": f"play {ARENA} --no-open --robots=30 --engine={{engine}} --out={{out}}",
    "grasp": "grasp --repeats=1000 --out={out}",
    "video": "video {run} --frames-per-step=24 --speed=2 --out={out}/a.mp4",
    "replay": "replay {run} --frames-per-step=24 --out={out}/a.html",
}
"""Arguments of commands that run for long, most of which compile first."""


def wait_for_end(process, number):
    """Wait for a process that a signal has ended, and assert that it says so."""
    error = process.communicate(timeout=300)[1]
    assert process.returncode == 128 + number, error
    assert error.splitlines()[-1].startswith("iswarm: interrupted")
    assert "Trace" not in error


def end_with(process, number):
    """Send a signal to a process, and wait for its end."""
    process.send_signal(number)
    wait_for_end(process, number)


def interrupted_step(out):
    """Return the last step of an interrupted run of which all files are."""
    content = json.loads((out / "result.json").read_text())
    frames = load(out).arrays
    assert content["interrupted"]
    assert frames["step"][-1] == content["steps"]
    for name in ("delivered", "collisions"):
        assert frames[name][-1] == content[name][0]
    assert read(out / "clean.rrd")["/world/robots/body"]["step"] == frames["step"].tolist()
    assert {path.name for path in out.iterdir()} == {*RUN_FILES, "world-1"}
    return content["steps"]


# At certain moments.


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGTERM,
        pytest.param(signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
    ],
)
def test_a_signal_in_the_middle_of_a_run(tmp_path, number):
    (tmp_path / "trajectory.npz").write_text("of an earlier run")
    recording = tmp_path / "clean.rrd"
    with started_long("clean", tmp_path) as process:
        # A block of frames has been written.
        while process.poll() is None:
            if recording.exists() and recording.stat().st_size >= 300_000:
                break
            time.sleep(0.02)
        end_with(process, number)
    assert interrupted_step(tmp_path) >= 63  # the start and these make a block


LOADING = """
import sys, time
class Loader:  # of a library that makes an ImportError of whatever happens while it is loaded
    def find_spec(self, name, *_):
        if name == "mujoco":
            try:
                print("now", flush=True)
                time.sleep(1)
            except BaseException as error:
                raise ImportError("initialization failed") from error
sys.meta_path.insert(0, Loader())
"""
"""Code that lets a library load slowly, and hide the exception of a signal."""
SWALLOWED = """
import gc, time
from iswarm_mj.simulation.run import Run
def collect(*_):  # of what a callback of the collector raises, Python only tells
    print("now", flush=True)
    while True:
        pass
def advance(*_):
    gc.callbacks[:] = [collect]
    gc.collect()
    gc.callbacks.clear()
    time.sleep(600)
Run.advance = advance
"""
"""Code that lets a control step be where Python reports an exception and goes on."""
ANNOUNCED = """
import os, signal
from iswarm_mj.output import results
write = results.write_result
def announced(*arguments):
    results.write_result = write
    write(*arguments)
    os.kill(os.getpid(), signal.SIGTERM)
results.write_result = announced
"""
"""Code that sends SIGTERM once result.json has announced the run, before it is recorded."""


def test_a_signal_while_a_library_is_loaded(tmp_path):
    with started_long("clean", tmp_path, before=LOADING) as process:
        assert process.stdout.readline() == "now\n"
        end_with(process, signal.SIGTERM)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_signal_where_python_only_reports_an_exception(tmp_path):
    with started_long("clean", tmp_path, before=SWALLOWED) as process:
        assert process.stdout.readline() == "now\n"
        end_with(process, signal.SIGTERM)
    assert interrupted_step(tmp_path) == 0


@pytest.mark.slow
def test_a_signal_between_the_announcement_and_the_recording(tmp_path):
    with started_long("clean", tmp_path, before=ANNOUNCED) as process:
        wait_for_end(process, signal.SIGTERM)
    assert interrupted_step(tmp_path) == 0


# At any moment.


def run_until(process, seconds):
    """Let a process run for some seconds, or to its end."""
    with suppress(subprocess.TimeoutExpired):
        process.communicate(timeout=seconds)


@pytest.mark.slow
@attack(3)
def test_signals_at_any_moment(earlier, tmp_path, seed):
    rng = np.random.default_rng(seed)
    out = tmp_path / "out"
    name = pick(rng, list(COMMANDS))
    number = pick(rng, [signal.SIGKILL, *SIGNALS])
    moment = 12 * rng.random() ** 2
    earlier.prepare(out, name)
    with started_long(name, out, earlier.path) as process:
        run_until(process, moment)
        process.send_signal(number)
        error = process.communicate(timeout=200)[1]
    event(f"{name}, {number.name}: {process.returncode}")

    if has_begun(error):
        assert_ended_by(process, number, error)
        assert_nothing_runs_on(process)
        assert_whole(out)
        if name == "clean":
            earlier.assert_unmixed(out)


@pytest.mark.slow
@attack(6)
def test_signals_while_programs_are_compiled_and_run(earlier, tmp_path_factory, seed):
    """The cache on disk has all compiled programs, or none."""
    rng = np.random.default_rng(seed)
    out = tmp_path_factory.mktemp("out")
    name = pick(rng, list(ALL_LONG))
    engine = pick(rng, ["planar", "mujoco", "mjx"])
    number = pick(rng, SIGNALS)
    has_cache = bool(rng.integers(2))
    moment = (12 if has_cache else 30) * rng.random()

    caches = {} if has_cache else {"XDG_CACHE_HOME": str(tmp_path_factory.mktemp("cache"))}
    workers = "" if engine == "mjx" else "--workers=2"
    arguments = ALL_LONG[name].format(out=out, run=earlier.path, engine=engine, workers=workers)
    with started(arguments, **caches) as process:
        run_until(process, moment)
        process.send_signal(number)
        try:
            # It takes at most 5 s, and longer on machines with other work.
            error = process.communicate(timeout=60)[1]
        finally:
            process.kill()
    event(f"{name}, {engine}: {process.returncode}")

    if has_begun(error):
        assert_ended_by(process, number, error)
        assert_nothing_runs_on(process)
        assert_whole(out)
