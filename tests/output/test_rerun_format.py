"""Recordings for which there is no room; columns of components."""

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from support.files import full_disk

from iswarm_mj.output import rerun_format
from iswarm_mj.output.rerun_format import RrdFile
from iswarm_mj.utils.errors import UserError


@pytest.fixture
def unregistered(monkeypatch):
    """Counts how often Rerun was told not to wait for its streams at the process's end."""
    calls = []
    monkeypatch.setattr(rr, "unregister_shutdown", lambda: calls.append(1))
    return calls


def test_a_limit_of_files_is_named(tmp_path):
    """Rerun itself only logs it before it waits."""
    with full_disk(2**20 + 100_000):
        file = RrdFile("test", tmp_path / "clean.rrd", rrb.Blueprint())
        file.stream.log("points", rr.Points3D(np.random.default_rng(0).random((200_000, 3))))
        with pytest.raises(UserError, match="File too large"):
            file.flush()
    assert sorted(file.name for file in tmp_path.iterdir()) == [".clean.rrd.lock", "clean.rrd"]  # which is still open


@pytest.mark.parametrize("content", [b"RRF2 and so on", b""])
def test_a_recording_without_its_end_is_told(tmp_path, unregistered, content):
    """As on a disk that is full only then, which Rerun logs and nothing else."""
    file = RrdFile("test", tmp_path / "cut.rrd", rrb.Blueprint())
    file.stream.disconnect()
    (tmp_path / "cut.rrd").write_bytes(content)
    with pytest.raises(UserError, match=r"cannot be written \(No space left"):
        file.close()
    assert unregistered == [1]  # else Rerun would wait for a thread that has given up


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
