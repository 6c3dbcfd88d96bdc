"""Commands that signals or a full disk end, at any moment: with their code, nothing left running,
every file whole."""

import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest
from hypothesis import event
from PIL import Image
from support.attacks import attack, pick
from support.recorded import write_run
from support.rrd import read
from support.small import FLAGS

from iswarm_mj import load
from iswarm_mj.utils.directory_lock import locked

ROOT, ARENA = Path(__file__).parents[2], " ".join(FLAGS)
OF_A_RUN = ("result.json", "trajectory.npz", "clean.rrd")
COMMANDS = {
    "clean": (
        f"clean {ARENA} --threads=1 --robots=30 --engine=planar --worlds=2 --record-worlds 0 1 --out={{out}}",
        "--steps=70",
        "--steps=100000 --gripper.release-voltage=3",  # at which no ball is ever released
    ),
    "evolve": (
        f"evolve {ARENA} --population=4 --engine=planar --out={{out}}",
        "--generations=2 --steps=5 --workers=1",
        "--generations=100 --steps=50 --workers=2",
    ),
    "train": (
        f"train {ARENA} --population=4 --worlds=1 --robots=4 --threads=1 --out={{out}}",
        "--generations=2 --steps=5",
        "--generations=1000 --steps=50",
    ),
    "grasp": (
        "grasp --threads=1 --out={out}",
        "--radius=2e-5 --rh=10 --repeats=2",
        "--repeats=100",
    ),
    "picture": ("picture {run} --width=64 --height=64 --out={out}/a.png", "--step=1", "--step=2"),
    "video": (
        "video {run} --width=64 --height=64 --out={out}/a.mp4",
        "--steps=2",
        "--frames-per-step=24",
    ),
    "report": (
        "report --out={out}/a.html",
        f"--results {ROOT}/results/default/hop-count",
        f"--results {ROOT}/results",
    ),
}
"""Arguments of commands that write: all, those of a short one, those of a long one."""
ENDLESS = {
    "clean": f"clean {ARENA} --robots=30 --steps=100000 --gripper.release-voltage=3 --engine={{engine}} --out={{out}}",
    "run": f"run --task=foraging {ARENA} --robots=30 --steps=100000 --engine={{engine}} --out={{out}}",
    "evolve": f"evolve {ARENA} --population=4 --steps=50 {{workers}} --engine={{engine}} --out={{out}}",
    "train": f"train {ARENA} --population=4 --worlds=1 --robots=4 --generations=1000 --engine={{engine}} --out={{out}}",
    "sweep": f"sweep {ARENA} --over=robots=5,10,20,25 --steps=100000 --engine={{engine}} --out={{out}}",
    "experiment": "experiment density {workers} --engine={engine} --out={out}",
    "bench": f"bench {ARENA} --robots=30 --steps=100000 --engine={{engine}}",
    "play": f"play {ARENA} --no-open --robots=30 --engine={{engine}} --out={{out}}",
    "grasp": "grasp --repeats=1000 --out={out}",
    "video": "video {run} --frames-per-step=24 --out={out}/a.mp4",
    "replay": "replay {run} --frames-per-step=24 --out={out}/a.html",
}
"""Arguments of commands that run for long, most of which compile first."""


def begun(name, out, run="", is_long=True, before="", **environment):
    """Start one of `COMMANDS`, see `started`."""
    common, *own = COMMANDS[name]
    return started(f"{common} {own[is_long]}".format(out=out, run=run), before, **environment)


def started(words, before="", **environment):
    """Start a command in a session of its own, after some Python code; signals that this process
    ignores are heeded."""
    heed = "import signal\nfor number in (1, 2, 15):\n    signal.signal(number, signal.SIG_DFL)\n"
    heed += "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    code = f"{heed}{before}\nimport sys\nfrom iswarm_mj.__main__ import main\nmain()"
    environment = os.environ | {"PYTHONUNBUFFERED": "1"} | environment
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(
        [sys.executable, "-c", code, *words.split()],
        **pipes,
        env=environment,
        start_new_session=True,
    )


