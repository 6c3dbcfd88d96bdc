"""One process at a time writes into a directory."""

import subprocess
import sys

import pytest

from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.errors import UserError


def test_another_process_is_refused_until_the_first_is_killed(tmp_path):
    out = tmp_path / "out"
    code = (
        "import sys; from pathlib import Path; from iswarm_mj.utils.directory_lock import locked\n"
        f"with locked(Path({str(out)!r})): print('has it', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdin=-1, stdout=-1, text=True) as process:
        assert process.stdout.readline() == "has it\n"
        said = r"out is in use by another process, or elsewhere in this one; wait for its end or choose another `out`$"
        with pytest.raises(UserError, match=said), locked(out):
            pass
        process.kill()
    with locked(out), pytest.raises(UserError, match="in use"), locked(out):
        pass
    assert list(out.iterdir()) == []


def test_many_at_once_are_never_two(tmp_path):
    """Processes that take the lock in turn, and remove its file each time, while they read and add
    one to a number."""
    (tmp_path / "number").write_text("0")
    code = f"""
from pathlib import Path
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.directory_lock import locked
out, n_done = Path({str(tmp_path)!r}), 0
while n_done < 10:
    try:
        with locked(out):
            (out / "number").write_text(str(int((out / "number").read_text()) + 1))
            n_done += 1
    except UserError:
        pass
"""
    processes = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    assert [process.wait() for process in processes] == [0] * 3
    assert (tmp_path / "number").read_text() == "30"


def test_a_link_in_the_place_of_the_lock_is_not_followed(tmp_path):
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".lock").symlink_to(tmp_path / "mine")
    with pytest.raises(UserError, match=r"\.lock cannot be written"), locked(tmp_path):
        pass
    assert (tmp_path / "mine").read_text() == "mine"
