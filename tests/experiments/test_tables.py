"""Tables of results in Markdown: their numbers and texts by hand; blocks of pages, of which nothing else changes."""

from hypothesis import given
from hypothesis import strategies as st

from iswarm_mj.experiments.report.numbers import text
from iswarm_mj.experiments.report.tables import filled, new_texts

PAGE = """# A page

Before. <!-- results: in a line of text --> is no mark.
<!-- results: density -->
old | 17 |
<!-- end -->
Between.

<!-- results-initial: hop-count beside results -->
<!-- end -->

    <!-- end -->
After.
"""


def fill(directory, name, beside):
    return f"| {name} of {directory} and {beside} |\n"


def test_only_what_is_between_the_marks_changes(tmp_path):
    new = filled(PAGE, fill)
    assert "<!-- results: density -->\n\n| density of results and None |\n\n<!-- end -->\nBetween." in new
    assert "\n\n| hop-count of results-initial and results |\n\n<!-- end -->" in new
    kept = [line for line in PAGE.splitlines() if line and "old" not in line]
    assert [line for line in new.splitlines() if " of results" not in line and line] == kept
    assert filled(new, fill) == new and filled(PAGE, lambda *block: None) == PAGE
    open_block = "<!-- results: a -->\nkept\n" + PAGE
    assert filled(open_block, fill) == "<!-- results: a -->\nkept\n" + new
    first, second = tmp_path / "a.md", tmp_path / "b.md"
    first.write_text(PAGE)
    second.write_text("no block\n")
    assert new_texts([first, second], fill) == {first: new}


@given(st.text("<>!/[]()|\\\n `a"))
def test_text_is_no_markup(words):
    shown = text(words)
    assert "\n" not in shown and "](" not in shown
    assert "<a" not in shown and "<!" not in shown and "</" not in shown
    assert "|" not in shown.replace("\\|", "")