def check_whole(out):
    """Each file has its whole content, but for those whose names say that they are parts; the
    directory is free."""
    for path in out.rglob("*"):
        if (
            not path.is_file()
            or path.name.startswith(".")
            or (path.stat().st_size == 0 and path.suffix == ".sqlite")
        ):
            continue
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
    with locked(out):
        pass


def check_unmixed(out, old):
    """The files of a run are all of the earlier run, with its content `old`, or none of them is."""
    there = {name: (out / name).read_bytes() for name in OF_A_RUN if (out / name).exists()}
    if there.get("result.json") == old["result.json"]:
        assert there == old
    elif "result.json" in there:
        assert not any(content == old[name] for name, content in there.items())
        if "trajectory.npz" in there:
            load(out)


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """Directory of a run, and a function that makes one with nothing but that run's files in it."""
    run = write_run(tmp_path_factory.mktemp("earlier"))
    (run / "clean.rrd").write_bytes(b"RRF2")

    def copied(out, name):
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        for file in OF_A_RUN if name == "clean" else ():
            shutil.copy(run / file, out / file)
        return {file: (run / file).read_bytes() for file in OF_A_RUN}

    return run, copied


def ended(process, number=None):
    """Wait for a process that the signal ended, which it is sent, or sends itself as SIGTERM."""
    if number is not None:
        process.send_signal(number)
    error = process.communicate(timeout=300)[1]
    assert process.returncode == 128 + (number or signal.SIGTERM), error
    assert error.splitlines()[-1].startswith("iswarm: interrupted") and "Trace" not in error


