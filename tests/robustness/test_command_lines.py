"""Command lines over every flag of every command: each is done, or refused in a sentence with exit code 2.

They run in this process up to where physics, pictures or workers would start; a share of those of `clean` and `bench`
goes on to the end, and some are started as a process of their own.
"""

import contextlib
import io
import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
from helpers_command_lines import COMMANDS, WALK, command_line, flags_of
from helpers_recorded import write_run
from helpers_small import FLAGS

from iswarm_mj.commands import main as cli
from iswarm_mj.engines.robot_file import models_directory

STARTS = [
    "iswarm_mj.simulation.run.start_loop",
    "iswarm_mj.experiments.runner.pool.run_jobs",
    "iswarm_mj.workflows.grasp.run_trials",
    "iswarm_mj.workflows.grasp.force_curve",
    "iswarm_mj.workflows.benchmark_grasp.speed",
    "iswarm_mj.output.render.Stage",
    "iswarm_mj.output.video.Stage",
    "iswarm_mj.workflows.shares.connected",
]
"""Where physics, pictures, workers or other machines would start."""
REFUSAL = re.compile(r"iswarm: [^\n]+\n")
BOX = re.compile(r"For full helptext, (see|run) iswarm( [a-z]+)? --help\b")
"""Of what the parser says of words that it cannot read."""


class Reached(BaseException):
    """The command line was accepted."""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A working directory with files of all kinds that command lines name."""
    monkeypatch.chdir(tmp_path)
    write_run(_made(tmp_path / "runs" / "clean"))
    _made(tmp_path / "empty"), _made(tmp_path / "results")
    (tmp_path / "genome.json").write_text('{"p_vector_forget": 0.3}')
    (tmp_path / "odd.json").write_text('{"p_vector_forget": NaN}')
    (tmp_path / "walk.py").write_text(WALK)
    (tmp_path / "robot6.xml").write_bytes((models_directory() / "robot6.xml").read_bytes())
    (tmp_path / "odd.xml").write_text("<mujoco><worldbody/></mujoco>")
    (tmp_path / "loop").symlink_to("loop")
    return tmp_path


def _made(path):
    path.mkdir(parents=True)
    return path


def reach(*_, **__):
    raise Reached


def answer(line):
    """Exit code and error output of a command line in this process; None where physics would start."""
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            cli.main(line)
            code = 0
        except SystemExit as end:
            code = end.code
        except Reached:
            code = None
    return code, out.getvalue(), error.getvalue()


def check(code, out, error):
    """What became of a command line, or an AssertionError."""
    assert "Traceback" not in error
    if code is None:
        return "accepted"
    if code == 2:
        last = error.splitlines(keepends=True)[-1:]  # those before tell how far it came
        assert REFUSAL.fullmatch("".join(last)) or BOX.search(error), error
        return "refused"
    assert code == 0 and (out or error), (code, error)
    return "answered"


@pytest.mark.attack(60)
def test_each_is_done_or_refused(attack, place, monkeypatch):
    for name in STARTS:
        monkeypatch.setattr(name, reach)
    names = list(COMMANDS)
    for number, rng in enumerate(attack.generators()):
        line = command_line(rng, names[number] if number < len(names) else None)
        with attack.case(line) as outcome:
            outcome.append(check(*answer(line)))


def test_there_are_lines_with_every_flag():
    """Of each command; nothing is left out where a parser changes."""
    for name in COMMANDS:
        flags = flags_of(name)
        lines = [command_line(np.random.default_rng([1, n]), name) for n in range(40 * len(flags))]
        given = {word.partition("=")[0] for line in lines for word in line}
        assert {option for flag in flags for option in flag.names if option != "--help"} <= given


def for_real(rng):
    """A run of two steps in a small arena, with some flags of any value."""
    name = ["clean", "bench"][rng.integers(4) // 3]
    more = command_line(rng, name)[1:]
    few = ["--steps=2", "--robots=9", f"--engine={['mujoco', 'planar'][rng.integers(2)]}", "--threads=1", *FLAGS]
    given = {word.partition("=")[0] for word in more}
    return [name, *(word for word in few if word.partition("=")[0] not in given), *more]


def finite(out):
    """Whether all that a run recorded is."""
    with np.load(out / "trajectory.npz") as file:
        assert all(np.isfinite(file[name]).all() for name in ("pose", "ball_position", "mean_speed") if name in file)


@pytest.mark.attack(30)
def test_what_is_accepted_runs(attack, place):
    """To its end, or to a fault in a sentence; what it records is finite."""
    for rng in attack.generators():
        line = for_real(rng)
        if any(huge(word) for word in line):
            continue
        with attack.case(line, 600) as outcome:
            code, out, error = answer(line)
            if code == 1:
                assert REFUSAL.search(error), error
                outcome.append("fault")
                continue
            outcome.append(check(code, out, error))
            written = place / "runs" / "clean" / "trajectory.npz"
            if code == 0 and line[0] == "clean" and written.exists():
                finite(written.parent)


def huge(word):
    """Whether a run of it would take long: many robots, worlds or steps."""
    return any(len(part) > 3 and part.isdigit() for part in word.split("="))


ENOUGH_S = 20
"""What a process runs that long was accepted."""


@pytest.mark.attack(20)
def test_as_a_process(attack, place):
    """With the interpreter's own handling of what nobody catches, and of text that is none."""
    for rng in attack.generators():
        line = for_real(rng) if rng.random() < 0.5 else command_line(rng)
        if any(huge(word) or "\0" in word or len(word) > 1000 for word in line) or line[0] == "reproduce":
            continue
        with attack.case(line) as outcome:
            words = [sys.executable, "-m", "iswarm_mj", *(os.fsencode(word) for word in line)]
            pipe = subprocess.PIPE
            process = subprocess.Popen(words, stdout=pipe, stderr=pipe, start_new_session=True)
            try:
                error = process.communicate(timeout=ENOUGH_S)[1].decode(errors="surrogateescape")
            except subprocess.TimeoutExpired:  # hundreds of runs, perhaps, by its own processes
                os.killpg(process.pid, signal.SIGKILL)
                process.communicate()
                outcome.append("accepted")
                continue
            assert "Traceback" not in error and process.returncode in (0, 1, 2), error
            assert process.returncode == 0 or REFUSAL.search(error) or BOX.search(error), error
            outcome.append({0: "answered", 1: "fault", 2: "refused"}[process.returncode])
