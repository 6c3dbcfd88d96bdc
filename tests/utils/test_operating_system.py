"""Other operating systems in place of this one: what they lack is taken away."""

import ast
import os
import shlex
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from support.systems import NOT_ON_WINDOWS

from iswarm_mj.utils import operating_system
from iswarm_mj.utils.errors import UserError

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
MISSING_MODULES = {"fcntl", "grp", "pwd", "resource", "termios"}
"""Modules of Python that Windows lacks."""
MISSING_NAMES = {
    "os": {"fork", "getuid", "killpg", "mkfifo", "sched_getaffinity"},
    "signal": {"SIGALRM", "SIGHUP", "SIGKILL", "SIGSTOP", "SIGUSR1", "SIGUSR2", "pthread_kill"},
}
"""Names that modules of Python lack on Windows."""
needs_names_of_posix = pytest.mark.skipif(
    sys.platform == "win32", reason="there are no names of POSIX to take away"
)


def test_without_a_list_of_cores_all_count(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert operating_system.n_usable_cores() == 7
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert operating_system.n_usable_cores() == 1


@pytest.mark.parametrize(
    ("is_windows", "line"),
    [(False, r"iswarm --out 'C:\my runs' 'b\c'"), (True, r'iswarm --out "C:\my runs" b\c')],
)
def test_commands_are_quoted_for_the_shell_of_the_system(monkeypatch, is_windows, line):
    monkeypatch.setattr(operating_system, "IS_WINDOWS", is_windows)
    words = ["iswarm", "--out", r"C:\my runs", r"b\c"]
    assert operating_system.shell_line(words) == line
    assert operating_system.split_words(line) == words


@pytest.mark.parametrize(
    "words", [["it's", 'a "b"', "", "c # d"], [r"x\y.py:Walk=0.5", r"\\host\z"]]
)
def test_words_are_split_as_they_were_joined(words):
    assert operating_system.split_words(shlex.join(words)) == words


def test_a_quotation_without_an_end_is_refused():
    with pytest.raises(UserError, match="has no end; close it"):
        operating_system.split_words("it's")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a list of cores")
def test_the_listed_cores_count():
    assert operating_system.n_usable_cores() == len(os.sched_getaffinity(0))


@pytest.mark.parametrize(("is_windows", "expected"), [(False, [2, 128]), (True, [2, 60])])
def test_windows_waits_for_few_workers(monkeypatch, is_windows, expected):
    monkeypatch.setattr(operating_system, "IS_WINDOWS", is_windows)
    assert [operating_system.most_workers(number) for number in (2, 128)] == expected


@needs_names_of_posix
def test_the_signals_are_those_that_the_system_has(monkeypatch):
    names = [number.name for number in operating_system.ending_signals()]
    assert names == ["SIGINT", "SIGTERM", "SIGHUP"]
    monkeypatch.delattr(signal, "SIGHUP")
    monkeypatch.setattr(signal, "SIGBREAK", signal.SIGUSR1, raising=False)
    last_signal = operating_system.ending_signals()[-1]
    assert last_signal == signal.SIGUSR1


@needs_names_of_posix
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


@needs_names_of_posix
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


@needs_names_of_posix
@pytest.mark.slow
def test_commands_run_without_names_of_posix(tmp_path):
    """All but workers: how Windows hands pipes to processes cannot be shown elsewhere."""
    commands = (
        "main(['fit', 'voltages.csv', '--out', 'fitted'])\n"
        "main(['clean', '--engine', 'planar', '--robots', '4', '--steps', '2'])\n"
    )
    table = "radius [um],humidity [%],voltage [V]\n15,10,24\n20,10,27\n"
    (tmp_path / "voltages.csv").write_text(table)
    run = subprocess.run(
        [sys.executable, "-c", WITHOUT_NAMES_OF_POSIX + commands],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "fitted" / "fit.toml").is_file()
    assert (tmp_path / "runs" / "clean" / "result.json").is_file()


DROPPED_SIGNAL = """
import time

signals.GRACE_S = 1.0
signals.handle_signals(lambda: "farewell")
try:
    signal.raise_signal(signal.SIGTERM)
except KeyboardInterrupt:  # as a callback of C code drops it
    pass
"""
RETURNS_TO_PYTHON = """
signals.GRACE_S = 60.0
try:
    for _ in range(6000):
        time.sleep(0.01)
except KeyboardInterrupt as error:
    signals.leave(signals.code_of_signal(error))
"""
STAYS_IN_C = """
time.sleep(60)
"""


@needs_names_of_posix
@pytest.mark.parametrize(
    ("then", "expected"),
    [(RETURNS_TO_PYTHON, ""), (STAYS_IN_C, "farewell\n")],
    ids=["raised", "left"],
)
def test_a_dropped_signal_ends_a_command_without_names_of_posix(then, expected):
    """By threads and a queue alone, the exception is raised again, or the watcher leaves."""
    code = WITHOUT_NAMES_OF_POSIX + DROPPED_SIGNAL + then
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (128 + signal.SIGTERM, expected)


def run_at_import(node):
    """Yield the nodes of a module that run when it is imported: all but bodies of functions."""
    for child in ast.iter_child_nodes(node):
        yield child
        if isinstance(child, ast.Lambda):
            continue
        if isinstance(child, ast.FunctionDef):
            for outside in (*child.decorator_list, *child.args.defaults):
                yield outside
                yield from run_at_import(outside)
        else:
            yield from run_at_import(child)


def missing_names(tree):
    """Return what Windows lacks of the names that a module uses when it is imported."""
    missing = set()
    for node in run_at_import(tree):
        if isinstance(node, ast.Import):
            missing |= {alias.name for alias in node.names} & MISSING_MODULES
        elif isinstance(node, ast.ImportFrom):
            missing |= {node.module} & MISSING_MODULES
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            missing |= {node.attr} & MISSING_NAMES.get(node.value.id, set())
    return missing


def test_modules_of_tests_can_be_imported_on_windows():
    tests = Path(__file__).parents[1]
    found = {}
    for path in tests.rglob("*.py"):
        name = path.relative_to(tests).as_posix()
        missing = missing_names(ast.parse(path.read_text(encoding="utf-8")))
        if missing:
            found[name] = missing
    assert found.keys() == set(NOT_ON_WINDOWS), found
