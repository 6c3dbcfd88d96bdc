"""What Linux, macOS and Windows do differently; all other modules are the same on each."""

import _thread
import ctypes
import os
import select
import shlex
import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from iswarm_mj.utils.errors import UserError, shown

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from multiprocessing.connection import Connection

IS_WINDOWS = sys.platform == "win32"


def n_usable_cores() -> int:
    """Return the number of cores that this process may use.

    macOS and Windows do not say which cores those are, so that all cores of the machine count.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def most_workers(n_workers: int) -> int:
    """Return the number of worker processes, at most as many as the system can wait for.

    `multiprocessing.connection.wait` waits for at most 63 handles on Windows.
    """
    return min(n_workers, 60) if IS_WINDOWS else n_workers


def ending_signals() -> tuple[signal.Signals, ...]:
    """Return the signals that ask a process to end, those that this system has.

    SIGHUP comes when a terminal closes; Windows sends SIGBREAK then, also for Ctrl-Break. When its
    console closes, Windows ends the process as soon as the handler has returned: finished runs of a
    search are kept, results of a run that is under way may be lost.
    """
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    return tuple(getattr(signal, name) for name in names if hasattr(signal, name))


def signal_main_thread(main_thread: int, number: int) -> None:
    """Let a signal arrive in the main thread again.

    Args:
        main_thread: identifier of the thread.
        number: number of the signal.
    """
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main_thread, number)  # which also interrupts a wait for the system
    else:
        _thread.interrupt_main(signal.Signals(number))


def can_be_written(descriptor: int) -> bool:
    """Return whether a write to a pipe or terminal would not wait; true where that is unknown."""
    if IS_WINDOWS:
        return True  # its `select` takes sockets only
    return bool(select.select([], [descriptor], [], 0.0)[1])


def own_group() -> dict[str, Any]:
    """Return arguments of `subprocess.Popen` for a process that Ctrl-C does not reach.

    Ctrl-C on a terminal reaches all processes of the group of the one that was started there. On
    Windows the process still belongs to the console, and ends when that closes.
    """
    if IS_WINDOWS:
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"process_group": 0}


def inheriting(connections: "Iterable[Connection]") -> dict[str, Any]:
    """Return arguments of `subprocess.Popen` for a process that gets ends of pipes.

    It opens each end by `inherited_connection` with the number `connection.fileno()`.
    """
    numbers = [connection.fileno() for connection in connections]
    if not IS_WINDOWS:
        return {"pass_fds": numbers}
    for number in numbers:
        os.set_handle_inheritable(number, True)
    return {"startupinfo": subprocess.STARTUPINFO(lpAttributeList={"handle_list": numbers})}


def inherited_connection(number: int) -> "Connection":
    """Return the end of a pipe that this process got from its parent, see `inheriting`."""
    from multiprocessing import connection

    if IS_WINDOWS:
        return connection.PipeConnection(number)
    return connection.Connection(number)


def shell_line(words: "Sequence[str]") -> str:
    """Return a command line that the shell of this system splits into these words."""
    return subprocess.list2cmdline(words) if IS_WINDOWS else shlex.join(words)


def split_words(text: str) -> list[str]:
    """Return the words of a text, with quotes as in a shell, see `shlex.join`.

    Backslashes are kept on all systems, since paths of Windows have them.

    Raises:
        UserError: a quotation has no end.
    """
    splitter = shlex.shlex(text, posix=True, punctuation_chars=False)
    splitter.whitespace_split = True
    splitter.commenters = ""
    splitter.escape = ""
    try:
        return list(splitter)
    except ValueError:
        raise UserError(f"a quotation in {shown(text)} has no end; close it") from None


def c_library() -> ctypes.CDLL:
    """Return the library of C's standard functions."""
    return ctypes.CDLL("ucrtbase" if IS_WINDOWS else None)
