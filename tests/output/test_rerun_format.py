"""What Rerun may never end is left alone."""

import gc
import threading

import pytest
import rerun as rr

from iswarm_mj.output.rerun_format import bounded
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.utils.errors import UserError


@pytest.fixture
def unregistered(monkeypatch):
    """Counts how often Rerun was told not to wait for its streams at the process's end."""
    calls = []
    monkeypatch.setattr(rr, "unregister_shutdown", lambda: calls.append(1))
    return calls


def test_what_ends_has_ended(unregistered):
    done = []
    bounded(lambda: done.append(1))
    assert (done, unregistered) == ([1], [])


def test_its_errors_are_raised(unregistered):
    with pytest.raises(ZeroDivisionError):
        bounded(lambda: 1 / 0)
    assert unregistered == []


def test_what_does_not_end_is_an_error(unregistered):
    never = threading.Event()
    with pytest.raises(RuntimeError, match=r"not done within 0.05 s"):
        bounded(never.wait, 0.05)
    never.set()
    assert unregistered == [1]


def test_a_recording_that_cannot_be_closed_is_told(unregistered):
    """As on a disk that became full; Python never forgets its stream, for whose thread Rerun would wait."""
    forgotten = []
    recording = object.__new__(Recording)

    class Stream:
        def flush(self, timeout_sec):
            pass

        def disconnect(self):
            raise RuntimeError("it is gone")

        def __del__(self):
            forgotten.append(self)

    recording._path, recording._stream, recording._result = "a.rrd", Stream(), {}
    with pytest.raises(UserError, match=r"'a.rrd' could not be written to its end \(it is gone\)"):
        recording.__exit__(None, None, None)
    recording.__exit__(ValueError, ValueError(), None)  # says more
    assert len(unregistered) == 2
    del recording
    gc.collect()
    assert forgotten == []
