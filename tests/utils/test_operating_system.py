"""Other operating systems in place of this one: what they lack is taken away."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from iswarm_mj.utils import operating_system

WITHOUT_NAMES_OF_POSIX = """
import fcntl, os, select, signal, sys
import psutil, subprocess  # which need some of what is taken away

for module, name in [
    (os, "sched_getaffinity"), (os, "register_at_fork"), (os, "fork"), (os, "set_blocking"),
    (signal, "SIGHUP"), (signal, "pthread_kill"), (select, "select"),
]:
    delattr(module, name)
sys.modules["resource"] = None

from iswarm_mj.utils import operating_system, signals
operating_system.IS_WINDOWS = signals.IS_WINDOWS = True

# Windows takes pipes that block, other systems only those that do not.
set_wakeup_fd = signal.set_wakeup_fd

def set_blocking_wakeup_fd(descriptor, **options):
    fcntl.fcntl(descriptor, fcntl.F_SETFL, os.O_NONBLOCK)
    return set_wakeup_fd(descriptor, **options)

signal.set_wakeup_fd = set_blocking_wakeup_fd
from iswarm_mj.commands.main import main
"""
"""What Windows lacks, taken away before the package is imported."""


def test_without_a_list_of_cores_all_count(monkeypatch):
    assert operating_system.n_usable_cores() == len(os.sched_getaffinity(0))
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert operating_system.n_usable_cores() == 7
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert operating_system.n_usable_cores() == 1


def test_the_signals_are_those_that_the_system_has(monkeypatch):
    names = [number.name for number in operating_system.ending_signals()]
    assert names == ["SIGINT", "SIGTERM", "SIGHUP"]
    monkeypatch.delattr(signal, "SIGHUP")
    monkeypatch.setattr(signal, "SIGBREAK", signal.SIGUSR1, raising=False)
    last_signal = operating_system.ending_signals()[-1]
    assert last_signal == signal.SIGUSR1


@pytest.mark.parametrize("has_pthreads", [True, False])
def test_a_thread_lets_a_signal_arrive_in_the_main_thread(monkeypatch, has_pthreads):
    arrived = []
    handler_before = signal.signal(signal.SIGUSR1, lambda number, _: arrived.append(number))
    if not has_pthreads:
        monkeypatch.delattr(signal, "pthread_kill")
    try:
        arguments = (threading.get_ident(), signal.SIGUSR1)
        thread = threading.Thread(target=operating_system.signal_main_thread, args=arguments)
        thread.start()
        thread.join()
        end = time.monotonic() + 60
        while not arrived and time.monotonic() < end:
            time.sleep(0.001)
    finally:
        signal.signal(signal.SIGUSR1, handler_before)
    assert arrived == [signal.SIGUSR1]


def test_a_full_pipe_cannot_be_written():
    reading, writing = os.pipe()
    try:
        os.set_blocking(writing, False)
        assert operating_system.can_be_written(writing)
        with pytest.raises(BlockingIOError):
            while True:
                os.write(writing, bytes(65536))
        assert not operating_system.can_be_written(writing)
    finally:
        os.close(reading)
        os.close(writing)


def test_a_command_runs_without_names_of_posix(tmp_path):
    command = "main(['fit', 'voltages.csv', '--out', 'fitted'])"
    table = "radius [um],humidity [%],voltage [V]\n15,10,24\n20,10,27\n"
    (tmp_path / "voltages.csv").write_text(table)
    run = subprocess.run(
        [sys.executable, "-c", WITHOUT_NAMES_OF_POSIX + command],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "fitted" / "fit.toml").is_file()


def test_a_signal_ends_a_command_without_names_of_posix():
    """The handlers work by threads and a queue alone."""
    code = WITHOUT_NAMES_OF_POSIX + (
        "import time\n"
        "signals.handle_signals(lambda: 'farewell')\n"
        "try:\n"
        "    signal.raise_signal(signal.SIGTERM)\n"
        "    time.sleep(60)\n"
        "except KeyboardInterrupt as error:\n"
        "    signals.leave(signals.code_of_signal(error))\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 128 + signal.SIGTERM, run.stderr
