"""Tables of results in Markdown: their numbers and texts by hand; blocks of pages, of which nothing else changes."""

from helpers_findings import grasp_rows
from hypothesis import given
from hypothesis import strategies as st

from iswarm_mj.experiments.report.numbers import grouped, text
from iswarm_mj.experiments.report.tables import filled, new_texts


def cells(text):
    """Cells of a Markdown table by lines, without the line under the head."""
    lines = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines()]
    assert set(lines[1]) == {"---"} and len({len(line) for line in lines}) == 1
    return [lines[0], *lines[2:]]


def run_row(time, k, **labels):
    """A run that reaches its goal at `time`, or does not."""
    return {
        **labels,
        "seed": k,
        "n_robots": 280,
        "max_steps": 1200,
        "delivered": 66 if time else 40 + k,
        "collisions_per_robot": 10.0 + k,
        "mean_carriage_steps": 50.0 + k,
        "finished_at": time,
    }


def test_groups_by_hand():
    """Medians of 100..104, and of runs that never finish; of five values the interval is their range. What has no value
    is left out."""
    rows = [run_row(100 + k, k, use_hop_count=True) for k in range(5)]
    rows += [run_row(None, k, use_hop_count=False) for k in range(5)]
    head, there, absent = cells(grouped("hop-count", rows))
    assert head[:2] == ["hop counts", "runs that reach the goal"] and len(head) == 6
    assert there == ["with", "5 of 5", "102 (100 to 104)", "66 (66 to 66)", "12 (10 to 14)", "52 (50 to 54)"]
    assert absent[:4] == ["without", "0 of 5", "1200 (1200 to 1200)", "42 (40 to 44)"]
    measured = [(100, 1000.0, 0.1), (110, 2000.0, None), (150, 6000.0, 0.3)]
    rows = [run_row(time, k, type="type1", fitness=f, aggregation=near) for k, (time, f, near) in enumerate(measured)]
    _, only = cells(grouped("types", rows))
    assert only == ["type1", "3 of 3", "110 (100 to 150)", "2000 (1000 to 6000)", "0.2 (0.1 to 0.3)"]
    trials = [row | ({"voltage": 20.0} if row["experiment"] == "grasp" else {}) for row in grasp_rows(repeats=2)]
    trials[3] |= {"faulty": True}
    _, first, second, *_ = cells(grouped("grasp", trials))
    assert first == ["no contact", "10", "0 of 9", ""] and second == ["grasp", "10", "10 of 10", "20 (20 to 20)"]


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


def test_words_by_hand():
    assert text("p < 0.001 | a") == "p < 0.001 \\| a"
    assert text("<script>x</script> ![i](http://a)") == "&lt;script>x&lt;/script> ![i]\\(http://a)"
