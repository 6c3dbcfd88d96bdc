"""Tables of results in Markdown: their numbers by hand; blocks of pages, of which nothing else is replaced."""

import numpy as np
import pytest
from helpers_findings import GRASP_SETTINGS, grasp_rows, search_rows, settings_of

from iswarm_mj.experiments.analysis.findings import (
    FAILS,
    HOLDS,
    NOT_IN_PAPER,
    NOT_RUN,
    PREDICTED,
    SLIP,
    TOO_FEW,
    UNDECIDED,
    Finding,
)
from iswarm_mj.experiments.analysis.measures import PAPER_TIME
from iswarm_mj.experiments.report.markdown import table
from iswarm_mj.experiments.report.numbers import TABLES, engines, evolution
from iswarm_mj.experiments.report.results import TITLES, Topic
from iswarm_mj.experiments.report.tables import Tables, _misses, _summary, _verdicts, check_name, filled, new_texts
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import write_table


def cells(text):
    """Cells of a Markdown table by lines, without the line under the head."""
    lines = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in text.splitlines()]
    assert set(lines[1]) == {"---"} and len({len(line) for line in lines}) == 1
    return [lines[0], *lines[2:]]


def run_row(time, k, **labels):
    """A run that reaches its goal at `time`, or does not."""
    carriage = 50.0 + k
    return {
        **labels,
        "repeat": k,
        "seed": k,
        "n_robots": 280,
        "max_steps": 1200,
        "goal": 66,
        "delivered": 66 if time else 40 + k,
        "collisions_per_robot": 10.0 + k,
        "mean_carriage_steps": carriage,
        "finished_at": time,
    }


def test_hop_counts_by_hand():
    """Medians of 100..104 and of runs that never finish; third quartiles are the fourth values."""
    rows = [run_row(100 + k, k, use_hop_count=True) for k in range(5)]
    rows += [run_row(None, k, use_hop_count=False) for k in range(5)]
    head, time, dust, *_ = cells(TABLES["hop-count"](rows))
    assert head[1:3] == ["with hop counts, 5 runs", "without, 5"]
    assert time[1:] == ["102 (103)", "1200 (1200)", "-1098 (-1100 to -1096)"]
    assert dust[1:3] == ["66 (66)", "42 (43)"]


def engine_rows(factor, n=8, scatter=0.02):
    """Runs whose times are those of one engine times a factor."""
    hop = [
        run_row(factor * 200 * (1 + scatter * k) if flag else None, k, use_hop_count=flag)
        for flag in (True, False)
        for k in range(n)
    ]
    density = [run_row(factor * 1000 * d * (1 + scatter * k), k, density=d) for d in (0.1, 0.2) for k in range(n)]
    return {"hop-count": hop, "density": density}


@pytest.mark.parametrize(("factor", "verdict"), [(1.02, HOLDS), (1.5, FAILS)])
def test_engines_are_equal_by_their_times(factor, verdict):
    first = engine_rows(1.0)
    first["density"] += [run_row(500, k, density=0.4) for k in range(8)]  # which the other has not
    head, *lines = cells(engines({"results": first, "other": engine_rows(factor)}))
    assert head[1:3] == ["`results`: median time [steps]", "`other`"]
    assert [line[0] for line in lines] == [
        "Fig. 15, with hop counts",
        "Fig. 17, density 0.1",
        "Fig. 17, density 0.2",
        "all",
    ]
    assert lines[0][1] == "214" and lines[-1][4] == verdict
    assert lines[-1][3].startswith(f"{factor:.3g} (")


def test_engines_with_few_or_scattered_runs_are_not_judged_equal():
    few = cells(engines({"a": engine_rows(1.0, n=4), "b": engine_rows(1.0, n=4)}))
    assert {line[4] for line in few[1:]} == {TOO_FEW}
    scattered = cells(engines({"a": engine_rows(1.0, scatter=0.5), "b": engine_rows(1.0, scatter=0.5)}))
    assert {line[4] for line in scattered[1:]} == {UNDECIDED}


def test_densities_by_hand():
    rows = [run_row(None if d == 0.05 and k else 100 + k, k, density=d) for d in (0.1, 0.05) for k in range(3)]
    _, sparse, dense = cells(TABLES["density"](rows))
    assert sparse[:5] == ["0.05", "280", "1 of 3", "1200 (1200)", "42 (54)"]
    assert dense == ["0.1", "280", "3 of 3", "101 (102)", "66 (66)", "11 (11.5)", "51 (51.5)"]


