"""Caches of compiled programs that a power cut, a bad disk or a full one has damaged: results are
the same."""

import os
import random
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from iswarm_mj.utils.compiled import CHECKSUMS, record, remove_damaged

PROGRAMS = """
import hashlib
from functools import partial
from pathlib import Path

import iswarm_mj  # before JAX, whose log it silences
import jax
import numba
import numpy as np

from iswarm_mj.sensors.neighbours import find_neighbours
from iswarm_mj.utils.compiled import cached
from iswarm_mj.utils.jax_setup import configure_jax

configure_jax()


@partial(cached, compiler=partial(numba.cfunc, "float64(float64)"))
def for_c(x):
    return 3.0 * x + 0.1


@jax.jit
def of_jax(x):
    return jax.lax.scan(lambda total, row: (jax.numpy.tanh(total @ x + row), row.sum()), x, x)


points = np.random.default_rng(0).uniform(0, 20, (2, 30, 2))
ten_points = points[0, :10, :]
results = [*find_neighbours(points, 6.0), for_c.ctypes(2.0), *of_jax(ten_points.T @ ten_points)]
print(hashlib.sha256(b"".join(np.asarray(values).tobytes() for values in results)).hexdigest())
"""
"""Functions that Python, C and JAX call, and a hash of their results."""

NUMBA_FILES = ("*.nbi", "*.nbc", CHECKSUMS, "*")
KINDS = ("empty", "cut", "flipped", "garbage", "missing")
N_DAMAGES = 20
"""Number of damages of each of the two caches."""
QUICK = [("numba", 7), ("jax", 1)]
"""The damages of the everyday suite: to all files of one library."""
ALL = [(cache, seed) for cache in ("numba", "jax") for seed in range(N_DAMAGES)]
DAMAGED = (
    "iswarm: the cache of compiled programs in {}/iswarm_mj/numba was damaged; "
    "what it lacks is compiled again\n"
)


class Filled(NamedTuple):
    """A script, and a cache with its programs."""

    script: Path
    cache: Path
    result: str
    """What it prints."""


def run(cache, script, **limits):
    """Return the process of a script that uses a cache of its own, after its end."""
    unset = ("NUMBA_CACHE_DIR", "JAX_COMPILATION_CACHE_DIR", "XLA_FLAGS")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    environment["XDG_CACHE_HOME"] = str(cache)
    return subprocess.run(
        [sys.executable, script], env=environment, capture_output=True, text=True, **limits
    )


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """Return the script after a run that fills the cache, and one that uses it."""
    folder = tmp_path_factory.mktemp("filled")
    script = folder / "programs.py"
    cache = folder / "cache"
    script.write_text(PROGRAMS)
    first = run(cache, script)
    assert (first.returncode, first.stderr) == (0, "")
    again = run(cache, script)
    assert (again.stdout, again.stderr) == (first.stdout, "")
    return Filled(script, cache, first.stdout)


def damage(path, kind, rng):
    """Change a file as a power cut or a disk may."""
    content = bytearray(path.read_bytes())
    if kind == "missing":
        path.unlink()
        return
    if kind == "empty":
        content.clear()
    elif kind == "cut":
        del content[rng.randrange(1, len(content)) :]
    elif kind == "flipped":
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    else:
        content = rng.randbytes(len(content))
    path.write_bytes(content)


def files_to_damage(cache, library, seed, rng):
    """Return one file or all files of a kind, of a library's part of the cache."""
    if library == "numba":
        pattern = NUMBA_FILES[seed % len(NUMBA_FILES)]
        paths = (cache / "iswarm_mj" / "numba").rglob(pattern)
    else:
        paths = cache.glob("iswarm_mj/jax-*/*-cache")
    # Locks are empty.
    files = sorted(path for path in paths if path.is_file() and path.stat().st_size > 0)
    is_one = seed % 2 == 0
    return [rng.choice(files)] if is_one else files


