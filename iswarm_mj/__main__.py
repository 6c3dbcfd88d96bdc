"""The program `iswarm`, and `python -m iswarm_mj`."""

import gc
import signal


def main() -> None:
    """Run the command of this process's arguments; until its handlers are set, an interruption ends it silently."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    gc.set_threshold(50_000, 20, 20)  # tracing makes many objects that stay: the default takes 1 of 5.5 s of a start
    from iswarm_mj.commands.main import main as run

    run()


if __name__ == "__main__":
    main()