def test_types_by_hand():
    """The median of the times, the mean of the fitness, the median of the aggregations that are known."""
    measured = [(100, 1000.0, 0.1), (110, 2000.0, None), (150, 6000.0, 0.3)]
    rows = [
        run_row(time, k, type="type1", fitness=fitness, aggregation=near)
        for k, (time, fitness, near) in enumerate(measured)
    ]
    _, only = cells(TABLES["types"](rows))
    assert only[:5] == ["type1", "280", "3 of 3", "110 (100 to 150)", str(PAPER_TIME["type1"])]
    assert only[5:] == ["3000 (1000 to 6000)", "7771", "20 %"]


def test_choices_that_change_the_time_by_hand():
    """The clearest change first; what changes nothing is left out. p = 2 / C(20, 10), times 3 by Holm."""
    choices = [
        ("default", "", 0),
        ("drive.error_turn", "10.0", 7.5),
        ("optics.mode", "power", 30),
        ("optics.parity_check", "False", 0.5),
    ]
    rows = [
        run_row(100 + late + k, k, group="group", choice=choice, value=value)
        for choice, value, late in choices
        for k in range(10)
    ]
    _, first, second = cells(TABLES["sensitivity"](rows))
    assert first[:3] == ["`optics.mode`", "power", "10/10"] and first[3].startswith("30 (")
    assert first[4:] == ["1.1e-05", "3.2e-05"] and second[:2] == ["`drive.error_turn`", "10.0"]


def test_robustness_by_hand():
    rows = [
        run_row(100 + k + 50 * (kind == "dead"), k, kind=kind, fraction=0.3)
        for kind in ("dead", "absent")
        for k in range(3)
    ]
    rows += [run_row(100, 0, kind="dead", fraction=0.0)]
    _, none, some = cells(TABLES["robustness"](rows))
    assert none == ["0 %", "1 of 1", "100", "", ""] and some == ["30 %", "3 of 3", "151", "101", "50 (48 to 52)"]


def test_trials_by_hand():
    rows = [
        {**row, "voltage": 20.0 if row["experiment"] == "grasp" else row["voltage"]} for row in grasp_rows(repeats=2)
    ]
    _, first, *_, last = cells(TABLES["grasp"](rows))
    assert first == ["grasp", "10 %", "10 of 10", "20 V (95 % interval 20 to 20)", "20.0 to 20.0 V"]
    assert last == ["lift without contact", "50 %", "0 of 10", "", ""]


def test_searches_by_hand():
    """Medians over replicates of the mean of the last 20 generations, with intervals if there are several."""
    rows = search_rows(30)
    both = [{**row, "replicate": k, "fitness": row["fitness"] + 100 * k} for k in range(3) for row in rows]
    ends = np.mean([row["fitness"] for row in rows if row["generation"] >= 10])
    clean = sum(row["delivered"] == 72 for row in rows)
    _, alone, several = cells(evolution({"paper": (rows, settings_of()), "cmaes": (both, settings_of("cmaes"))}))
    assert alone[:5] == ["paper", "1", "300", str(clean), f"{ends:.0f}"]
    assert several[:5] == ["cmaes", "3", "900", str(3 * clean), f"{ends + 100:.0f} ({ends:.0f} to {ends + 200:.0f})"]
    assert several[6] == f"{max(row['fitness'] for row in rows) + 200:.0f}"


FINDINGS = [
    Finding("A", "here", "1 | 2", PREDICTED, "", "", HOLDS),
    Finding("B", "here", "2", PREDICTED, "", "", FAILS),
    Finding("C", "here", "3", SLIP, "", "", FAILS),
    Finding("D", "here", "4", SLIP, "", "", ""),
    Finding("E", NOT_IN_PAPER, "5", PREDICTED, "", "", FAILS),
    Finding("F", NOT_IN_PAPER, "6", PREDICTED, "", "", UNDECIDED),
]


def test_the_summary_counts_by_verdict_and_kind():
    assert cells(_summary(FINDINGS)) == [
        ["verdict", PREDICTED, SLIP, "all of the paper's", "not in the paper"],
        [HOLDS, "1", "0", "1", "0"],
        [FAILS, "1", "1", "2", "1"],
        ["not judged", "0", "1", "1", "0"],
        [UNDECIDED, "0", "0", "0", "1"],
    ]


