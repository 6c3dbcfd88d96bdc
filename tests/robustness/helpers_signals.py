"""Commands in processes of their own, to which signals are sent."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager

from helpers_small import FLAGS

SMALL = [*FLAGS, "--robots=30", "--threads=1"]
ENDLESS = [*SMALL, "--steps=100000", "--gripper.release-voltage=3"]  # at which no ball is ever released


@contextmanager
def heeded():
    """Let processes that are started in the block heed signals which this one ignores, as under nohup."""
    ignored = [n for n in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM) if signal.getsignal(n) == signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    try:
        yield
    finally:
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)


def start(*arguments, before="", **more):
    """A process of `iswarm`, after some Python code; its error output is text, `more` is for `Popen`."""
    code = f"{before}\nimport sys\nfrom iswarm_mj.__main__ import main\nmain()"
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    with heeded():
        return subprocess.Popen(command, stdout=-1, stderr=-1, text=True, env=environment, **more)
