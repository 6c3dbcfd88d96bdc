"""What Rerun may never end is left alone; columns of components."""

import gc
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from iswarm_mj.output import rerun_format
from iswarm_mj.output.rerun_format import RrdFile
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.utils.errors import UserError


@pytest.fixture
def unregistered(monkeypatch):
    """Counts how often Rerun was told not to wait for its streams at the process's end."""
    calls = []
    monkeypatch.setattr(rr, "unregister_shutdown", lambda: calls.append(1))
    return calls


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
        recording.__exit__(None, None, None)
    recording.__exit__(ValueError, ValueError(), None)  # says more
    assert len(unregistered) == 2
    del recording
    gc.collect()
    assert forgotten == []


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
