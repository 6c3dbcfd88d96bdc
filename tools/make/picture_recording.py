"""Take a picture of a recording as Rerun's viewer shows it, without a window.

    python tools/make/picture_recording.py runs/clean/clean.rrd docs/grasp-in-swarm.png --time 11.0

Needs a Vulkan driver (`apt-get install mesa-vulkan-drivers`).
"""

import argparse
import time
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

from rerun.experimental import ViewerClient

RETRIES = 4
"""Number of further calls after a timeout."""
PAUSE = 5.0
"""Time between two calls [s]."""


def call_patiently(function: Callable[..., Any], *arguments: Any, **keywords: Any) -> Any:
    """Return the result of a call of the viewer, which a busy machine may answer too late."""
    for _ in range(RETRIES):
        try:
            return function(*arguments, **keywords)
        except TimeoutError:
            time.sleep(PAUSE)
    return function(*arguments, **keywords)


def take(recording: Path, picture: Path, moment: timedelta, port: int, patience: float) -> None:
    """Write the picture of a recording at a moment.

    Args:
        recording: file for Rerun.
        picture: file to write.
        moment: on the timeline sim_time.
        port: of the viewer, on this machine.
        patience: time that the viewer has to show something [s].
    """
    spawned = call_patiently(ViewerClient.spawn, headless=True, port=port, hide_welcome_screen=True)
    with spawned as viewer:
        call_patiently(viewer.open, str(recording.absolute()))
        time.sleep(patience)
        call_patiently(viewer.set_time, "sim_time", duration=moment, play_state="paused")
        time.sleep(patience)
        call_patiently(viewer.save_screenshot, str(picture.absolute()))
        time.sleep(patience / 4)


def main() -> None:
    """Take the picture that arguments describe."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recording", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--time", type=float, required=True, help="on the timeline sim_time [s]")
    parser.add_argument("--port", type=int, default=9977)
    parser.add_argument(
        "--patience", type=float, default=20.0, help="for the viewer to show it [s]"
    )
    arguments = parser.parse_args()
    take(
        arguments.recording,
        arguments.picture,
        timedelta(seconds=arguments.time),
        port=arguments.port,
        patience=arguments.patience,
    )


if __name__ == "__main__":
    main()
