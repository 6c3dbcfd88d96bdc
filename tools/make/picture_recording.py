"""Take a picture of a recording as Rerun's viewer shows it, without a window.

    python tools/make/picture_recording.py runs/clean/clean.rrd docs/grasp-in-swarm.png --time 11.0

Needs a Vulkan driver (`apt-get install mesa-vulkan-drivers`).
"""

import argparse
import time
from datetime import timedelta
from pathlib import Path

from rerun.experimental import ViewerClient

RETRIES = 4
"""Number of further calls after a timeout."""
PAUSE = 5.0
"""Time between two calls [s]."""


def call_patiently(function, *arguments, **keywords):
    """Return the result of a call of the viewer, which a busy machine may answer too late."""
    for _ in range(RETRIES):
        try:
            return function(*arguments, **keywords)
        except TimeoutError:
            time.sleep(PAUSE)
    return function(*arguments, **keywords)


def main():
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
    args = parser.parse_args()

    recording = str(args.recording.absolute())
    picture = str(args.picture.absolute())
    moment = timedelta(seconds=args.time)
    spawned = call_patiently(
        ViewerClient.spawn, headless=True, port=args.port, hide_welcome_screen=True
    )
    with spawned as viewer:
        call_patiently(viewer.open, recording)
        time.sleep(args.patience)
        call_patiently(viewer.set_time, "sim_time", duration=moment, play_state="paused")
        time.sleep(args.patience)
        call_patiently(viewer.save_screenshot, picture)
        time.sleep(args.patience / 4)


if __name__ == "__main__":
    main()
