"""Random command lines over every flag: each succeeds, or exits with code 2 and one sentence.

They run in this process up to where physics, pictures or workers would start; a few go on to the
end.
"""

import contextlib
import io
import re

import numpy as np
import pytest
from hypothesis import event
from support.attacks import attack, pick
from support.cli import WALK, code_of
from support.recorded import write_run
from support.small import FLAGS

from iswarm_mj.commands.command_settings import settings
from iswarm_mj.commands.flags import flag
from iswarm_mj.commands.main import COMMANDS
from iswarm_mj.engines.robot_file import models_directory
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.utils.constraints import choices

STARTS = [
    "iswarm_mj.simulation.run.build_loop",
    "iswarm_mj.search.pool.run_jobs",
    "iswarm_mj.gripper.bench.run_trials.run_trials",
    "iswarm_mj.gripper.bench.force_curve.force_curve",
    "iswarm_mj.output.offscreen.ArenaRenderer",
    "iswarm_mj.player.video.Painter",
    "iswarm_mj.commands.cache.remove",
]
"""Functions and classes by which physics, pictures or workers would start, or the cache would be
emptied."""
REFUSAL = re.compile(r"(iswarm: (placing|preparing) [^\n]+\n)*iswarm: [^\n]+\n")
"""One sentence, perhaps after what was prepared."""
OUTCOMES = {None: "accepted", 0: "answered", 1: "fault", 2: "refused"}
"""Outcomes by the exit code; None where physics, pictures or workers would start."""
NUMBERS = [
    "0", "1", "-1", "2", "10", "48", "100", "1000", "0.1", "0.999", "1.5", "89.9", "180", "1e-320",
    "1e300", "-0.0", "nan", "-inf", "1e999", "4294967295", "9223372036854775808", "1_000", "0x10",
    "١٢", "+3", ".5", "1,5", "9" * 5000,
]  # fmt: skip
TEXTS = [
    "", " ", "a\nb", "🤖", "\udcff", "None", "True", "--", "-", "-h", "=", "a" * 300,
    "\x1b[31m" * 900, "../..", "*", "/dev/full", "/proc/self/nothing", "%s%n", "[1,2]",
    "runs/clean", "runs/none", "genome.json", "odd.json", "walk.py", "walk.py:Walk", "walk.py:",
    ":Walk", "robot6.xml", "odd.xml", "results", "new/deep", "a.html", "a.mp4", "loop",
    "genome.json/below", "type2", "density", "time-step", "evolve-paper", "odd.toml",
    "runs/clean/result.json",
]  # fmt: skip
LONGEST_NUMBER = 3
"""Digits of numbers of robots, worlds or steps with which runs are quick."""


class Reached(BaseException):
    """The command line was accepted."""


