"""SIGINT, SIGTERM and SIGHUP end a command by an exception, so that `with` and `finally` save what there is."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

RETRY_S = 0.05
"""Time after which a signal is tried again that could not be raised."""


class Interrupted(KeyboardInterrupt):
    """A signal arrived."""


class _State:
    """Of this process; only its main thread handles signals."""

    depth = 0
    """Of blocks that postpone signals."""
    number: int | None = None
    """The first signal that arrived."""
    is_raised = False
    """Whether it was raised; later ones disturb nothing that is being saved."""


def handle_signals() -> None:
    """Raise `Interrupted` when a signal arrives; to be called in the main thread."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _arrived)
    signal.signal(signal.SIGALRM, _arrived)
    sys.unraisablehook = _swallowed


@contextmanager
def postponed() -> Iterator[None]:
    """Let signals wait for the end of the block."""
    _State.depth += 1
    try:
        yield
    finally:
        _State.depth -= 1
        if _State.number is not None:
            _arrived(_State.number, None)


@contextmanager
def saved(save: Callable[[], None]) -> Iterator[None]:
    """Have something saved at the end of the block, also if an exception leaves it, then perhaps a second time."""
    try:
        yield
        with postponed():
            save()
    except BaseException:
        with postponed(), suppress(Exception):  # what the block raised says more
            save()
        raise


def code_of_signal(error: BaseException) -> int | None:
    """Exit code of a process that this error ends because of a signal; None if there was none.

    Where libraries are loaded they make another error of the one that was raised.
    """
    number = _State.number
    if number is None and isinstance(error, KeyboardInterrupt):
        number = signal.SIGINT
    return None if number is None or isinstance(error, SystemExit) else 128 + number


def leave(code: int) -> None:
    """End the process after its output, without what Python does at its end.

    Libraries of which a signal interrupted the loading, or threads of which run on, may crash there.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def _arrived(number: int, frame: Any) -> None:
    """Handle a signal, or an alarm that tries it again."""
    if number != signal.SIGALRM:
        _State.number = _State.number or number
    if _State.number is None or _State.is_raised or _State.depth:
        return
    if _is_loading(frame):
        signal.setitimer(signal.ITIMER_REAL, RETRY_S)
        return
    _State.is_raised = True
    raise Interrupted


def _is_loading(frame: Any) -> bool:
    """Whether a module is being imported; libraries in C may crash if an exception comes while they begin."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _swallowed(about: Any) -> None:
    """Try again where Python only reports what was raised, such as in callbacks of its collector."""
    if isinstance(about.exc_value, Interrupted):
        _State.is_raised = False
        signal.setitimer(signal.ITIMER_REAL, RETRY_S)
    else:
        sys.__unraisablehook__(about)
