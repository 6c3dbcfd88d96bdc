"""Commands that write files, in processes of their own, and what they may leave behind."""

import io
import json
import os
import shutil
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
import pyarrow.parquet as pq
from PIL import Image

from iswarm_mj import load
from iswarm_mj.utils.directory_lock import locked
from support.recorded import write_run
from support.small import FLAGS

ROOT = Path(__file__).parents[2]
"""Root of the repository."""
ARENA = " ".join(FLAGS)
"""Flags of the small arena."""
RUN_FILES = ("result.json", "trajectory.npz", "clean.rrd")
"""Files of a run of cleaning."""
ENDLESS = "--steps=100000 --gripper.release-voltage=3"
"""Flags of a run that takes long, as no ball is ever released at this voltage."""


class Writing(NamedTuple):
    """Arguments of a command that writes; `{out}` is its directory, and `{run}` that of a run."""

    common: str
    """Arguments of both forms."""
    short: str
    """Further arguments with which it takes some seconds."""
    long: str
    """Further arguments with which it takes minutes."""


COMMANDS = {
    "clean": Writing(
        f"clean {ARENA} --threads=1 --robots=30 --engine=planar --worlds=2"
        " --record-worlds 0 1 --out={out}",
        short="--steps=70",
        long=ENDLESS,
    ),
    "evolve": Writing(
        f"evolve {ARENA} --population=4 --engine=planar --out={{out}}",
        short="--generations=2 --steps=5 --workers=1",
        long="--generations=100 --steps=50 --workers=2",
    ),
    "train": Writing(
        f"train {ARENA} --population=4 --worlds=1 --robots=4 --threads=1 --out={{out}}",
        short="--generations=2 --steps=5",
        long="--generations=1000 --steps=50",
    ),
    "grasp": Writing(
        "grasp --threads=1 --out={out}",
        short="--radius=2e-5 --rh=10 --repeats=2",
        long="--repeats=100",
    ),
    "picture": Writing(
        "picture {run} --width=64 --height=64 --out={out}/a.png",
        short="--step=1",
        long="--step=2",
    ),
    "video": Writing(
        "video {run} --width=64 --height=64 --out={out}/a.mp4",
        short="--last=2",
        long="--frames-per-step=24 --speed=2",
    ),
    "report": Writing(
        "report --out={out}/a.html",
        short=f"--results {ROOT}/results/default/hop-count",
        long=f"--results {ROOT}/results",
    ),
}
"""Commands that write, by their names."""

_HEED_SIGNALS = """
import signal
for number in (1, 2, 15):
    signal.signal(number, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
"""
"""Python code after which signals are heeded that this process ignores."""
_MAIN = """
import sys
from iswarm_mj.__main__ import main
main()
"""
"""Python code that runs a command."""


def started(arguments, before="", **environment):
    """Start a command, in a session of processes of its own.

    Args:
        arguments: arguments of the command, as one text.
        before: Python code that runs before the command.
        environment: further variables of the environment.
    """
    code = f"{_HEED_SIGNALS}\n{before}\n{_MAIN}"
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments.split()],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"} | environment,
        start_new_session=True,
    )


def started_long(name, out, run="", before=""):
    """Start one of `COMMANDS` that takes minutes; see `started`."""
    command = COMMANDS[name]
    return started(f"{command.common} {command.long}".format(out=out, run=run), before)


def started_short(name, out, run, **environment):
    """Start one of `COMMANDS` that takes seconds; see `started`."""
    command = COMMANDS[name]
    return started(f"{command.common} {command.short}".format(out=out, run=run), **environment)


class EarlierRun:
    """A complete run whose files are there before a command begins.

    Attributes:
        path: directory of the run.
        files: contents of its files by their names.
    """

    def __init__(self, path):
        """Write the run."""
        self.path = write_run(path)
        (path / "clean.rrd").write_bytes(b"RRF2")
        self.files = {name: (path / name).read_bytes() for name in RUN_FILES}

    def prepare(self, out, name):
        """Make an empty directory for a command, or for `clean` one with the files of this run."""
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        if name == "clean":
            for file, content in self.files.items():
                (out / file).write_bytes(content)

    def assert_unmixed(self, out):
        """Assert that all files in a directory are of this run, or none of them is."""
        there = {name: (out / name).read_bytes() for name in RUN_FILES if (out / name).exists()}
        if there.get("result.json") == self.files["result.json"]:
            assert there == self.files
        elif "result.json" in there:
            assert not any(content == self.files[name] for name, content in there.items())
            if "trajectory.npz" in there:
                load(out)


def assert_whole(out):
    """Assert that each file in a directory has its whole content, and that the directory is free.

    Names with a dot in front are those of parts of files.
    """
    for path in out.rglob("*"):
        is_part = path.name.startswith(".")
        is_new_journal = path.suffix == ".sqlite" and path.stat().st_size == 0
        if path.is_file() and not is_part and not is_new_journal:
            _assert_whole_file(path)
    with locked(out):
        pass


def _assert_whole_file(path):
    """Assert that a file can be read to its end."""
    content = path.read_bytes()
    match path.suffix:
        case ".json":
            json.loads(content)
        case ".parquet":
            pq.read_table(io.BytesIO(content))
        case ".npz":
            dict(np.load(io.BytesIO(content)))
        case ".png":
            Image.open(io.BytesIO(content)).load()
        case ".svg" | ".html":
            assert content.rstrip().endswith((b"</svg>", b"</html>")), path
        case ".csv":
            assert content.endswith(b"\n"), path
        case ".mp4":
            assert b"moov" in content


def has_begun(error):
    """Return whether Python itself had begun when a signal ended a process, by what it printed."""
    return "Fatal Python error: init_" not in error


def assert_ended_by(process, number, error):
    """Assert that a process succeeded, or ended by a signal: at once, or with a sentence.

    Args:
        process: process that has ended.
        number: number of the signal.
        error: what the process printed.
    """
    code = process.returncode
    about = (process.args, code, error)
    assert code in (0, -number, 128 + number), about
    if code > 0:
        assert "Traceback" not in error, about
        assert "interrupted" in error, about


def assert_nothing_runs_on(process):
    """Assert that all processes of the session of a process end within a minute."""
    end = time.monotonic() + 60
    while _runs_on(process):
        assert time.monotonic() < end, "processes are left"
        time.sleep(0.1)


def _runs_on(process):
    """Return whether there is a process in the session of a process."""
    sessions = set()
    for pid in psutil.pids():
        with suppress(ProcessLookupError):  # it may have ended meanwhile
            sessions.add(os.getsid(pid))
    return process.pid in sessions
