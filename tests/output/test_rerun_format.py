"""Recordings for which there is no space, and columns of components."""

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from support.files import full_disk

from iswarm_mj.output.rerun_format import RrdFile, columns_of
from iswarm_mj.utils.errors import UserError


@pytest.fixture
def unregistered(monkeypatch):
    """List with an entry for each time that Rerun was told not to wait for its streams."""
    calls = []
    monkeypatch.setattr(rr, "unregister_shutdown", lambda: calls.append(1))
    return calls


def test_a_limit_of_files_is_named(tmp_path):
    """Rerun itself only logs it before it waits."""
    with full_disk(2**20 + 100_000):
        file = RrdFile("test", tmp_path / "clean.rrd", rrb.Blueprint())
        points = np.random.default_rng(0).random((200_000, 3))
        file.stream.log("points", rr.Points3D(points))
        with pytest.raises(UserError, match="File too large"):
            file.flush()
    # The file is still open, hence the lock.
    assert sorted(path.name for path in tmp_path.iterdir()) == [".clean.rrd.lock", "clean.rrd"]


@pytest.mark.parametrize("content", [b"RRF2 and so on", b""])
def test_a_recording_without_its_end_is_reported(tmp_path, unregistered, content):
    """A disk may be full only at the end, which Rerun logs, and raises nothing."""
    path = tmp_path / "cut.rrd"
    file = RrdFile("test", path, rrb.Blueprint())
    file.stream.disconnect()
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"cannot be written \(No space left"):
        file.close()
    assert unregistered == [1]  # else Rerun would wait for a thread that has given up


@pytest.mark.parametrize("lengths", [2, np.array([3, 0, 1, 2])])
def test_columns_are_those_of_rerun(lengths):
    n_rows = 4
    row_lengths = np.broadcast_to(lengths, n_rows)
    n_instances = row_lengths.sum()
    positions = np.arange(3.0 * n_instances).reshape(n_instances, 3)
    numbers = np.arange(n_instances, dtype=np.int16)

    points = rr.Points3D.from_fields(positions=positions)
    columns = columns_of(points, {"number": numbers}, n_rows, lengths)

    expected = [
        *rr.Points3D.columns(positions=positions),
        *rr.AnyValues.columns(number=numbers),
    ]
    assert [column.descriptor for column in columns] == [column.descriptor for column in expected]
    arrays = [column.partition(row_lengths).as_arrow_array() for column in expected]
    assert [column.as_arrow_array() for column in columns] == arrays


def test_columns_of_nothing_have_a_type():
    (column,) = columns_of(rr.Scalars([]), {}, 3, np.zeros(3, int))
    assert column.as_arrow_array().tolist() == [[], [], []]
    _, column = columns_of(rr.Scalars([]), {"id": np.zeros(0, np.int16)}, 3, 0)
    assert column.as_arrow_array().type.value_type == "int16"
