"""Results of earlier runs make way, and a file appears complete or not at all."""

import pytest

from iswarm_mj.output import results
from iswarm_mj.utils.errors import UserError


def test_a_directory_in_the_place_of_a_file(tmp_path):
    (tmp_path / "result.json").mkdir()
    said = r"result\.json cannot be written \(Is a directory\); move it away or choose another `out`$"
    with pytest.raises(UserError, match=said):
        results.clear(tmp_path, record=False)
    with pytest.raises(UserError, match=said), results.atomic_write(tmp_path / "result.json") as part:
        part.write_text("new")
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    (tmp_path / "result.json").write_text("old")
    with pytest.raises(RuntimeError), results.atomic_write(tmp_path / "result.json") as part:
        part.write_text("half")
        raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]
    assert (tmp_path / "result.json").read_text() == "old"
