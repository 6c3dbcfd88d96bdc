"""A disk that becomes full at any write of whole commands, a directory that vanishes, two processes in one."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from helpers_ends import (
    OF_A_RUN,
    WRITING,
    check_free,
    check_told,
    check_unmixed,
    check_whole,
    cleared,
    finished,
)

COMPILER = shutil.which("cc")


@pytest.fixture(scope="module")
def filler(tmp_path_factory):
    """A library that refuses writes from a given number on."""
    library = tmp_path_factory.mktemp("filler") / "fill_disk.so"
    source = Path(__file__).with_name("fill_disk.c")
    subprocess.run([COMPILER, "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
    return library


def filled(filler, arguments, out, after):
    """A command on a disk that is full after so many changes below `out`, and how many it tried."""
    count = filler.with_name("count")
    count.write_bytes(bytes(8))
    settings = {"FULL_BELOW": out, "FULL_AFTER": after, "FULL_COUNT": count, "LD_PRELOAD": filler}
    process = finished(arguments, out.parent, {name: str(value) for name, value in settings.items()})
    return process, int(np.frombuffer(count.read_bytes(), np.int64)[0])


@pytest.mark.slow
@pytest.mark.attack(3)
@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_at_any_write(attack, filler, recorded_run, tmp_path):
    """It ends with a sentence; what was there before, or is new, is whole."""
    out, names, numbers = tmp_path / "out", list(WRITING), {}
    old = {name: (recorded_run / name).read_bytes() for name in OF_A_RUN}
    for rng in attack.generators():
        name = names[rng.integers(len(names))]
        arguments = WRITING[name](out, recorded_run)
        if name not in numbers:
            process, numbers[name] = filled(filler, arguments, cleared(out), 10**9)
            assert process.returncode == 0 and numbers[name] > 1, process.stderr
        after = int(rng.integers(numbers[name]))
        cleared(out)
        if name.startswith("clean"):
            for file in OF_A_RUN:
                shutil.copy(recorded_run / file, out / file)
        with attack.case(f"{name}, full after {after} of {numbers[name]} changes") as outcome:
            process, _ = filled(filler, arguments, out, after)
            check_told(process.returncode, process.stderr)
            assert process.returncode in (0, 2), (process.returncode, process.stderr)
            assert process.returncode == 0 or "No space left" in process.stderr, process.stderr
            check_whole(out)
            check_free(out)
            told = "done all the same" if process.returncode == 0 else "refused"
            if name.startswith("clean"):
                told = f"{told}: {check_unmixed(out, old)} files"
            outcome.append(told)
