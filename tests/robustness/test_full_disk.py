"""A disk that becomes full at any write of whole commands, a directory that vanishes, two processes in one."""

import os
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from helpers_ends import (
    LONG,
    OF_A_RUN,
    WRITING,
    begun,
    check_alone,
    check_free,
    check_told,
    check_unmixed,
    check_whole,
    cleared,
    finished,
)

from iswarm_mj import load

COMPILER = shutil.which("cc")


@pytest.fixture(scope="module")
def filler(tmp_path_factory):
    """A library that refuses writes from a given number on."""
    library = tmp_path_factory.mktemp("filler") / "fill_disk.so"
    source = Path(__file__).parent.parent / "fill_disk.c"
    subprocess.run([COMPILER, "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True)
    return library


def filled(filler, arguments, out, after):
    """A command on a disk that is full after so many changes below `out`, and how many it tried."""
    count = filler.with_name("count")
    count.write_bytes(bytes(8))
    settings = {"FULL_BELOW": out, "FULL_AFTER": after, "FULL_COUNT": count, "LD_PRELOAD": filler}
    process = finished(arguments, out.parent, {name: str(value) for name, value in settings.items()})
    return process, int(np.frombuffer(count.read_bytes(), np.int64)[0])


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
        with attack.case(f"{name}, full after {after} of {numbers[name]} changes", 600) as outcome:
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


@pytest.mark.slow
@pytest.mark.attack(2)
def test_a_directory_vanishes(attack, recorded_run, tmp_path):
    """Removed, moved away, or replaced by a file, while a command writes into it."""
    out, names = tmp_path / "out", list(WRITING)
    for rng in attack.generators():
        name, how = names[rng.integers(len(names))], ["removed", "moved", "replaced"][rng.integers(3)]
        cleared(out)
        with attack.case(f"{name}, {how}", 600) as outcome:
            with begun(WRITING[name](out, recorded_run)) as process:
                wait_for_work(process, out, rng)
                away = tmp_path / "away"
                shutil.rmtree(away, ignore_errors=True)
                if out.is_dir():
                    out.rename(away)
                if how == "removed":
                    shutil.rmtree(away, ignore_errors=True)
                if how == "replaced":
                    out.write_text("") if not out.exists() else None
                error = process.communicate(timeout=500)[1]
            check_told(process.returncode, error)
            assert process.returncode in (0, 2), (process.returncode, error)
            outcome.append("done all the same" if process.returncode == 0 else "refused")
        if out.is_file():
            out.unlink()


def wait_for_work(process, out, rng):
    """Until there is something in the directory, or the process ends, and a little longer."""
    while process.poll() is None and not any(out.iterdir()):
        time.sleep(0.005)
    time.sleep(rng.random() ** 3)


@pytest.mark.slow
@pytest.mark.attack(2)
def test_two_in_one_directory(attack, recorded_run, tmp_path):
    """One of them is refused, or comes after the other; the files are of one of them."""
    out = tmp_path / "out"
    names = ["clean", "evolve", "grasp", "report", "video"]
    for rng in attack.generators():
        name = names[rng.integers(len(names))]
        cleared(out)
        with attack.case(name, 600) as outcome:
            commands = [WRITING[name](out, recorded_run) for _ in range(2)]
            if name in ("clean", "evolve"):
                commands = [[*command, f"--seed={seed}"] for seed, command in enumerate(commands)]
            processes = []
            for command in commands:
                processes.append(begun(command))
                time.sleep(2 * rng.random() ** 2)
            told = [(process.communicate(timeout=500)[1], process.returncode) for process in processes]
            for error, code in told:
                check_told(code, error)
                assert code in (0, 2), error
            assert any(code == 0 for _, code in told), told
            check_whole(out)
            check_free(out)
            if name == "clean":
                last = load(out)
                assert last.settings.seed in (0, 1) and len(last.steps) == 71
                assert last.scene.world == 0 and "interrupted" not in last.result
            outcome.append("refused" if any(code for _, code in told) else "one after the other")


@pytest.mark.slow
def test_of_two_that_write_one_goes_on(tmp_path):
    """The second is refused while the first runs, and changes nothing."""
    out = cleared(tmp_path / "out")
    with begun(LONG["clean"](out, None)) as process:
        while process.poll() is None and not (out / "result.json").exists():
            time.sleep(0.02)
        before = (out / "result.json").read_bytes()
        second = finished(WRITING["clean"](out, None), tmp_path)
        assert second.returncode == 2 and "is in use by another process" in second.stderr
        assert (out / "result.json").read_bytes() == before
        process.terminate()
        process.communicate(timeout=200)
    check_alone(process)
    assert os.path.exists(out / "trajectory.npz")
