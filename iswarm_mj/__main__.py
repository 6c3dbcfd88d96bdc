"""The program `iswarm`, and `python -m iswarm_mj`."""

import signal


def main() -> None:
    """Run the command of this process's arguments; until its handlers are set, an interruption ends it silently."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from iswarm_mj.commands.main import main as run

    run()


if __name__ == "__main__":
    main()