def reach(*_, **__):
    """Take the place of what would start."""
    raise Reached


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A working directory with files of all kinds that command lines name."""
    monkeypatch.chdir(tmp_path)
    run = tmp_path / "runs" / "clean"
    run.mkdir(parents=True)
    write_run(run)
    (tmp_path / "results").mkdir()
    (tmp_path / "genome.json").write_text('{"p_vector_forget": 0.3}')
    (tmp_path / "odd.json").write_text('{"p_vector_forget": NaN}')
    (tmp_path / "odd.toml").write_text('steps = 3\n[arena]\nsize = "x"\nn-dust = [3, true]')
    (tmp_path / "walk.py").write_text(WALK)
    (tmp_path / "robot6.xml").write_bytes((models_directory() / "robot6.xml").read_bytes())
    (tmp_path / "odd.xml").write_text("<mujoco><worldbody/></mujoco>")
    (tmp_path / "loop").symlink_to("loop")
    return tmp_path


# How a command line is drawn.


def drawn_flag(rng, setting):
    """Return the arguments of the flag of a setting, with a value that it may take, or may not."""
    default = setting.value
    word = flag(setting.name)
    luck = rng.random()
    if isinstance(default, bool) and luck < 0.9:
        negated = re.sub(r"^--(.*\.)?", r"--\g<1>no-", word)
        return [word if luck < 0.5 else negated]
    if luck < 0.02:
        misspelt = [word[:-1], word.replace("-", "_"), word.replace(".", "-")]
        word = pick(rng, misspelt)

    near = [str(default), *choices(type(setting.owner), setting.field)]
    if isinstance(default, int | float):
        near += [str(default * factor) for factor in (0.5, 2, -1)]
    if rng.random() < 0.5:
        pool = near
    elif luck < 0.8:
        pool = NUMBERS
    else:
        pool = TEXTS
    values = [pick(rng, pool)]
    further_values = [pick(rng, NUMBERS) for _ in range(rng.integers(3))]
    if isinstance(default, tuple):
        values += further_values
    if len(values) == 1 and luck < 0.5:
        return [f"{word}={values[0]}"]
    return [word, *values]


def drawn_flags(rng, name):
    """Return a few flags of a command, perhaps with a file of settings or a stray word."""
    command = COMMANDS[name]()
    known = list(settings(command))
    if hasattr(command, "strategy_plugin"):
        known += settings(TYPE1)
    line = []
    for _ in range(rng.integers(6)):
        line += drawn_flag(rng, pick(rng, known))
    config = pick(rng, TEXTS)
    if rng.random() < 0.1:
        line += ["--config", config]
    stray = pick(rng, TEXTS)
    if rng.random() < 0.1:
        line.append(stray)
    return line


def drawn_line(rng):
    """Return the arguments of a command line."""
    name = pick(rng, list(COMMANDS))
    if rng.random() < 0.01:
        no_command = [*TEXTS, name[:-1], "--version", "--help", "--tyro-print-completion"]
        return [pick(rng, no_command), "--seed=1"]
    return [name, *drawn_flags(rng, name)]


def outcome_of(line):
    """Run a command line in this process; return which of `OUTCOMES` it has.

    Raises:
        AssertionError: it has none, or prints a traceback, or more than a sentence.
    """
    error = io.StringIO()
    code = None
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(error),
        contextlib.suppress(Reached),
    ):
        code = code_of(*line)
    printed = error.getvalue()
    assert "Traceback" not in printed
    assert "\x1b" not in printed
    assert len(printed) < 5000
    assert code in OUTCOMES, (code, printed)
    if code:
        assert REFUSAL.fullmatch(printed), (code, printed)
    return OUTCOMES[code]


@attack(30)
def test_each_is_done_or_refused(place, seed):
    line = drawn_line(np.random.default_rng(seed))
    with pytest.MonkeyPatch.context() as patch:
        for name in STARTS:
            patch.setattr(name, reach)
        outcome = outcome_of(line)
    event(outcome)
    assert outcome != "fault", line


def takes_long(line):
    """Return whether a command line has a number of robots, worlds or steps that is large."""
    parts = [part for argument in line for part in argument.split("=")]
    return any(len(part) > LONGEST_NUMBER and part.isdigit() for part in parts)


@attack(2)
def test_what_is_accepted_runs(place, seed):
    """It runs to its end, or to a fault in a sentence; what it records is finite."""
    rng = np.random.default_rng(seed)
    name = pick(rng, ["clean", "clean", "bench"])
    engine = pick(rng, ["mujoco", "planar"])
    flags = drawn_flags(rng, name)
    names = {argument.partition("=")[0] for argument in flags}
    line = [name]
    for small in ("--steps=2", "--robots=9", "--threads=1", f"--engine={engine}", *FLAGS):
        if small.partition("=")[0] not in names:
            line.append(small)
    line += flags
    if takes_long(line):
        return

    outcome = outcome_of(line)
    event(outcome)
    written = place / "runs" / "clean" / "trajectory.npz"
    if outcome == "answered" and name == "clean" and written.exists():
        with np.load(written) as file:
            for array in ("pose", "ball_position", "mean_speed"):
                assert np.isfinite(file[array]).all(), line
