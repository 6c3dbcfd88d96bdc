"""Calls in worker processes: whoever dies, nothing is left running and a sentence is said."""

import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from types import SimpleNamespace

import psutil
import pytest

from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.pool import _connected, unordered

LIMIT = 600
"""Longest time for something that has to happen [s]."""


def square(number):
    return number**2


def slow_but_first(number):
    if number:
        time.sleep(LIMIT)
    return number


def faulty(number):
    if number == 3:
        raise SimulationFault("step 8: gone")
    return number


def dying(number):
    os._exit(9)


def place(number):
    """Process and thread of a call."""
    return os.getpid()


def confused(number):
    raise ValueError("no idea")


def reading(number):
    raise EOFError("the file ended")


def environment(name):
    return os.environ.get(name)


def has_no_input(number):
    """Return true if the standard input of this process is the null device."""
    return os.path.samestat(os.fstat(0), os.stat(os.devnull))


def results(call, numbers, *how):
    with closing(unordered(call, ((number,) for number in numbers), *how)) as returned:
        return sorted(returned)


def workers_of(parent):
    """Return the workers of a process."""
    children = psutil.Process(parent).children()
    return [child for child in children if "iswarm_mj.utils.worker" in child.cmdline()]


@pytest.mark.parametrize("workers", [1, 2])
def test_every_call_is_made_once(workers):
    assert results(square, range(7), workers) == [number**2 for number in range(7)]
    assert results(square, [], workers) == []


def test_workers_start_once_and_see_no_gpu():
    assert len({*results(place, range(9), 2), *results(place, range(9), 2)} - {os.getpid()}) <= 2
    assert results(environment, ["JAX_PLATFORMS"], 2) == ["cpu"]


def test_workers_wait_at_no_standard_input():
    """On Windows, libraries that a worker loads would wait for its reads of standard input."""
    assert results(has_no_input, range(2), 2) == [True, True]


def test_a_lost_worker_is_reported_and_the_next_call_works():
    with pytest.raises(SimulationFault, match=r"worker process was lost.*fewer workers$"):
        results(dying, range(3), 2)
    assert results(square, [3], 2) == [9]


def test_workers_that_die_between_calls_are_replaced():
    results(square, range(3), 2)
    waiting = workers_of(os.getpid())
    for worker in waiting:
        worker.kill()
    psutil.wait_procs(waiting, LIMIT)
    assert results(square, [3, 4, 5], 2) == [9, 16, 25]
    assert not set(waiting) & set(workers_of(os.getpid()))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_fault_is_raised_and_the_next_call_works(workers):
    with pytest.raises(SimulationFault, match=r"^step 8: gone$"):
        results(faulty, range(9), workers)
    assert results(square, [3], workers) == [9]


@pytest.mark.parametrize("call", [confused, reading])
def test_an_error_in_a_worker_comes_with_its_traceback(call):
    with pytest.raises((ValueError, EOFError)) as raised:
        results(call, range(3), 2)
    assert f", in {call.__name__}" in raised.value.__notes__[0]


class OfAScript:
    """A class of a script, which workers cannot import."""


def test_work_that_a_worker_cannot_read_is_refused_in_a_sentence(monkeypatch):
    script = sys.modules["__main__"]
    monkeypatch.setattr(script, "OfAScript", OfAScript, raising=False)
    monkeypatch.setattr(OfAScript, "__module__", "__main__")
    with pytest.raises(UserError, match=r"cannot read its work .*; define classes in a module"):
        results(square, [OfAScript(), OfAScript()], 2)
    assert results(square, [3], 2) == [9]


@pytest.mark.filterwarnings("error")
def test_closing_it_early_stops_the_workers():
    with closing(unordered(slow_but_first, ((number,) for number in range(4)), 2)) as returned:
        assert next(returned) == 0
    assert results(square, [3], 2) == [9]


CALLS = """
import os, time

def work(number):
    if "HAS_WORKED" in os.environ:  # so that the end comes within calls
        time.sleep(600)
    os.environ["HAS_WORKED"] = "1"
    return os.getpid()
"""
SCRIPT = """
import signal, sys
from calls import work
from iswarm_mj.utils.pool import unordered

# It is ignored where the tests run in the background of a shell.
signal.signal(signal.SIGINT, signal.default_int_handler)
workers = set()
try:
    for pid in unordered(work, ((number,) for number in range(99)), 2):
        if pid not in workers:
            print("one more", flush=True)
        workers.add(pid)
except KeyboardInterrupt:
    print("interrupted", flush=True)
    sys.exit(130)
"""
"""A script that workers must not run again: it has no `if __name__ == "__main__"`."""


@pytest.mark.parametrize(
    "is_killed",
    [
        pytest.param(
            False,
            id="interrupted",
            marks=pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signal"),
        ),
        pytest.param(True, id="killed"),
    ],
)
def test_workers_end_with_their_parent(tmp_path, is_killed):
    script = tmp_path / "many.py"
    script.write_text(SCRIPT)
    script.with_name("calls.py").write_text(CALLS)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(
        [sys.executable, script], **pipes, text=True, start_new_session=True
    ) as process:
        assert [process.stdout.readline() for _ in range(2)] == ["one more\n"] * 2
        workers = workers_of(process.pid)
        assert len(workers) == 2
        if is_killed:
            process.kill()
            process.wait(timeout=LIMIT)
        else:  # as a terminal does, to the workers too
            os.killpg(process.pid, signal.SIGINT)
            out, error = process.communicate(timeout=LIMIT)
            assert process.returncode == 130
            assert out.endswith("interrupted\n")
            assert "Traceback" not in error
    assert psutil.wait_procs(workers, LIMIT)[1] == []


def test_a_sentence_names_ray_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(UserError, match=r'^the package ray is not installed; .*\[cluster\]"$'):
        results(square, [1], 1, "ray")


def test_ray_keeps_our_handlers_and_tells_nobody(monkeypatch):
    """Ray replaces the handler of SIGTERM when it begins, and would send statistics of its
    usage."""
    told = []

    def begin(**_):
        told.append(os.environ["RAY_USAGE_STATS_ENABLED"])
        signal.signal(signal.SIGTERM, lambda *_: None)

    def raise_system_exit(*_):
        raise SystemExit

    monkeypatch.delenv("RAY_USAGE_STATS_ENABLED", raising=False)
    monkeypatch.setitem(
        sys.modules, "ray", SimpleNamespace(is_initialized=lambda: False, init=begin)
    )
    before = signal.signal(signal.SIGTERM, raise_system_exit)
    try:
        _connected(1)
        assert signal.getsignal(signal.SIGTERM) is raise_system_exit
    finally:
        signal.signal(signal.SIGTERM, before)
        os.environ.pop("RAY_USAGE_STATS_ENABLED", None)
    assert told == ["0"]


@pytest.fixture(scope="module")
def ray():
    """Ray, if it is there, stopped in the end."""
    ray = pytest.importorskip("ray")
    yield ray
    ray.shutdown()


def test_ray_does_the_same(ray):
    assert results(square, range(7), 2, "ray") == [number**2 for number in range(7)]
    assert results(environment, ["JAX_PLATFORMS"], 2, "ray") == ["cpu"]
    with pytest.raises(SimulationFault, match=r"^step 8: gone$"):
        results(faulty, range(4), 2, "ray")
    with pytest.raises(SimulationFault, match="worker process was lost"):
        results(dying, range(3), 2, "ray")
