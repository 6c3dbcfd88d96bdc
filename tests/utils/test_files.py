"""Files are replaced in one step, or stay as they were."""

import shutil

import pytest
from support.files import full_disk

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, remove_parts


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    (tmp_path / "a.json").write_text("old")
    with pytest.raises(RuntimeError), atomic_write(tmp_path / "a.json") as part:
        part.write_text("half")
        raise RuntimeError
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
    assert (tmp_path / "a.json").read_text() == "old"


def test_a_full_disk_leaves_the_old_file_and_ends_with_a_sentence(tmp_path):
    (tmp_path / "a.json").write_text("old")
    said = r"a\.json cannot be written \(File too large\); make room or choose another `out`$"
    with (
        pytest.raises(UserError, match=said),
        full_disk(8),
        atomic_write(tmp_path / "a.json") as part,
    ):
        part.write_text("longer than 8 bytes")
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
    assert (tmp_path / "a.json").read_text() == "old"


def test_a_directory_that_vanished(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    with (
        pytest.raises(UserError, match=r"a\.json cannot be written \(No such file"),
        atomic_write(out / "a.json") as p,
    ):
        shutil.rmtree(out)
        p.write_text("new")


def test_only_parts_are_removed(tmp_path):
    for name in (
        ".123-best.json",
        ".123-best-7.json",
        ".my-best.json",
        ".-best.json",
        ".12-other.json",
    ):
        (tmp_path / name).touch()
    remove_parts(tmp_path, "best.json", "best-*.json")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        ".-best.json",
        ".12-other.json",
        ".my-best.json",
    ]
