"""Commands that write, as processes that are ended or refused in the middle, and what they may leave behind."""

import io
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from helpers_signals import ENDLESS, SMALL, start
from helpers_small import FLAGS
from PIL import Image

from iswarm_mj import load
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.lock import locked

FEW = ["--generations=2", "--population=3", "--steps=5", "--workers=1", "--engine=planar", *FLAGS]
ROOT = Path(__file__).parents[2]

WRITING = {
    "clean": lambda out, _: ["clean", *SMALL, "--steps=70", "--engine=planar", f"--out={out}"],
    "clean worlds": lambda out, _: [
        "clean", *FLAGS, "--robots=9", "--steps=3", "--worlds=3", "--record-worlds", "0", "2", "--threads=1",
        f"--out={out}",
    ],
    "evolve": lambda out, _: ["evolve", *FEW, f"--out={out}"],
    "train": lambda out, _: [
        "train", "--generations=2", "--population=3", "--worlds=1", "--steps=5", "--robots=4", "--threads=1", *FLAGS,
        f"--out={out}",
    ],
    "grasp": lambda out, _: ["grasp", "--radius=2e-5", "--rh=10", "--repeats=2", "--threads=1", f"--out={out}"],
    "picture": lambda out, run: ["picture", str(run), "--step=1", "--width=64", "--height=64", f"--out={out}/a.png"],
    "video": lambda out, run: [
        "video", str(run), "--steps=2", "--width=64", "--height=64", f"--out={out}/a.mp4",
    ],
    "report": lambda out, _: ["report", "--results", str(ROOT / "results" / "hop-count"), f"--out={out}/a.html"],
}  # fmt: skip
"""Short commands that write all that they ever write; of the directory to write into, and of a recorded run."""

LONG = {
    "clean": lambda out, _: ["clean", *ENDLESS, f"--out={out}"],
    "clean planar": lambda out, _: [
        "clean", *ENDLESS, "--worlds=4", "--record-worlds", "1", "3", "--engine=planar", f"--out={out}",
    ],
    "bench": lambda out, _: ["bench", *ENDLESS, "--engine=planar"],
    "evolve": lambda out, _: [
        "evolve", "--generations=100", "--population=4", "--steps=50", "--engine=planar", "--workers=2", *FLAGS,
        f"--out={out}",
    ],
    "train": lambda out, _: [
        "train", "--generations=1000", "--population=4", "--worlds=1", "--steps=50", "--robots=4", *FLAGS,
        f"--out={out}",
    ],
    "experiment": lambda out, _: [
        "experiment", "hop-count", "--engine=planar", "--workers=2", *FLAGS, "--quick", f"--out={out}",
    ],
    "reproduce": lambda out, _: ["reproduce", "--quick", "--engine=planar", "--workers=2", f"--out={out}"],
    "grasp": lambda out, _: ["grasp", "--repeats=100", "--threads=1", f"--out={out}"],
    "report": lambda out, _: ["report", "--results", str(ROOT / "results"), f"--out={out}/a.html"],
    "video": lambda out, run: ["video", str(run), "--frames-per-step=24", f"--out={out}/a.mp4"],
}  # fmt: skip
"""Long commands, likewise."""

SENTENCE = re.compile(r"^iswarm: [^\n]+\n", re.MULTILINE)
OF_A_RUN = ("result.json", "trajectory.npz", "clean.rrd")


def finished(arguments, cwd, environment=None, timeout=600):
    """A command that has ended, in a directory, with further variables of its environment."""
    return subprocess.run(
        [sys.executable, "-m", "iswarm_mj", *arguments],
        cwd=cwd,
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        timeout=timeout,
    )


def begun(arguments):
    """A command in a session of its own, so that what it starts is known."""
    return start(*arguments, start_new_session=True)


def check_told(code, error):
    """A command ended with a sentence, or well; never with a traceback."""
    assert "Traceback" not in error, error
    assert code == 0 or SENTENCE.search(error), (code, error)


def check_whole(out):
    """Each file has its whole content, but for those whose names say that they are parts of one."""
    for path in out.rglob("*"):
        if not path.is_file() or path.name.startswith(".") or (path.stat().st_size == 0 and path.suffix == ".sqlite"):
            continue
        content = path.read_bytes()
        try:
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
                    assert content.rstrip().endswith((b"</svg>", b"</html>"))
                case ".csv":
                    assert content.endswith(b"\n")
                case ".mp4":
                    assert b"moov" in content
        except Exception as error:
            raise AssertionError(f"{path} is not whole: {error!r}") from None


def check_unmixed(out, old):
    """The files of a run are all of the earlier run, with its content `old`, or none of them is."""
    there = {name: (out / name).read_bytes() for name in OF_A_RUN if (out / name).exists()}
    if there.get("result.json") == old["result.json"]:
        assert there == old
        return "old"
    kept = [name for name, content in there.items() if content == old[name]]
    assert not kept or "result.json" not in there, f"{kept} of the earlier run beside a new result.json"
    if "result.json" in there and "trajectory.npz" in there:
        load(out)
    return "new" if "result.json" in there else "between"


def check_free(out):
    """Nobody holds the lock of the directory."""
    try:
        with locked(out):
            pass
    except UserError as error:
        raise AssertionError(str(error)) from None


def check_alone(process, wait_s=60):
    """What a process has started has ended, or ends soon."""
    end = time.monotonic() + wait_s
    while left := _of_session(process.pid):
        assert time.monotonic() < end, f"processes {left} are left"
        time.sleep(0.1)


def _of_session(number):
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, session = stat.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(session) == number and state != "Z":
            found.append(int(stat.parent.name))
    return found


def cleared(path):
    """An empty directory at this path."""
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(parents=True)
    return path
