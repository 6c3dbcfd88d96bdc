"""Tables of results in Markdown, and the blocks of pages that they fill."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.findings import grasp_rows

from iswarm_mj.paper.report import page_blocks
from iswarm_mj.paper.report.markdown import cell_text
from iswarm_mj.paper.report.number_tables import trials_table
from iswarm_mj.paper.report.page_blocks import changed_pages, fill_blocks
from iswarm_mj.paper.report.results import Result, Topic


def test_faulty_trials_do_not_count():
    rows = grasp_rows(repeats=2)
    rows[3] |= {"faulty": True}
    _, _, *lines = trials_table(rows).splitlines()
    counts = [line.split(" | ")[2] for line in lines]
    assert counts[:2] == ["0 of 9", "10 of 10"]


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
    """Return the content of a block."""
    return f"| {name} of {directory} and {beside} |\n"


class TestBlocks:
    def test_they_are_filled(self):
        page = fill_blocks(PAGE, fill)
        density = "<!-- results: density -->\n\n| density of results and None |\n\n<!-- end -->\n"
        assert f"{density}Between." in page
        assert "\n\n| hop-count of results/initial and results |\n\n<!-- end -->" in page

    def test_nothing_else_changes(self):
        before = [line for line in PAGE.splitlines() if line and "old" not in line]
        after = []
        for line in fill_blocks(PAGE, fill).splitlines():
            if line and " of results" not in line:
                after.append(line)
        assert after == before

    def test_a_filled_page_stays_as_it_is(self):
        page = fill_blocks(PAGE, fill)
        assert fill_blocks(page, fill) == page

    def test_blocks_without_results_stay_as_they_are(self):
        assert fill_blocks(PAGE, lambda *block: None) == PAGE

    def test_blocks_without_an_end_stay_as_they_are(self):
        open_block = "<!-- results: a -->\nkept\n"
        assert fill_blocks(open_block + PAGE, fill) == open_block + fill_blocks(PAGE, fill)

    def test_pages_without_a_block_have_no_new_text(self, tmp_path):
        with_blocks = tmp_path / "a.md"
        without_blocks = tmp_path / "b.md"
        with_blocks.write_text(PAGE)
        without_blocks.write_text("no block\n")
        texts = changed_pages([with_blocks, without_blocks], fill)
        assert texts == {with_blocks: fill_blocks(PAGE, fill)}


class TestText:
    @given(st.text("<>!/[]()|\\\n `a"))
    def test_it_is_no_markup(self, words):
        shown = cell_text(words)
        assert "\n" not in shown
        assert "](" not in shown
        assert "<a" not in shown
        assert "<!" not in shown
        assert "</" not in shown
        assert "|" not in shown.replace("\\|", "")

    def test_words_by_hand(self):
        assert cell_text("p < 0.001 | a") == "p < 0.001 \\| a"
        markup = "<script>x</script> ![i](http://a)"
        assert cell_text(markup) == "&lt;script>x&lt;/script> ![i]\\(http://a)"


def place_text(**settings):
    """Return the text on a directory whose table has these settings."""
    result = Result("types", Path("types.parquet"), [], settings)
    return page_blocks._place_text("results/a", Topic("types", "", [], [result]))


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"accuracy": 0.1, "refinement": 2}, "`results/a`"),
        ({"refinement": 1}, "`results/a`, made with `--refinement 1`"),
        (
            {"accuracy": 0.01, "refinement": 1},
            "`results/a`, made with `--accuracy 0.01 --refinement 1`",
        ),
        ({}, "`results/a`"),
    ],
)
def test_tables_say_which_settings_of_physics_are_not_the_defaults(settings, text):
    assert place_text(**settings) == text


def test_the_resamples_outside_of_an_interval_are_counted(monkeypatch):
    monkeypatch.setattr("iswarm_mj.utils.intervals.RESAMPLES", 9999)
    assert " lie 250.0 of 9999 resamples " in page_blocks._tails_text(level=0.95)
    assert " lie 2.3 of 9999 resamples " in page_blocks._tails_text(level=1 - 0.05 / 107)
