"""Tables of results in Markdown: their numbers by hand; blocks of pages, of which nothing else is replaced."""

import pytest
from helpers_findings import GRASP_SETTINGS, grasp_rows

from iswarm_mj.experiments.analysis.findings import (
    FAILS,
    HOLDS,
    TOO_FEW,
    UNDECIDED,
)
from iswarm_mj.experiments.analysis.statistics import LEVEL
from iswarm_mj.experiments.report.numbers import engines, grouped
from iswarm_mj.experiments.report.tables import Tables, filled, new_texts
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import write_table


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


def engine_rows(factor, n=8, scatter=0.02):
    """Runs whose times are those of one engine times a factor."""
    hop = [
        run_row(factor * 200 * (1 + scatter * k) if flag else None, k, use_hop_count=flag)
        for flag in (True, False)
        for k in range(n)
    ]
    density = [run_row(factor * 1000 * d * (1 + scatter * k), k, density=d) for d in (0.1, 0.2) for k in range(n)]
    return {"hop-count": hop, "density": density}


def test_engines_are_equal_by_their_times():
    """Not by few or scattered runs."""
    for factor, verdict in ((1.02, HOLDS), (1.5, FAILS)):
        first = engine_rows(1.0)
        first["density"] += [run_row(500, k, density=0.4) for k in range(8)]  # which the other has not
        _, *lines = cells(engines({"results": first, "other": engine_rows(factor)}))
        assert [line[0][-3:] for line in lines[:-1]] == ["nts", "0.1", "0.2", "all"]
        assert lines[0][1] == "214" and lines[-2][4] == verdict and lines[-2][3].startswith(f"{factor:.3g} (")
    for options, verdict in (({"n": 4}, TOO_FEW), ({"scatter": 0.5}, UNDECIDED)):
        rows = engine_rows(1.0, **options)
        assert {line[4] for line in cells(engines({"a": rows, "b": rows}))[1:-1]} == {verdict}


def test_contents_of_blocks(tmp_path):
    """Of one directory and of two; a block without results stays as it is, one of an unknown name is refused."""
    for name, repeats in (("results", 8), ("results-initial", 2)):
        (tmp_path / name / "grasp").mkdir(parents=True)
        write_table(tmp_path / name / "grasp" / "trials.parquet", grasp_rows(repeats=repeats), GRASP_SETTINGS)
    tables = Tables(tmp_path)
    text = tables.content("results", "grasp", "results-initial")
    assert "`results`:\n\n| " in text and "40 of 40" in text and "10 of 10" in text
    assert tables.content("results", "laws") and tables.content("results", "statements").count("### ") == 2
    assert tables.content("results", "density") is None is tables.content("results-none", "grasp")
    assert tables.content("results", "engines", "results-initial") is None
    summary, level = tables.content("results", "summary"), LEVEL.get()
    # each of 16 intervals is at 1 - 0.05 / 16, by which 40 of 40 no longer shows that more than 90 % do
    assert "with intervals at 99.69 %, by Bonferroni for these 16 verdicts" in summary and level == 0.95
    assert "become undecided: Without contact no ball is lifted" in summary
    with pytest.raises(UserError, match=r"^The block was 'grasps'; there are laws, grasp, "):
        tables.content("results", "grasps")


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
