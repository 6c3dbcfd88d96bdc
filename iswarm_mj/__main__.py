"""The program `iswarm`, and `python -m iswarm_mj`."""

import gc
import os
import signal
import sys


def main() -> None:
    """Run the command of this process's arguments; until its handlers are set, an interruption ends
    it silently."""
    _open_standard_streams()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    gc.set_threshold(
        50_000, 20, 20
    )  # tracing makes many objects that stay: the default takes 1 of 5.5 s of a start
    from iswarm_mj.commands.main import main as run

    run()


def _open_standard_streams() -> None:
    """Let streams that the shell closed, as `>&-` does, lead nowhere.

    Otherwise the next file that is opened gets the stream's number, and what libraries print.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # which gets the lowest number that is free
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


if __name__ == "__main__":
    main()
