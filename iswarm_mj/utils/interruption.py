"""SIGINT, SIGTERM and SIGHUP: they end a command at once, and let it save what it has."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, ClassVar

GRACE_S = 0.4
"""Time in which Python should notice a signal; longer than this it does not while it compiles, for example."""
PARTING_S = 0.4
"""Time in which a command that has nothing to save should end after that."""
BUSY = threading.RLock()
"""Held while that is changed which is saved."""
MESSAGE = "iswarm: interrupted; anything recorded so far is kept."


class Interrupted(KeyboardInterrupt):
    """A signal arrived."""


class _State:
    """Of this process; only its main thread handles signals."""

    depth = 0
    """Of blocks that postpone signals."""
    waiting: int | None = None
    """The signal that was postponed."""
    is_noticed = False
    """Whether the exception was raised."""
    number: int | None = None
    """The signal for which it was."""
    is_lost = False
    """Whether something swallowed it."""
    is_told = False
    """Whether the user was told."""
    savers: ClassVar[list[Callable[[], None]]] = []
    tidiers: ClassVar[list[Callable[[], None]]] = []
    """Called at the very end."""


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise `Interrupted` in the block when a signal arrives; to be used in the main thread, once in a process.

    What never comes to notice it, since it compiles for example, is ended by a thread, after what is to be saved was.
    """
    numbers = [n for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) != signal.SIG_IGN]
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    for number in numbers:
        signal.signal(number, _arrived)
    signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    sys.unraisablehook = _swallowed
    threading.Thread(target=_watch, args=(reader, numbers), daemon=True).start()
    yield


@contextmanager
def postponed() -> Iterator[None]:
    """Let signals wait for the end of the block."""
    _State.depth += 1
    try:
        yield
    finally:
        _State.depth -= 1
        if _State.waiting is not None and not _State.depth:
            _arrived(_State.waiting, None)


@contextmanager
def saved(save: Callable[[], None]) -> Iterator[None]:
    """Have something saved if an exception leaves the block, or a signal ends the process in it.

    Args:
        save: saves it; called with `BUSY`, in any thread.
    """
    _State.savers.append(save)
    try:
        yield
    except BaseException:
        with postponed(), BUSY, suppress(Exception):  # what the block raised says more
            save()
        raise
    finally:
        _State.savers.remove(save)


@contextmanager
def tidied(begin: Callable[[], Callable[[], None]]) -> Iterator[None]:
    """Have something undone when the block ends, also where a signal ends the process in it.

    Args:
        begin: does it, and returns what undoes it; both are called with `BUSY`, the latter once, in any thread.
    """
    with ExitStack() as stack:
        with postponed(), BUSY:
            undo = begin()
            _State.tidiers.append(undo)
            stack.callback(_tidy, undo)
        yield


def _tidy(undo: Callable[[], None]) -> None:
    with postponed(), BUSY:
        _State.tidiers.remove(undo)
        undo()


def code_of_signal(error: BaseException) -> int | None:
    """Exit code of a process that this error ends because of a signal; None if there was none.

    Where libraries are loaded they make another error of the one that was raised.
    """
    number = _State.number
    if number is None and isinstance(error, KeyboardInterrupt):
        number = signal.SIGINT
    return None if number is None or isinstance(error, SystemExit) else 128 + number


def tell() -> None:
    """Tell the user once, on the standard error, that the command was interrupted."""
    if not _State.is_told:
        _State.is_told = True
        with suppress(OSError, ValueError):
            print(MESSAGE, file=sys.stderr)


def leave(code: int) -> None:
    """End the process after its output and what tidies up, without what Python does at its end.

    Libraries of which a signal interrupted the loading, or threads of which run on, may crash there.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    for undo in reversed(_State.tidiers):  # last, since locks go with it
        with suppress(Exception):
            undo()
    os._exit(code)


def _arrived(number: int, frame: Any) -> None:
    """Handle a signal, unless it is the second one; where a library is loaded, leave it to the thread."""
    if _State.depth:
        _State.waiting = number
    elif _is_loading(frame):
        return
    elif not _State.is_noticed:
        _State.is_noticed, _State.number = True, number
        raise Interrupted


def _is_loading(frame: Any) -> bool:
    """Whether a module is being imported; libraries in C may crash if an exception comes while they begin."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _swallowed(about: Any) -> None:
    """Remember that the exception was raised where Python only reports it, such as in callbacks of its collector."""
    if isinstance(about.exc_value, Interrupted):
        _State.is_lost = True
    else:
        sys.__unraisablehook__(about)


def _watch(reader: int, numbers: list[int]) -> None:
    """Wait for a signal, and see to it that the process ends."""
    number = 0
    while number not in numbers:
        number = os.read(reader, 1)[0]
    arrived = time.monotonic()
    while True:
        time.sleep(0.05)
        late = time.monotonic() - arrived
        if _State.is_lost:
            _State.is_lost = _State.is_noticed = False
            signal.pthread_kill(threading.main_thread().ident or 0, number)
        if late > GRACE_S and (not _State.is_noticed or (late > GRACE_S + PARTING_S and not _State.savers)):
            with BUSY:
                if not _State.is_noticed or not _State.savers:
                    _save_and_leave(128 + number)


def _save_and_leave(code: int) -> None:
    """Save everything and end the process, whatever its main thread does."""
    for save in reversed(_State.savers):
        with suppress(Exception):
            save()
    tell()
    leave(code)
