"""SIGINT, SIGTERM and SIGHUP end a command by an exception, on which `with` and `finally` save.

Python raises the exception in the main thread, between two of its own instructions. C code may
return to Python after minutes only, such as a compiler, or drop the exception. A thread, which the
system wakes at the signal, therefore raises it again, and in the end saves the files and leaves.

Python's own handler with `finally` is plainer. SIGINT in the first control step of `mjx` (100
robots, on a shared AMD EPYC), 0.5 to 11.5 s after it began to compile, ended 12 processes each so:

| | `handle_signals`, `leave` | Python's own |
|---|---|---|
| exit code 130 | 12, within 0.5 s | 1, within 1.8 s |
| segmentation fault in Python's shutdown | 0 | 9, after 0.2 to 19 s |
| exception dropped in a callback of the collector of memory, and the run went on | 0 | 2 |

What each function is for: `postponed` and `completing` let no file be half written, `saved` writes
results of a run that C code does not let go, `kept_handlers` keeps what Ray would replace, `leave`
ends the process without that shutdown.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from types import FrameType
from typing import Any

from iswarm_mj.utils.operating_system import (
    IS_WINDOWS,
    can_be_written,
    ending_signals,
    signal_main_thread,
)

SIGNALS = ending_signals()
"""Signals that end a command."""
RETRY_S = 0.1
"""Time after which the exception is raised again [s]."""
GRACE_S = 4.0
"""Time for the main thread to end [s]; a second signal skips it. Saving may then take FILES_S more.

It is more than the 3 s in which the page closes (`player.page.CLOSE_S` and 1 s of viser).
"""
FILES_S = 30.0
"""Longest wait of the thread for files that are being completed [s]."""


class _State:
    """State of the handling of signals in this process."""

    number: int | None = None
    """The first signal that arrived."""
    depth = 0
    """Nesting of `postponed` blocks in the main thread."""
    saves: tuple[Callable[[], None], ...] = ()
    """Functions by which the open `saved` blocks save, the outermost first."""


_files = threading.RLock()
"""Held while files are being completed; the process does not leave meanwhile."""


def handle_signals(farewell: Callable[[], str]) -> None:
    """Raise KeyboardInterrupt when a signal arrives, and see to it that the process ends.

    To be called in the main thread.

    Args:
        farewell: returns the line to print if the exception cannot end the process.
    """
    pipe, wakeup = os.pipe()
    if not IS_WINDOWS:
        os.set_blocking(wakeup, False)  # which `set_wakeup_fd` wants on other systems
    signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _raise_interrupt)
    sys.unraisablehook = _report_unraisable

    arrivals: SimpleQueue[int] = SimpleQueue()
    threading.Thread(target=_read, args=(pipe, arrivals), daemon=True).start()
    arguments = (arrivals, threading.get_ident(), farewell)
    threading.Thread(target=_watch, args=arguments, daemon=True).start()


@contextmanager
def postponed() -> Iterator[None]:
    """Defer KeyboardInterrupt to the end of the block, by GRACE_S at most.

    Then the watcher saves and ends the process. No effect without `handle_signals`.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    _State.depth += 1
    try:
        yield
    finally:
        _State.depth -= 1
        if _State.number is not None:
            _raise_interrupt(_State.number, None)


@contextmanager
def completing() -> Iterator[None]:
    """Let the exception, and the end of the process, wait for files that the block completes."""
    with postponed(), _files:
        yield


@contextmanager
def saved(save: Callable[[], None]) -> Iterator[None]:
    """Save something at the end of the block, and also when an exception leaves it.

    To be used in the main thread.

    Args:
        save: may be called several times, also in another thread.
    """
    outer = _State.saves
    try:
        _State.saves = (*outer, save)
        yield
        with completing():
            save()
    except BaseException:
        with completing(), suppress(Exception):  # what the block raised says more
            save()
        raise
    finally:
        _State.saves = outer


