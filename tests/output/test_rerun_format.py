"""What Rerun may never end is left alone; columns of components."""

import gc
import threading
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

from iswarm_mj.output import rerun_format
from iswarm_mj.output.rerun_format import RrdFile, bounded
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.utils.errors import UserError


@pytest.fixture
def unregistered(monkeypatch):
    """Counts how often Rerun was told not to wait for its streams at the process's end."""
    calls = []
    monkeypatch.setattr(rr, "unregister_shutdown", lambda: calls.append(1))
    return calls


def test_a_call_ends_fails_or_is_left_alone():
    done, never = [], threading.Event()
    bounded(lambda: done.append(1))
    assert done == [1]
    with pytest.raises(ZeroDivisionError):
        bounded(lambda: 1 / 0)
    with pytest.raises(TimeoutError, match="not done"):
        bounded(never.wait, 0.05)
    never.set()


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

    recording._file, recording._result = object.__new__(RrdFile), {}
    recording.stream = recording._file.stream = Stream()
    recording._file._path, recording._file._given = Path("a.rrd"), "a.rrd"
    with pytest.raises(UserError, match=r"'a.rrd' cannot be written \(it is gone\)"):
        recording.close()
    assert len(unregistered) == 1
    del recording
    gc.collect()
    assert forgotten == []


@pytest.mark.parametrize("content", [b"RRF2 and so on", b""])
def test_a_recording_without_its_end_is_told(tmp_path, unregistered, content):
    """As on a disk that is full only then, which Rerun logs and nothing else."""
    file = RrdFile("test", tmp_path / "cut.rrd", rrb.Blueprint())
    file.stream.disconnect()
    (tmp_path / "cut.rrd").write_bytes(content)
    with pytest.raises(UserError, match=r"cannot be written \(No space left"):
        file.close()


@pytest.mark.parametrize("lengths", [2, np.array([3, 0, 1, 2])])
def test_columns_are_those_of_rerun(lengths):
    n = 4 * lengths if isinstance(lengths, int) else lengths.sum()
    positions, numbers = np.arange(3.0 * n).reshape(n, 3), np.arange(n, dtype=np.int16)
    found = rerun_format.columns_of(rr.Points3D.from_fields(positions=positions), {"number": numbers}, 4, lengths)
    rows = [lengths] * 4 if isinstance(lengths, int) else lengths
    known = [*rr.Points3D.columns(positions=positions), *rr.AnyValues.columns(number=numbers)]
    assert [c.descriptor for c in found] == [c.descriptor for c in known]
    assert [c.as_arrow_array() for c in found] == [c.partition(rows).as_arrow_array() for c in known]


def test_columns_of_nothing_have_a_type():
    (column,) = rerun_format.columns_of(rr.Scalars([]), {}, 3, np.zeros(3, int))
    assert column.as_arrow_array().tolist() == [[], [], []]
    _, column = rerun_format.columns_of(rr.Scalars([]), {"id": np.zeros(0, np.int16)}, 3, 0)
    assert column.as_arrow_array().type.value_type == "int16"
