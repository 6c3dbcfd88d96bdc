"""Opens Rerun's viewer for a run that is shown live; it listens to this machine alone."""

import math
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import BinaryIO

from iswarm_mj.output.rerun_format import check_recordings
from iswarm_mj.utils.errors import UserError

HOST = "127.0.0.1"
SECONDS = 30.0
"""How long a viewer may take to appear [s]."""
SETTLING = 1.0
"""How long it must go on answering [s]."""
REMEDY = "leave out --live, and open the recording with `rerun` later"


def open_viewer(*, headless: bool = False) -> tuple[str, subprocess.Popen[bytes]]:
    """Start a viewer and wait until it shows its window; it stays when this process ends.

    Args:
        headless: without a window, for pictures of what it would show.

    Returns:
        The address for `LiveRecording`, and the viewer's process.

    Raises:
        UserError: no viewer can be had here, for instance since there is no display, or the environment disables Rerun.
    """
    import rerun_cli

    check_recordings()
    program = Path(rerun_cli.__file__).parent / ("rerun.exe" if sys.platform == "win32" else "rerun")
    port = _free_port()
    flags = ["--bind", HOST, "--port", str(port), "--hide-welcome-screen", *(["--headless"] if headless else [])]
    with tempfile.TemporaryFile() as said:
        try:
            viewer = subprocess.Popen(
                [program, *flags],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said,
                env=os.environ | {"RERUN_ANALYTICS": "0"},
                start_new_session=True,  # so that Ctrl-C ends the run alone
            )
        except OSError as error:
            raise UserError(f"no viewer can be started ({error.strerror or error}); {REMEDY}.") from None
        try:
            _wait(viewer, port, said)
        except BaseException:
            viewer.kill()
            viewer.wait()
            raise
    return f"rerun+http://{HOST}:{port}/proxy", viewer


def _free_port() -> int:
    with socket.socket() as found:
        found.bind((HOST, 0))
        return found.getsockname()[1]


def _wait(viewer: subprocess.Popen[bytes], port: int, said: BinaryIO) -> None:
    """Wait until the viewer answers, and a little longer: one that cannot draw may answer before it ends."""
    from rerun.experimental import ViewerClient

    end, settled = time.monotonic() + SECONDS, math.inf
    while time.monotonic() < end:
        if viewer.poll() is not None:
            raise UserError(f"no viewer can be shown here ({_reason(said)}); {REMEDY}.")
        if time.monotonic() >= settled:
            return
        try:
            ViewerClient.connect(f"rerun+http://{HOST}:{port}/proxy").get_state()
            settled = min(settled, time.monotonic() + SETTLING)
        except (ConnectionError, RuntimeError, ValueError, OSError):
            settled = math.inf
        time.sleep(0.1)
    raise UserError(f"no viewer appeared within {SECONDS:.0f} s; {REMEDY}.")


def _reason(said: BinaryIO) -> str:
    """Why a viewer ended: its panic if it had one, or else its last words without their place."""
    said.seek(0)
    text = said.read().decode(errors="replace")
    if found := re.search(r"panicked at '(.+)'", text):
        return found[1]
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1].rsplit(": ", 1)[-1].rstrip(".") if lines else "it ended without a word"
