"""Signals end a process whatever its main thread does, after it has saved what there is."""

import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

HEED_SIGNALS = """
import signal

for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
    signal.signal(number, signal.SIG_DFL)
"""
"""Heed signals that this process ignores."""
BEGIN = """
import ctypes, sys, threading, time
from pathlib import Path
from iswarm_mj.utils import signals
from iswarm_mj.utils.signals import (
    code_of_signal, completing, handle_signals, leave, postponed, saved
)

out = Path(sys.argv[1])

def save():
    (out / "saved").write_text("saved")

def begin(**limits):
    for name, value in limits.items():
        setattr(signals, name, value)
    handle_signals(lambda: "farewell")

def announce():
    print("now", flush=True)

def stay_in_c():
    mutex = ctypes.create_string_buffer(64)
    for _ in range(2):  # whoever locks it twice waits without end, and no signal interrupts that
        ctypes.CDLL(None).pthread_mutex_lock(mutex)

def run(work):
    try:
        with saved(save):
            threading.Timer(0.5, announce).start()  # by when the work has begun
            work()
    except BaseException as error:
        leave(code_of_signal(error) or 1)
"""
"""Functions of the programs below, whose first argument is the directory for what they save."""
DROPPED_ONCE = """
def work():
    try:
        time.sleep(600)
    except KeyboardInterrupt:  # as code in C may
        pass
    time.sleep(600)
begin(RETRY_S=0.05, GRACE_S=600.0)
run(work)
"""
ALWAYS_DROPPED = """
def work():
    while True:
        try:
            time.sleep(600)
        except KeyboardInterrupt:
            pass
begin(RETRY_S=0.05, GRACE_S=0.5)
run(work)
"""
IN_C = """
begin(GRACE_S=0.2)
run(stay_in_c)
"""
COMPUTING = """
def work():
    with postponed():  # a computation, not files
        stay_in_c()
begin(GRACE_S=0.2)
run(work)
"""
DROPPED_WITHOUT_PIPE = """
def work():
    for _ in range(2):
        try:
            time.sleep(600)
        except KeyboardInterrupt:
            signal.set_wakeup_fd(-1)  # as a library may
    time.sleep(600)
begin(RETRY_S=0.05, GRACE_S=600.0)
run(work)
"""
FAILING_FAREWELL = """
def say():
    raise ValueError
signals.GRACE_S = 0.2
handle_signals(say)
run(stay_in_c)
"""
COMPLETING = """
def work():
    with completing():
        time.sleep(2.0)
        save()
begin(GRACE_S=0.1)
run(work)
"""


@contextmanager
def started(tmp_path, code):
    """Start a process, and yield it when it has announced that its work begins."""
    command = [sys.executable, "-c", HEED_SIGNALS + BEGIN + code, str(tmp_path)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True, cwd=Path(__file__).parents[2]) as process:
        try:
            assert process.stdout.readline() == "now\n", process.communicate()
            yield process
        finally:
            process.kill()


def check_end(process, number, output=("", "")):
    """Check that a process ends by a signal, and what it prints until then.

    Args:
        process: that the signal was sent to.
        number: of the signal.
        output: text on stdout and on stderr; None for any.
    """
    printed = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    if output is not None:
        assert printed == output


def saved_text(directory):
    """Return what a process has saved."""
    return (directory / "saved").read_text()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize(
    ("code", "farewell"),
    [
        (DROPPED_ONCE, ""),
        (DROPPED_WITHOUT_PIPE, ""),
        (ALWAYS_DROPPED, "farewell\n"),
        (IN_C, "farewell\n"),
        (COMPUTING, "farewell\n"),
        (FAILING_FAREWELL, ""),
    ],
)
def test_a_process_ends_after_it_saved(tmp_path, number, code, farewell):
    with started(tmp_path, code) as process:
        process.send_signal(number)
        check_end(process, number, ("", farewell))
    assert saved_text(tmp_path) == "saved"


def test_a_process_ends_whose_terminal_is_gone(tmp_path):
    with started(tmp_path, IN_C) as process:
        process.stderr.close()
        process.send_signal(signal.SIGHUP)
        assert process.wait(timeout=60) == 128 + signal.SIGHUP
    assert saved_text(tmp_path) == "saved"


