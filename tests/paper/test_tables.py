"""Tables of results in Markdown: faulty trials, texts by hand; blocks of pages, of which nothing
else changes."""

from hypothesis import given
from hypothesis import strategies as st
from support.findings import grasp_rows

from iswarm_mj.paper.report.markdown import cell_text
from iswarm_mj.paper.report.number_tables import trials_table
from iswarm_mj.paper.report.page_blocks import changed_pages, fill_blocks


def test_faulty_trials_do_not_count():
    rows = grasp_rows(repeats=2)
    rows[3] |= {"faulty": True}
    assert [line.split(" | ")[2] for line in trials_table(rows).splitlines()[2:4]] == [
        "0 of 9",
        "10 of 10",
    ]


PAGE = """# A page

Before. <!-- results: in a line of text --> is no mark.
<!-- results: density -->
old | 17 |
<!-- end -->
Between.

<!-- results/initial: hop-count beside results -->
<!-- end -->

    <!-- end -->
After.
"""


def fill(directory, name, beside):
    return f"| {name} of {directory} and {beside} |\n"


def test_only_what_is_between_the_marks_changes(tmp_path):
    new = fill_blocks(PAGE, fill)
    assert (
        "<!-- results: density -->\n\n| density of results and None |\n\n<!-- end -->\nBetween."
        in new
    )
    assert "\n\n| hop-count of results/initial and results |\n\n<!-- end -->" in new
    kept = [line for line in PAGE.splitlines() if line and "old" not in line]
    assert [line for line in new.splitlines() if " of results" not in line and line] == kept
    assert fill_blocks(new, fill) == new and fill_blocks(PAGE, lambda *block: None) == PAGE
    open_block = "<!-- results: a -->\nkept\n" + PAGE
    assert fill_blocks(open_block, fill) == "<!-- results: a -->\nkept\n" + new
    first, second = tmp_path / "a.md", tmp_path / "b.md"
    first.write_text(PAGE)
    second.write_text("no block\n")
    assert changed_pages([first, second], fill) == {first: new}


@given(st.text("<>!/[]()|\\\n `a"))
def test_text_is_no_markup(words):
    shown = cell_text(words)
    assert "\n" not in shown and "](" not in shown
    assert "<a" not in shown and "<!" not in shown and "</" not in shown
    assert "|" not in shown.replace("\\|", "")


def test_words_by_hand():
    assert cell_text("p < 0.001 | a") == "p < 0.001 \\| a"
    assert (
        cell_text("<script>x</script> ![i](http://a)")
        == "&lt;script>x&lt;/script> ![i]\\(http://a)"
    )
