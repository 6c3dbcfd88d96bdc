"""Files are replaced in one step, or stay as they were."""

import shutil

import pytest
from support.files import full_disk

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, remove_parts


class TestAtomicWrite:
    @pytest.fixture
    def file(self, tmp_path):
        """Return a file with text, alone in its directory."""
        path = tmp_path / "a.json"
        path.write_text("old")
        return path

    def test_an_error_leaves_the_old_file(self, file):
        with pytest.raises(RuntimeError), atomic_write(file) as part:
            part.write_text("half")
            raise RuntimeError
        assert [*file.parent.iterdir()] == [file]
        assert file.read_text() == "old"

    def test_a_full_disk_leaves_the_old_file_and_ends_with_a_sentence(self, file):
        sentence = (
            r"a\.json cannot be written \(File too large\); make room or choose another `out`$"
        )
        with pytest.raises(UserError, match=sentence), full_disk(8), atomic_write(file) as part:
            part.write_text("longer than 8 bytes")
        assert [*file.parent.iterdir()] == [file]
        assert file.read_text() == "old"

    def test_a_directory_that_vanishes_ends_with_a_sentence(self, tmp_path):
        out = tmp_path / "out"
        out.mkdir()
        sentence = r"a\.json cannot be written \(No such file"
        with pytest.raises(UserError, match=sentence), atomic_write(out / "a.json") as part:
            shutil.rmtree(out)
            part.write_text("new")


def test_only_parts_are_removed(tmp_path):
    """Hidden files that begin with the number of a process and end with one of the names."""
    parts = {".123-best.json", ".123-best-7.json"}
    kept = {".my-best.json", ".-best.json", ".12-other.json"}
    for name in parts | kept:
        (tmp_path / name).touch()
    remove_parts(tmp_path, "best.json", "best-*.json")
    assert {path.name for path in tmp_path.iterdir()} == kept