def test_the_file_that_leads_to_the_page_is_removed(tmp_path):
    code = """
from iswarm_mj.commands.play import redirect_file
def work():
    with redirect_file("http://127.0.0.1:8080/secret/") as file:
        (out / "name").write_text(str(file))
        stay_in_c()
begin(GRACE_S=0.2)
run(work)
"""
    with started(tmp_path, code) as process:
        file = Path((tmp_path / "name").read_text())
        assert file.exists()
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) == 128 + signal.SIGTERM
    assert not file.parent.exists()


def test_the_end_is_not_interrupted_after_an_error_that_hides_the_signal(tmp_path):
    code = """
def complete():
    with completing():
        while signals._State.number is None:
            time.sleep(0.01)
        time.sleep(2.0)
begin(RETRY_S=0.1, GRACE_S=600.0)
threading.Thread(target=complete).start()
threading.Timer(0.5, announce).start()
try:
    try:
        time.sleep(600)
    except KeyboardInterrupt:
        pass
    raise ValueError
except ValueError as error:
    leave(code_of_signal(error) or 1)
"""
    with started(tmp_path, code) as process:
        process.send_signal(signal.SIGTERM)
        check_end(process, signal.SIGTERM)


def test_signals_of_others_do_not_count_as_the_second(tmp_path):
    code = """
import os
def work():
    with postponed():
        while signals._State.number is None:
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGUSR1)
        time.sleep(1.0)
        (out / "rest").write_text("complete")
signal.signal(signal.SIGUSR1, lambda *_: None)
begin(GRACE_S=3600.0, RETRY_S=3600.0)
run(work)
"""
    with started(tmp_path, code) as process:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 128 + signal.SIGINT
    assert (tmp_path / "rest").read_text() == "complete"


def test_the_process_waits_for_files_that_are_being_completed(tmp_path):
    with started(tmp_path, COMPLETING) as process:
        process.send_signal(signal.SIGTERM)
        check_end(process, signal.SIGTERM, output=None)
    assert saved_text(tmp_path) == "saved"


def test_saving_at_the_end_is_not_interrupted_again(tmp_path):
    code = """
def work():
    try:
        time.sleep(600)
    finally:
        time.sleep(1.0)
        (out / "page").write_text("complete")
begin(RETRY_S=0.05, GRACE_S=600.0)
run(work)
"""
    with started(tmp_path, code) as process:
        process.send_signal(signal.SIGTERM)
        check_end(process, signal.SIGTERM)
    assert (tmp_path / "page").read_text() == "complete"


def test_imports_are_not_interrupted(tmp_path):
    """C libraries may crash if an exception comes while they begin."""
    (tmp_path / "library.py").write_text("""
import time
try:
    time.sleep(2.0)
except BaseException:
    print("disturbed", flush=True)
""")
    code = """
def work():
    sys.path.append(str(out))
    import library
    time.sleep(600)
begin(GRACE_S=600.0)
run(work)
"""
    with started(tmp_path, code) as process:
        process.send_signal(signal.SIGTERM)
        check_end(process, signal.SIGTERM)


def test_the_process_does_not_wait_without_end_for_files(tmp_path):
    code = """
def work():
    with completing():
        stay_in_c()
begin(GRACE_S=0.1, FILES_S=0.2)
run(work)
"""
    with started(tmp_path, code) as process:
        process.send_signal(signal.SIGTERM)
        check_end(process, signal.SIGTERM, output=None)
    assert not (tmp_path / "saved").exists()


def test_a_second_signal_ends_it_at_once(tmp_path):
    """A grace time of an hour would wait for the first one."""
    code = """
import os
def work():
    with postponed():
        os.kill(os.getpid(), signal.SIGUSR1)
        while signals._State.number is None:
            time.sleep(0.01)
        announce()
        stay_in_c()
signal.signal(signal.SIGUSR1, lambda *_: None)  # which others handle
begin(GRACE_S=3600.0, RETRY_S=3600.0)
run(work)
"""
    with started(tmp_path, code) as process:
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "now\n"
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        check_end(process, signal.SIGINT, output=None)
    assert saved_text(tmp_path) == "saved"


def test_other_threads_are_not_interrupted(tmp_path):
    code = """
def record():
    with postponed():
        while signals._State.number is None:
            time.sleep(0.01)
    (out / "recorded").write_text("all")
def work():
    thread = threading.Thread(target=record)
    thread.start()
    with postponed():
        thread.join()
begin(GRACE_S=600.0)
run(work)
"""
    with started(tmp_path, code) as process:
        process.send_signal(signal.SIGINT)
        check_end(process, signal.SIGINT)
    assert (tmp_path / "recorded").read_text() == "all"
