"""One process at a time writes into a directory."""

import subprocess
import sys

import pytest

from iswarm_mj.utils.directory_lock import check_lock, locked
from iswarm_mj.utils.errors import UserError

HOLD = """
import sys
from pathlib import Path
from iswarm_mj.utils.directory_lock import locked

with locked(Path(sys.argv[1])):
    print("has it", flush=True)
    sys.stdin.read()
"""
COUNT = """
import sys
from pathlib import Path
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.errors import UserError

out = Path(sys.argv[1])
number = out / "number"
n_done = 0
while n_done < 10:
    try:
        with locked(out):
            number.write_text(str(int(number.read_text()) + 1))
            n_done += 1
    except UserError:
        pass
"""


def started(program, directory):
    """Return a process of a program that is given a directory."""
    command = [sys.executable, "-c", program, str(directory)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)


def test_another_process_is_refused_until_the_first_is_killed(tmp_path):
    out = tmp_path / "out"
    in_use = (
        "out is in use by another process, or elsewhere in this one; "
        "wait for its end or choose another `out`$"
    )
    with started(HOLD, out) as process:
        assert process.stdout.readline() == "has it\n"
        with pytest.raises(UserError, match=in_use), locked(out):
            pass
        process.kill()

    with locked(out), pytest.raises(UserError, match=in_use), locked(out):
        pass
    assert list(out.iterdir()) == []


def test_many_at_once_are_never_two(tmp_path):
    """Processes take the lock in turn, and remove its file each time, while they read a number and
    add one to it."""
    (tmp_path / "number").write_text("0")
    processes = [started(COUNT, tmp_path) for _ in range(3)]
    for process in processes:
        process.communicate()
        assert process.returncode == 0
    assert (tmp_path / "number").read_text() == "30"


def test_a_link_in_the_place_of_the_lock_is_not_followed(tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".lock").symlink_to(tmp_path / "mine")
    with pytest.raises(UserError, match=r"\.lock cannot be written"), locked(tmp_path):
        pass
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_check_leaves_no_directory_behind(tmp_path):
    out = tmp_path / "runs" / "clean"
    check_lock(out)
    assert not (tmp_path / "runs").exists()

    with locked(out):
        with pytest.raises(UserError, match="in use"):
            check_lock(out)
        assert out.exists()