@contextmanager
def kept_handlers() -> Iterator[None]:
    """Set handlers of signals again that a library replaces in the block, such as Ray SIGTERM's."""
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            is_of_python = handler is not None  # no other can be set
            if is_of_python and signal.getsignal(number) != handler:
                signal.signal(number, handler)


def code_of_signal(error: BaseException) -> int | None:
    """Return the exit code of a process that an error ends because of a signal; None without one.

    Libraries may have made another error of the exception.
    """
    number = _State.number
    if number is None and isinstance(error, KeyboardInterrupt):
        number = signal.SIGINT
    return None if number is None or isinstance(error, SystemExit) else 128 + number


def leave(code: int) -> None:
    """Flush the output, wait for files being completed, and end the process.

    Python's shutdown is left out: libraries may crash in it whose loading a signal interrupted, or
    whose threads run on.
    """
    _State.depth += 1  # an error that does not tell of the exception would let it come again here
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    _files.acquire(timeout=FILES_S)  # for good: nothing may be half written then
    os._exit(code)


def _raise_interrupt(number: int, frame: FrameType | None) -> None:
    """Handle a signal in the main thread."""
    _State.number = _State.number or number
    if not _State.depth and not _is_unwinding() and not _is_loading(frame):
        raise KeyboardInterrupt


def _is_unwinding() -> bool:
    """Return whether `with`, `finally` or `except` blocks are busy with the exception."""
    error = sys.exc_info()[1]
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__  # what a library made another error of
    return False


def _is_loading(frame: FrameType | None) -> bool:
    """Return whether a module is being imported.

    C libraries may crash if an exception comes while they begin: 3 of 105 signals during imports
    ended in a segmentation fault.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _read(pipe: int, arrivals: SimpleQueue[int]) -> None:
    """Put the numbers of our signals from a pipe into a queue.

    Python writes the number of each signal to the pipe, also while C code runs. Windows cannot wait
    for a pipe for a limited time, as the watcher waits for the queue.
    """
    while True:
        number = os.read(pipe, 1)[0]
        if number in SIGNALS:
            arrivals.put(number)


def _watch(arrivals: SimpleQueue[int], main_thread: int, farewell: Callable[[], str]) -> None:
    """Wait for a signal, and end the process if the exception does not.

    Args:
        arrivals: numbers of our signals.
        main_thread: identifier of the main thread.
        farewell: returns the line to print.
    """
    number = arrivals.get()
    end = time.monotonic() + GRACE_S
    is_echo_due = False
    while time.monotonic() < end:
        if not _arrives_soon(arrivals):
            # C code may have dropped the exception, or modules were being imported. This signal is
            # written to the pipe, too, unless a library has replaced the pipe or the handler.
            signal_main_thread(main_thread, number)
            is_echo_due = True
        elif is_echo_due:
            is_echo_due = False
        else:  # a second signal of the user
            break

    # In another thread, since a disk may let it wait without end.
    saver = threading.Thread(target=_save_and_exit, args=[128 + number, farewell], daemon=True)
    saver.start()
    saver.join(FILES_S)
    _exit(128 + number, farewell)


def _arrives_soon(arrivals: SimpleQueue[int]) -> bool:
    """Return whether one of our signals arrives within RETRY_S."""
    try:
        arrivals.get(timeout=RETRY_S)
    except Empty:
        return False
    return True


def _save_and_exit(code: int, farewell: Callable[[], str]) -> None:
    """End the process after saving what the open `saved` blocks save.

    This waits for files that are being completed.
    """
    with _files:
        for save in reversed(_State.saves):
            with suppress(Exception):
                save()
        _exit(code, farewell)


def _exit(code: int, farewell: Callable[[], str]) -> None:
    """Print a line on the standard error and end the process, also where it cannot be printed."""
    try:
        if can_be_written(2):  # else whoever reads the output may let it wait without end
            os.write(2, f"{farewell()}\n".encode())
    finally:  # the terminal may be gone, as at SIGHUP
        os._exit(code)


def _report_unraisable(about: Any) -> None:
    """Print nothing if Python drops the exception of a signal, which is raised again."""
    if not isinstance(about.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(about)
