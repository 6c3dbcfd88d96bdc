"""A picture of a recording as Rerun's viewer shows it, without a window.

    python tools/make/picture_recording.py runs/clean/clean.rrd docs/grasp-in-swarm.png --time 11.00045

Needs a Vulkan driver (`apt-get install mesa-vulkan-drivers`).
"""

import argparse
import time
from datetime import timedelta
from pathlib import Path

from rerun.experimental import ViewerClient


def patient(call, *given, **named):
    """Return what a call of the viewer returns; it is asked again where a busy machine let it answer too late."""
    for _ in range(4):
        try:
            return call(*given, **named)
        except TimeoutError:
            time.sleep(5)
    return call(*given, **named)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--time", type=float, required=True, help="on the timeline sim_time [s]")
    parser.add_argument("--port", type=int, default=9977)
    parser.add_argument("--patience", type=float, default=20.0, help="for the viewer to show it [s]")
    args = parser.parse_args()
    with patient(ViewerClient.spawn, headless=True, port=args.port, hide_welcome_screen=True) as viewer:
        patient(viewer.open, str(args.recording.absolute()))
        time.sleep(args.patience)
        patient(viewer.set_time, "sim_time", duration=timedelta(seconds=args.time), play_state="paused")
        time.sleep(args.patience)
        patient(viewer.save_screenshot, str(args.picture.absolute()))
        time.sleep(args.patience / 4)


if __name__ == "__main__":
    main()
