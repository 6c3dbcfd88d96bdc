"""Signals at any moment of any long command, the start and compiling included.

Nothing is left running, every file is whole, the directory is free, and of two runs' files none lie side by side.
"""

import shutil
import signal
import subprocess
import time
from contextlib import suppress

import pytest
from helpers_ends import LONG, OF_A_RUN, begun, check_alone, check_free, check_unmixed, check_whole, cleared

SIGNALS = [signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP]
LATEST_S = 12.0
"""After the start; most commands begin with some seconds of loading and compiling."""


@pytest.mark.slow
@pytest.mark.attack(3)
def test_at_any_moment(attack, recorded_run, tmp_path):
    """What became of a process by its signal, and how long that took at most, are told."""
    out, names, slowest = tmp_path / "out", list(LONG), 0.0
    old = {name: (recorded_run / name).read_bytes() for name in OF_A_RUN}
    for rng in attack.generators():
        name, number = names[rng.integers(len(names))], SIGNALS[rng.integers(4)]
        moment = LATEST_S * rng.random() ** 2
        cleared(out)
        if name.startswith("clean"):
            for file in OF_A_RUN:
                shutil.copy(recorded_run / file, out / file)
        with attack.case(f"{name}, {number.name} after {moment:.2f} s") as outcome:
            with begun(LONG[name](out, recorded_run)) as process:
                with suppress(subprocess.TimeoutExpired):
                    process.communicate(timeout=moment)
                process.send_signal(number)
                sent = time.monotonic()
                error = process.communicate(timeout=200)[1]
                took = time.monotonic() - sent
            if "Fatal Python error: init_" in error:  # Python itself had not begun
                outcome.append(f"{number.name} killed")
                continue
            assert process.returncode in (0, -number, 128 + number), (process.returncode, error)
            if process.returncode == 128 + number:
                slowest = max(slowest, took)
                assert "Traceback" not in error and "interrupted" in error, error
            check_alone(process)
            check_whole(out)
            check_free(out)
            told = {0: "finished", -number: "killed"}.get(process.returncode, "interrupted")
            told = f"{number.name} {told}"
            if name.startswith("clean"):
                told = f"{told}: {check_unmixed(out, old)} files"
            outcome.append(told)
    print(f"interrupted commands ended within {slowest:.2f} s")
