"""Names of files that the system refuses, and output that goes nowhere: one sentence, exit code 2."""

import os
import re
import subprocess
import sys

import pytest
from helpers_signals import SMALL


def refused(*arguments, **more):
    """The error output of a command that is refused."""
    command = [sys.executable, "-m", "iswarm_mj", *arguments]
    done = subprocess.run(command, capture_output="stdout" not in more, **more)
    error = done.stderr.decode()
    assert done.returncode == 2 and re.fullmatch(r"(iswarm: (placing|compiling) [^\n]+\n)*iswarm: [^\n]+\n", error), (
        error
    )
    return error


LONG = "n" * 300


@pytest.mark.parametrize(
    "arguments",
    [
        ["clean", "--genome", LONG],
        ["clean", "--out", LONG],
        ["clean", "--out", ""],
        ["clean", "--out="],
        ["picture", LONG],
        ["video", "--out", LONG + ".mp4"],
        ["report", "--results", LONG],
        ["report", "--results", ".", "--beside", LONG],
        ["report", "--results", ".", "--out", LONG + ".html"],
        ["clean", "--genome", b"not-text-\xff"],
    ],
    ids=lambda arguments: "-".join(str(a)[:12] for a in arguments),
)
def test_names(tmp_path, arguments):
    refused(*arguments, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
def test_output_to_a_full_disk(tmp_path):
    with open("/dev/full", "w") as full:
        said = refused("clean", *SMALL, "--steps=2", f"--out={tmp_path}", stdout=full, stderr=subprocess.PIPE)
    assert "No space left on device" in said
    assert (tmp_path / "result.json").exists()