def test_misses_are_the_papers_statements_that_do_not_hold():
    found = [*FINDINGS, Finding("G", "here", "7", PREDICTED, "8", "", UNDECIDED)]
    assert cells(_misses(found))[1:] == [
        ["B", "2", "", FAILS, PREDICTED],
        ["C", "3", "", FAILS, SLIP],
        ["G", "7", "8", UNDECIDED, PREDICTED],
    ]


def test_verdicts_of_two_directories_stand_side_by_side():
    other = [finding._replace(verdict=NOT_RUN) for finding in FINDINGS[:2]]
    shown = _verdicts({"results": Topic("", "", FINDINGS, []), "results-initial": Topic("", "", other, [])})
    assert "1 \\| 2" in shown
    head, _, second, third, *_ = cells(shown)
    assert head[2:4] == ["verdict, `results`", "verdict, `results-initial`"]
    assert second == ["B", "2", FAILS, NOT_RUN, PREDICTED] and third == ["C", "3", FAILS, "", SLIP]


def test_a_table_has_a_line_under_its_head():
    assert table(["a", "b"], [[1, "x"]]) == "| a | b |\n| --- | --- |\n| 1 | x |"


class TestContents:
    @pytest.fixture
    def root(self, tmp_path):
        for name, repeats in (("results", 8), ("results-initial", 2)):
            (tmp_path / name / "grasp").mkdir(parents=True)
            write_table(tmp_path / name / "grasp" / "trials.parquet", grasp_rows(repeats=repeats), GRASP_SETTINGS)
        return tmp_path

    def test_results_of_two_directories(self, root):
        text = Tables(root).content("results", "grasp", "results-initial")
        assert "`results`:\n\n| " in text and "`results-initial`:\n\n| " in text
        assert "40 of 40" in text and "10 of 10" in text and "verdict, `results-initial`" in text

    def test_names(self, root):
        """Each topic and experiment has a block; those of what was not run are refused, or left as they are."""
        for name in (*TITLES, *EXPERIMENTS, "summary", "statements"):
            check_name("results", name)
        check_name("results", "engines", "results-mujoco")
        with pytest.raises(UserError, match="compares two directories; write `beside`"):
            check_name("results", "engines")
        tables = Tables(root)
        assert tables.content("results", "laws") and tables.content("results", "statements").count("### ") == 2
        with pytest.raises(UserError, match=r"^results has no results for the block 'density'; make them with"):
            tables.content("results", "density")
        with pytest.raises(UserError, match=r"an existing directory"):
            tables.content("results-none", "grasp")
        with pytest.raises(UserError, match=r"^The block was 'grasps'; there are laws, grasp, "):
            tables.content("results", "grasps")
        partial = Tables(root, partial=True)
        assert partial.content("results", "density") is None is partial.content("results-none", "grasp")


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


class TestBlocks:
    def test_only_what_is_between_the_marks_changes(self):
        new = filled(PAGE, "page", fill)
        assert "<!-- results: density -->\n\n| density of results and None |\n\n<!-- end -->\nBetween." in new
        assert "\n\n| hop-count of results-initial and results |\n\n<!-- end -->" in new
        kept = [line for line in PAGE.splitlines() if line and "old" not in line]
        assert [line for line in new.splitlines() if " of results" not in line and line] == kept
        assert filled(new, "page", fill) == new and filled(PAGE, "", lambda *block: None) == PAGE

    @pytest.mark.parametrize(
        "text, said",
        [
            ("a\n<!-- results: density -->\n| 1 |\n", "p.md:2: blocks"),
            ("<!-- end -->\n", "p.md:1: blocks"),
            ("<!-- results: a -->\n<!-- results: b -->\n<!-- end -->\n", "p.md:2: blocks"),
        ],
    )
    def test_marks_that_do_not_match_are_named(self, text, said):
        with pytest.raises(UserError, match=said):
            filled(text, "p.md", fill)

    def test_what_cannot_be_filled_names_the_line(self):
        def refuse(directory, name, beside):
            raise UserError(f"no {name}")

        with pytest.raises(UserError, match=r"^page:4: no density$"):
            filled(PAGE, "page", refuse)

    def test_files(self, tmp_path):
        """Only pages that change are returned; one that is not text is named."""
        first, second = tmp_path / "a.md", tmp_path / "b.md"
        first.write_text(PAGE)
        second.write_text("no block\n")
        assert new_texts([first, second], fill) == {first: filled(PAGE, "", fill)}
        second.write_bytes(b"\xff\xfe\xff")
        for path in (second, tmp_path / "none.md"):
            with pytest.raises(UserError, match=r"cannot be read|is no text"):
                new_texts([first, path], fill)
