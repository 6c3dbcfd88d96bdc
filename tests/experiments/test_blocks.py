"""Marked blocks of Markdown pages: what is between the marks is replaced, and nothing else."""

import pytest

from iswarm_mj.experiments.report.blocks import filled, new_texts, outside, write
from iswarm_mj.utils.errors import UserError

PAGE = """# A page

Before. <!-- results: in a line of text --> is no mark.
<!-- results: density -->
old | 17 |
<!-- end -->
Between.

<!-- results-initial: hop-count -->
<!-- end -->

    <!-- end -->
After.
"""


def fill(directory, name, beside):
    return f"| {name} of {directory} |\n" if beside is None else f"| {name} of {directory} and {beside} |\n"


def test_only_what_is_between_the_marks_changes():
    new = filled(PAGE, "page", fill)
    assert "<!-- results: density -->\n\n| density of results |\n\n<!-- end -->\nBetween." in new
    assert "<!-- results-initial: hop-count -->\n\n| hop-count of results-initial |\n\n<!-- end -->" in new
    assert "old" not in new and outside(new) == outside(PAGE)
    kept = [line for line in PAGE.splitlines() if "old" not in line]
    assert [line for line in new.splitlines() if " of results" not in line and line] == [line for line in kept if line]


def test_a_block_of_two_directories():
    text = "<!-- results: types beside results-initial -->\n<!-- end -->\n"
    assert "| types of results and results-initial |" in filled(text, "", fill)


def test_a_block_that_is_not_to_be_filled_stays():
    assert filled(PAGE, "", lambda *block: None) == PAGE


def test_filling_twice_changes_nothing():
    new = filled(PAGE, "page", fill)
    assert filled(new, "page", fill) == new


@pytest.mark.parametrize(
    "text, said",
    [
        ("a\n<!-- results: density -->\n| 1 |\n", "p.md:2: the block of results has no line '<!-- end -->'; add one."),
        ("<!-- end -->\n", "p.md:1: this line ends no block"),
        ("<!-- results: a -->\n<!-- results: b -->\n<!-- end -->\n", "p.md:1: .* before line 2"),
    ],
)
def test_marks_that_do_not_match_are_named(text, said):
    with pytest.raises(UserError, match=said):
        filled(text, "p.md", fill)


def test_what_cannot_be_filled_names_the_line():
    def refuse(directory, name, beside):
        raise UserError(f"no {name}")

    with pytest.raises(UserError, match=r"^page:4: no density$"):
        filled(PAGE, "page", refuse)


def test_files(tmp_path):
    """Only pages that change are written; one that is not text is named, and nothing is written then."""
    first, second = tmp_path / "a.md", tmp_path / "b.md"
    first.write_text(PAGE)
    second.write_text("no block\n")
    texts = new_texts([first, second], fill)
    assert set(texts) == {first}
    write(texts)
    assert first.read_text() == filled(PAGE, "", fill) and new_texts([first, second], fill) == {}
    second.write_bytes(b"\xff\xfe\xff")
    for path in (second, tmp_path / "none.md"):
        with pytest.raises(UserError, match=r"is not a readable page"):
            new_texts([first, path], fill)
