"""Command lines over every flag of every command: each is done, or refused with exit code 2,
without a traceback.

They run in this process up to where physics, pictures or workers would start; a few go on to the
end.
"""

import contextlib
import io
import os
import re

import numpy as np
import pytest
from hypothesis import event
from support.attacks import attack, pick
from support.cli import SMALL, WALK, code_of
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
    "iswarm_mj.output.video.ArenaRenderer",
]
"""Where physics, pictures or workers would start."""
REFUSAL = re.compile(r"(iswarm: (placing|preparing) [^\n]+\n)*iswarm: [^\n]+\n")
"""One sentence."""
NUMBERS = [
    "0", "1", "-1", "2", "10", "48", "100", "1000", "0.1", "0.999", "1.5", "89.9", "180", "1e-320", "1e300", "-0.0",
    "nan", "-inf", "1e999", "4294967295", "9223372036854775808", "1_000", "0x10", "١٢", "+3", ".5", "1,5", "9" * 5000,
]  # fmt: skip
TEXTS = [
    "", " ", "a\nb", "🤖", "\udcff", "None", "True", "--", "-", "-h", "=", "a" * 300, "\x1b[31m" * 900, "../..", "*",
    "/dev/full", "/proc/self/nothing", "%s%n", "[1,2]", "runs/clean", "runs/none", "genome.json", "odd.json", "walk.py",
    "walk.py:Walk", "walk.py:", ":Walk", "robot6.xml", "odd.xml", "results", "new/deep", "a.html", "a.mp4", "loop",
    "genome.json/below", "type2", "density", "time-step", "evolve-paper", "odd.toml", "runs/clean/result.json",
]  # fmt: skip


class Reached(BaseException):
    """The command line was accepted."""


def reach(*_, **__):
    raise Reached


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A working directory with files of all kinds that command lines name."""
    monkeypatch.chdir(tmp_path)
    for name in ("runs/clean", "results"):
        (tmp_path / name).mkdir(parents=True)
    write_run(tmp_path / "runs" / "clean")
    (tmp_path / "genome.json").write_text('{"p_vector_forget": 0.3}')
    (tmp_path / "odd.json").write_text('{"p_vector_forget": NaN}')
    (tmp_path / "odd.toml").write_text('steps = 3\n[arena]\nsize = "x"\nn-dust = [3, true]')
    (tmp_path / "walk.py").write_text(WALK)
    (tmp_path / "robot6.xml").write_bytes((models_directory() / "robot6.xml").read_bytes())
    (tmp_path / "odd.xml").write_text("<mujoco><worldbody/></mujoco>")
    (tmp_path / "loop").symlink_to("loop")
    return tmp_path


def given(rng, name, default, owner, part):
    """A flag with a value that it may take, or that it may not."""
    word, luck = flag(name), rng.random()
    if isinstance(default, bool) and luck < 0.9:
        return [
            word if luck < 0.5 else re.sub(r"^--(.*\.)?", r"--\g<1>no-", word).replace("None", "")
        ]
    if luck < 0.02:
        word = pick(rng, [word[:-1], word.replace("-", "_"), word.replace(".", "-")])
    words = choices(type(owner), part)
    near = [
        str(default),
        *words,
        *(str(default * k) for k in (0.5, 2, -1) if isinstance(default, int | float)),
    ]
    values = [pick(rng, near if rng.random() < 0.5 else NUMBERS if luck < 0.8 else TEXTS)]
    values += [pick(rng, NUMBERS) for _ in range(rng.integers(3))] * isinstance(default, tuple)
    return [f"{word}={values[0]}"] if len(values) == 1 and luck < 0.5 else [word, *values]


def command_line(rng, name=None):
    """Arguments of a command."""
    name = pick(rng, list(COMMANDS)) if name is None else name
    if rng.random() < 0.01:
        return [
            pick(rng, [*TEXTS, name[:-1], "--version", "--help", "--tyro-print-completion"]),
            "--seed=1",
        ]
    command = COMMANDS[name]()
    known = [*settings(command), *(settings(TYPE1) if hasattr(command, "own") else ())]
    line = [word for _ in range(rng.integers(6)) for word in given(rng, *pick(rng, known))]
    line += ["--config", pick(rng, TEXTS)] * (rng.random() < 0.1) + [pick(rng, TEXTS)] * (
        rng.random() < 0.1
    )
    return [name, *line]


def answer(line):
    """What became of a command line in this process, or an AssertionError."""
    out, error, code = io.StringIO(), io.StringIO(), None
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(error),
        contextlib.suppress(Reached),
    ):
        code = code_of(*line)
    said = error.getvalue()
    assert "Traceback" not in said and "\x1b" not in said and len(said) < 5000, said
    assert code in (None, 0, 1, 2) and (code in (None, 0) or REFUSAL.fullmatch(said)), (code, said)
    return {None: "accepted", 0: "answered", 1: "fault", 2: "refused"}[code]


@attack(30)
def test_each_is_done_or_refused(place, seed):
    line = command_line(np.random.default_rng(seed))
    with pytest.MonkeyPatch.context() as patch:
        for name in STARTS:
            patch.setattr(name, reach)
        outcome = answer(line)
    event(outcome)
    assert outcome != "fault", line


@attack(2)
def test_what_is_accepted_runs(place, seed):
    """To its end, or to a fault in a sentence; what it records is finite."""
    rng = np.random.default_rng(seed)
    name, engine = pick(rng, ["clean", "clean", "bench"]), pick(rng, ["mujoco", "planar"])
    more = command_line(rng, name)[1:]
    named = {word.partition("=")[0] for word in more}
    few = ["--steps=2", "--robots=9", "--threads=1", f"--engine={engine}", *FLAGS]
    line = [name, *(word for word in few if word.partition("=")[0] not in named), *more]
    if any(len(part) > 3 and part.isdigit() for word in line for part in word.split("=")):
        return  # many robots, worlds or steps
    written = place / "runs" / "clean" / "trajectory.npz"
    event(outcome := answer(line))
    if outcome == "answered" and name == "clean" and written.exists():
        with np.load(written) as file:
            assert all(
                np.isfinite(file[one]).all() for one in ("pose", "ball_position", "mean_speed")
            ), line


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_output_to_a_full_disk(tmp_path):
    error = io.StringIO()
    with (
        open("/dev/full", "w") as full,
        contextlib.redirect_stdout(full),
        contextlib.redirect_stderr(error),
    ):
        assert code_of("clean", *SMALL, "--steps=2", f"--out={tmp_path}") == 2
    assert "No space left on device" in error.getvalue() and (tmp_path / "result.json").exists()