def check_survival(filled, tmp_path, library, seed):
    """Check that results equal those with the whole cache.

    One line reports damage to numba's part, which is repaired then.
    """
    rng = random.Random(seed)
    kind = KINDS[seed % len(KINDS)]
    cache = Path(shutil.copytree(filled.cache, tmp_path / "cache"))
    files = files_to_damage(cache, library, seed, rng)
    for path in files:
        damage(path, kind, rng)

    process = run(cache, filled.script)
    assert (process.returncode, process.stdout) == (0, filled.result), process.stderr
    if library != "numba":
        return

    # In the names of the checksums a flipped bit looks like a new program.
    is_program_damaged = any(path.name != CHECKSUMS for path in files)
    if kind == "missing":  # perhaps on purpose
        assert process.stderr == ""
    elif is_program_damaged or kind != "flipped":
        assert process.stderr == DAMAGED.format(cache)
    repaired = run(cache, filled.script)
    assert (repaired.stdout, repaired.stderr) == (filled.result, "")


@pytest.mark.parametrize(("library", "seed"), QUICK)
def test_damage_is_survived(filled, tmp_path, library, seed):
    check_survival(filled, tmp_path, library, seed)


@pytest.mark.slow
@pytest.mark.parametrize(("library", "seed"), ALL)
def test_any_damage_is_survived(filled, tmp_path, library, seed):
    check_survival(filled, tmp_path, library, seed)


def test_damage_while_a_process_runs_is_found_by_the_next(tmp_path):
    """The process records another program after a bit of the first one has flipped on the disk."""
    folder = tmp_path / "function"
    folder.mkdir()
    first = folder / "first.nbc"
    second = folder / "second.nbc"
    first.write_bytes(b"program")
    record(tmp_path)

    # The times of the file do not tell.
    written = first.stat()
    first.write_bytes(b"Program")
    os.utime(first, ns=(written.st_atime_ns, written.st_mtime_ns))
    second.write_bytes(b"program")
    record(tmp_path)

    remove_damaged(tmp_path)
    assert [*folder.iterdir()] == [second]


def test_programs_that_are_written_again_stay(tmp_path):
    folder = tmp_path / "function"
    folder.mkdir()
    index = folder / "index.nbi"
    for content in (b"one type", b"two types"):
        index.write_bytes(content)
        record(tmp_path)
    remove_damaged(tmp_path)
    assert index.read_bytes() == b"two types"


@pytest.mark.slow
def test_a_full_disk_is_survived(filled, tmp_path):
    """No file may have more than a few bytes, as on a disk that fills up while programs are
    written."""
    resource = pytest.importorskip("resource", reason="Windows limits no files")

    def limit_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))

    process = run(tmp_path, filled.script, preexec_fn=limit_files)
    assert (process.returncode, process.stdout) == (0, filled.result), process.stderr
    (line,) = (line for line in process.stderr.splitlines() if line.startswith("iswarm: "))
    assert "(File too large)" in line


@pytest.mark.slow
def test_a_cache_that_cannot_be_used_is_survived(filled, tmp_path):
    (tmp_path / "iswarm_mj").touch()
    process = run(tmp_path, filled.script)
    assert (process.returncode, process.stdout) == (0, filled.result), process.stderr
    assert "iswarm: compiled programs cannot be kept in" in process.stderr


INSPECT = """
import sys
from iswarm_mj.commands.main import main
main(["inspect", sys.argv[1]])
print("iswarm_mj.gripper.plugin" in sys.modules, "iswarm_mj.engines.planar.physics" in sys.modules)
"""


@pytest.mark.slow
def test_inspect_needs_no_compiled_program():
    results = Path(__file__).parents[2] / "results/default/grasp"
    command = [sys.executable, "-c", INSPECT, results]
    process = subprocess.run(command, capture_output=True, text=True)
    assert process.stdout.splitlines()[-1] == "False False", process.stderr
