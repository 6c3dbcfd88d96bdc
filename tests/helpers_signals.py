"""Commands in processes of their own, to which signals are sent."""

import os
import subprocess
import sys

ARENA = {"size": 15, "dump-size": 3, "dust-area-size": 3, "dust-area-offset": 5, "n-dust": 24}
SMALL = [*(f"--arena.{name}={value}" for name, value in ARENA.items()), "--robots=30", "--threads=1"]
ENDLESS = [*SMALL, "--steps=100000", "--gripper.release-voltage=3"]  # at which no ball is ever released


def start(*arguments, before="", **more):
    """A process of `iswarm`, after some Python code; its error output is text, `more` is for `Popen`."""
    code = f"{before}\nimport sys\nfrom iswarm_mj.__main__ import main\nmain()"
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.Popen(command, stdout=-1, stderr=-1, text=True, env=environment, **more)