def check_interrupted(out):
    """Result, trajectory and recording are of the same interrupted run; return its number of
    steps."""
    content, frames = json.loads((out / "result.json").read_text()), load(out).arrays
    assert content["interrupted"] and frames["step"][-1] == content["steps"]
    for name in ("delivered", "collisions"):
        assert frames[name][-1] == content[name][0]
    assert read(out / "clean.rrd")["/world/robots/body"]["step"] == frames["step"].tolist()
    assert {path.name for path in out.iterdir()} == {*OF_A_RUN, "world-1"}
    return content["steps"]


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGTERM,
        *(pytest.param(n, marks=pytest.mark.slow) for n in (signal.SIGINT, signal.SIGHUP)),
    ],
)
def test_a_signal_in_the_middle_of_a_run(tmp_path, number):
    (tmp_path / "trajectory.npz").write_text("of an earlier run")
    recording = tmp_path / "clean.rrd"
    with begun("clean", tmp_path) as process:
        while process.poll() is None and (
            not recording.exists() or recording.stat().st_size < 300_000
        ):
            time.sleep(0.02)
        ended(process, number)
    assert check_interrupted(tmp_path) >= 63  # a block of frames is the start and these


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
SWALLOWED = """
import gc, time, iswarm_mj.workflows.clean as clean
def collect(*_):  # of what a callback of the collector raises, Python only tells
    print("now", flush=True)
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


@pytest.mark.parametrize(
    ("before", "leaves"),
    [
        (LOADING, False),
        *(pytest.param(code, True, marks=pytest.mark.slow) for code in (SWALLOWED, ANNOUNCED)),
    ],
)
def test_a_signal_where_an_exception_would_do_harm(tmp_path, before, leaves):
    """While a library is loaded; where Python only reports it; between the announcement and the
    recording."""
    with begun("clean", tmp_path, before=before) as process:
        if before is ANNOUNCED:
            ended(process)
        else:
            assert process.stdout.readline() == "now\n"
            ended(process, signal.SIGTERM)
    assert check_interrupted(tmp_path) == 0 if leaves else list(tmp_path.iterdir()) == []


@pytest.mark.slow
@attack(3)
def test_signals_at_any_moment(earlier, tmp_path, seed):
    rng, out = np.random.default_rng(seed), tmp_path / "out"
    (run, copied), name = earlier, pick(rng, list(COMMANDS))
    number, moment = (
        pick(rng, [signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP]),
        12 * rng.random() ** 2,
    )
    old = copied(out, name)
    with begun(name, out, run) as process:
        with suppress(subprocess.TimeoutExpired):
            process.communicate(timeout=moment)
        process.send_signal(number)
        error = process.communicate(timeout=200)[1]
    event(f"{name}, {number.name}: {process.returncode}")
    if "Fatal Python error: init_" in error:  # Python itself had not begun
        return
    assert process.returncode in (0, -number, 128 + number), (process.returncode, error)
    assert process.returncode <= 0 or ("Traceback" not in error and "interrupted" in error), error
    check_nothing_runs_on(process)
    check_whole(out)
    if name == "clean":
        check_unmixed(out, old)


def check_nothing_runs_on(process):
    """All processes of a session end."""
    end = time.monotonic() + 60
    while any(
        os.getsid(one.pid) == process.pid
        for one in psutil.process_iter()
        if psutil.pid_exists(one.pid)
    ):
        assert time.monotonic() < end, "processes are left"
        time.sleep(0.1)


@pytest.mark.slow
@attack(6)
def test_signals_while_programs_are_compiled_and_run(earlier, tmp_path_factory, seed):
    """Where all compiled programs are there, and where none is."""
    rng, out, (run, _) = np.random.default_rng(seed), tmp_path_factory.mktemp("out"), earlier
    name, engine = pick(rng, list(ENDLESS)), pick(rng, ["planar", "mujoco", "mjx"])
    number, has_cache = (
        pick(rng, [signal.SIGTERM, signal.SIGINT, signal.SIGHUP]),
        bool(rng.integers(2)),
    )
    moment = (12 if has_cache else 30) * rng.random()

    caches = {} if has_cache else {"XDG_CACHE_HOME": str(tmp_path_factory.mktemp("cache"))}
    workers = "" if engine == "mjx" else "--workers=2"
    words = ENDLESS[name].format(out=out, run=run, engine=engine, workers=workers)
    with started(words, **caches) as process:
        with suppress(subprocess.TimeoutExpired):
            process.communicate(timeout=moment)
        process.send_signal(number)
        try:
            error = process.communicate(timeout=60)[
                1
            ]  # for machines with other work; it takes at most 5 s
        finally:
            process.kill()
    event(f"{name}, {engine}: {process.returncode}")
    if "Fatal Python error: init_" in error:  # Python itself had not begun
        return
    assert process.returncode in (0, -number, 128 + number), (words, process.returncode, error)
    assert process.returncode <= 0 or ("Traceback" not in error and "interrupted" in error), (
        words,
        error,
    )
    check_nothing_runs_on(process)
    check_whole(out)


@pytest.fixture(scope="module")
def filler(tmp_path_factory):
    """A library that refuses writes from a given number on."""
    library, source = (
        tmp_path_factory.mktemp("filler") / "fill_disk.so",
        Path(__file__).with_name("fill_disk.c"),
    )
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
    return library


def filled(filler, name, out, run, after):
    """Exit code and error of a command on a disk that is full after so many changes, and how many
    it tried."""
    count = filler.with_name("count")
    count.write_bytes(bytes(8))
    settings = {"FULL_BELOW": out, "FULL_AFTER": after, "FULL_COUNT": count, "LD_PRELOAD": filler}
    with begun(
        name, out, run, False, **{key: str(value) for key, value in settings.items()}
    ) as process:
        error = process.communicate(timeout=600)[1]
    return process.returncode, error, int(np.frombuffer(count.read_bytes(), np.int64)[0])


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@attack(3)
def test_a_disk_that_is_full_at_any_write(filler, earlier, tmp_path, seed):
    """The command ends with a sentence; what was there before, or is new, is whole."""
    rng, out = np.random.default_rng(seed), tmp_path / "out"
    (run, copied), name = earlier, pick(rng, list(COMMANDS))
    old = copied(out, name)
    code, error, number = filled(filler, name, out, run, 10**9)
    assert code == 0 and number > 1, error
    copied(out, name)
    code, error, _ = filled(filler, name, out, run, int(rng.integers(number)))
    event(f"{name}: {code}")
    assert code == 0 or (
        code == 2 and re.search(r"^iswarm: [^\n]*No space left[^\n]*\n", error, re.M)
    ), (code, error)
    assert "Traceback" not in error
    check_whole(out)
    if name == "clean":
        check_unmixed(out, old)
