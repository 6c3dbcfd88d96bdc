"""Caches of compiled programs that a power cut, a bad disk or a full one has damaged: results are
the same."""

import os
import random
import resource
import shutil
import subprocess
import sys
from pathlib import Path

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
numbers = [*find_neighbours(points, 6.0), for_c.ctypes(2.0), *of_jax(points[0, :10, :].T @ points[0, :10, :])]
print(hashlib.sha256(b"".join(np.asarray(values).tobytes() for values in numbers)).hexdigest())
"""
"""Functions that Python, C and JAX call, and their results as one number."""

NUMBA_FILES = ("*.nbi", "*.nbc", CHECKSUMS, "*")
KINDS = ("empty", "cut", "flipped", "garbage", "missing")
N_DAMAGES = 20
"""Damages of each of the two caches."""
QUICK = [("numba", 2), ("numba", 7), ("jax", 1)]
"""The damages of the suite of every day: both of numba's files, and JAX's."""
ALL = [(cache, seed) for cache in ("numba", "jax") for seed in range(N_DAMAGES)]
DAMAGED = "iswarm: the cache of compiled programs in {}/iswarm_mj/numba was damaged; what it lacks is compiled again\n"


def run(cache, script, **limits):
    """The process of a script, with a cache of its own."""
    unset = ("NUMBA_CACHE_DIR", "JAX_COMPILATION_CACHE_DIR", "XLA_FLAGS")
    env = {name: value for name, value in os.environ.items() if name not in unset} | {
        "XDG_CACHE_HOME": str(cache)
    }
    return subprocess.run(
        [sys.executable, script], capture_output=True, text=True, env=env, **limits
    )


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """A script, its result, and a cache with its programs."""
    folder = tmp_path_factory.mktemp("filled")
    script, cache = folder / "programs.py", folder / "cache"
    script.write_text(PROGRAMS)
    first = run(cache, script)
    assert (first.returncode, first.stderr) == (0, "")
    again = run(cache, script)
    assert (again.stdout, again.stderr) == (first.stdout, "")
    return script, cache, first.stdout


def damage(path, kind, numbers):
    """Change a file as a power cut or a disk may."""
    content = bytearray(path.read_bytes())
    if kind == "missing":
        path.unlink()
        return
    if kind == "empty":
        content.clear()
    elif kind == "cut":
        del content[numbers.randrange(1, len(content)) :]
    elif kind == "flipped":
        content[numbers.randrange(len(content))] ^= 1 << numbers.randrange(8)
    else:
        content = numbers.randbytes(len(content))
    path.write_bytes(content)


def check_survival(filled, tmp_path, which, seed):
    """Results equal those with the whole cache; damage to numba's part is said in one line, and
    repaired."""
    script, whole, expected = filled
    cache = Path(shutil.copytree(whole, tmp_path / "cache"))
    numbers, kind = random.Random(seed), KINDS[seed % len(KINDS)]
    if which == "numba":
        pattern = NUMBA_FILES[seed % len(NUMBA_FILES)]
        found = (cache / "iswarm_mj" / "numba").rglob(pattern)
    else:
        found = cache.glob("iswarm_mj/jax-*/*-cache")
    found = [path for path in found if path.is_file() and path.stat().st_size > 0]  # but for locks
    damaged = sorted(found) if seed % 2 else [numbers.choice(sorted(found))]
    for path in damaged:
        damage(path, kind, numbers)

    done = run(cache, script)
    assert (done.returncode, done.stdout) == (0, expected), done.stderr
    if which == "numba":
        programs = [path for path in damaged if path.name != CHECKSUMS]
        if kind == "missing":  # perhaps on purpose
            assert done.stderr == ""
        elif (
            programs or kind != "flipped"
        ):  # in the names of the checksums a flipped bit looks like a new program
            assert done.stderr == DAMAGED.format(cache)
        repaired = run(cache, script)
        assert (repaired.stdout, repaired.stderr) == (expected, "")


@pytest.mark.parametrize(("which", "seed"), QUICK)
def test_damage_is_survived(filled, tmp_path, which, seed):
    check_survival(filled, tmp_path, which, seed)


@pytest.mark.slow
@pytest.mark.parametrize(("which", "seed"), ALL)
def test_any_damage_is_survived(filled, tmp_path, which, seed):
    check_survival(filled, tmp_path, which, seed)


def test_damage_while_a_process_runs_is_found_by_the_next(tmp_path):
    """The process records another program after a bit of the first one has flipped on the disk."""
    folder = tmp_path / "function"
    folder.mkdir()
    first, second = folder / "first.nbc", folder / "second.nbc"
    first.write_bytes(b"program")
    record(tmp_path)
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


def test_a_full_disk_is_survived(filled, tmp_path):
    """No file may have more than a few bytes, as on a disk that fills up while programs are
    written."""
    script, _, expected = filled

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))

    done = run(tmp_path, script, preexec_fn=limit)
    assert (done.returncode, done.stdout) == (0, expected), done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("iswarm: ")]
    assert len(said) == 1 and "(File too large)" in said[0]


def test_a_cache_that_cannot_be_used_is_survived(filled, tmp_path):
    script, _, expected = filled
    (tmp_path / "iswarm_mj").touch()
    done = run(tmp_path, script)
    assert (done.returncode, done.stdout) == (0, expected), done.stderr
    assert "iswarm: compiled programs cannot be kept in" in done.stderr


INSPECT = """
import sys
from iswarm_mj.commands.main import main
main(["inspect", sys.argv[1]])
print("iswarm_mj.gripper.plugin" in sys.modules, "iswarm_mj.engines.planar.physics" in sys.modules)
"""


def test_inspect_needs_no_compiled_program(tmp_path):
    results = Path(__file__).parents[2] / "results/default" / "grasp"
    done = subprocess.run([sys.executable, "-c", INSPECT, results], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "False False", done.stderr
