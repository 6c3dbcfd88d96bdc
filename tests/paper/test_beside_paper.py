"""The page with our figures beside the paper's values: its cards and its figures."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from iswarm_mj.output.plot_style import LIGHT_PAGE, blank
from iswarm_mj.paper.analysis.findings import FAILS, HOLDS, NOT_IN_PAPER, UNDECIDED
from iswarm_mj.paper.analysis.varied_values import DEFAULT
from iswarm_mj.paper.report import beside_paper, paper_figures
from iswarm_mj.paper.report.beside_paper import cards, tally
from iswarm_mj.paper.report.paper_figures import FIGURES, TABLE_1
from iswarm_mj.paper.report.results import collect_results, topics_of
from iswarm_mj.search.rows import select

ROOT = Path(__file__).parents[2]
HOP_COUNT = ROOT / "results/default/hop-count"
FIGURES_OF_PAGE = ROOT / "results/default/beside-paper"
CARD = "**Fig. 15: with and without hop counts**"


@pytest.fixture(scope="module")
def topics():
    """Topics of the checked-in results on hop counts."""
    return [topic for topic in topics_of(collect_results([HOP_COUNT])) if topic.results]


def with_verdicts(topics, *verdicts):
    """Return the topic with these verdicts on its findings."""
    (topic,) = topics
    findings = [
        finding._replace(verdict=verdict)
        for finding, verdict in zip(topic.findings, verdicts, strict=True)
    ]
    return [topic._replace(findings=findings)]


class TestCards:
    def test_only_figures_with_results_have_one(self, topics):
        text = cards(topics, "results/default")
        assert text.count("\n-   **") == 1
        assert CARD in text
        assert "(../results/default/beside-paper/fig-15.svg)" in text

    def test_what_holds_is_one_sentence(self, topics):
        text = cards(with_verdicts(topics, *[HOLDS] * 4), "results")
        assert "**All 4 statements hold**: with hop counts swarms reach the goal sooner;" in text
        assert "    - " not in text

    def test_two_that_hold_are_both(self, topics, monkeypatch):
        lines = beside_paper._LINES["fig-15"][:2]
        monkeypatch.setitem(beside_paper._LINES, "fig-15", lines)
        text = cards(with_verdicts(topics, *[HOLDS] * 4), "results")
        assert "**Both statements hold**: with hop counts" in text

    def test_what_does_not_is_listed(self, topics):
        text = cards(with_verdicts(topics, HOLDS, FAILS, UNDECIDED, HOLDS), "results")
        assert "**Of 4 statements 2 hold, 1 does not, 1 is undecided.**" in text
        assert "    - *They remove more dust*: does not hold." in text
        assert "    - *They collide less*: undecided." in text

    def test_statements_with_one_reason_share_a_line(self, topics, monkeypatch):
        lines = [line._replace(reason="Why.") for line in beside_paper._LINES["fig-15"]]
        monkeypatch.setitem(beside_paper._LINES, "fig-15", lines)
        text = cards(with_verdicts(topics, HOLDS, FAILS, FAILS, HOLDS), "results")
        assert "- *They remove more dust*; *They collide less*: do not hold. Why." in text

    def test_statements_are_counted(self, topics):
        counted = tally(with_verdicts(topics, HOLDS, FAILS, FAILS, UNDECIDED))
        assert (
            counted
            == "**1** of 4 statements of the paper hold, 2 do not; the others are undecided."
        )

    def test_nothing_is_undecided_where_each_statement_has_a_verdict(self, topics):
        counted = tally(with_verdicts(topics, HOLDS, FAILS, HOLDS, HOLDS))
        assert counted == "**3** of 4 statements of the paper hold, 1 do not."


def test_each_of_the_papers_statements_on_swarms_is_on_a_card():
    on_cards = {line.claim for lines in beside_paper._LINES.values() for line in lines}
    names = ("evolution", "hop-count", "density", "types")
    claims = {
        finding.claim
        for topic in topics_of({})
        if topic.name in names
        for finding in topic.findings
        if finding.source != NOT_IN_PAPER
    }
    assert claims
    assert claims <= on_cards
    assert set(beside_paper._LINES) == {figure.name for figure in FIGURES} - {"table-1"}


def test_table_1_is_the_default():
    assert len(TABLE_1) == 11
    rows = collect_results([ROOT / "results/default/sensitivity"])["sensitivity"].rows
    verdict = beside_paper._verdict_on_table_1(rows)
    assert verdict.startswith("**All 11 values are used unchanged.** Of 8 other values")


def test_every_line_of_table_1_is_compared():
    others = [row._replace(value=row.value + 0.5) for row in TABLE_1]
    assert beside_paper._changed_values(others) == [row.name for row in TABLE_1]


def test_table_1_needs_no_other_values():
    rows = collect_results([ROOT / "results/default/sensitivity"])["sensitivity"].rows
    verdict = beside_paper._verdict_on_table_1(select(rows, choice=DEFAULT))
    assert verdict == "**All 11 values are used unchanged.**"


@pytest.mark.parametrize("number", range(1, 5))
def test_marks_of_a_row_stay_in_it(number):
    heights = paper_figures._heights_in_row(number)
    assert len(set(heights)) == number
    assert np.mean(heights) == pytest.approx(0.0)
    assert np.abs(heights).max() < 0.5


@pytest.mark.parametrize(("scouts", "n_lines"), [([0.2, 0.2], 0), ([0.2, 0.4], 1)])
def test_evolutions_without_a_trend_are_dots(scouts, n_lines):
    fittest = [{"fraction_scouts": share, "p_vector_forget": 0.5} for share in scouts]
    _, (panel,) = blank()
    paper_figures._draw_trend(panel, SimpleNamespace(fittest=fittest), LIGHT_PAGE)
    *lines, dot = panel.lines
    assert len(lines) == n_lines
    assert dot.get_xydata().tolist() == [[pytest.approx(np.mean(scouts)), 0.5]]


def test_a_missing_picture_is_named(tmp_path):
    _, (panel,) = blank()
    paper_figures._draw_picture(panel, tmp_path / "type1.png")
    assert [text.get_text() for text in panel.texts] == ["type1.png is missing"]


def test_the_arena_is_cut_out_of_a_picture():
    _, (panel,) = blank()
    paper_figures._draw_picture(panel, ROOT / "results/default/types/type1.png")
    (image,) = panel.images
    pixels = np.asarray(image.get_array())
    assert pixels.shape[:2] == (291, 300)

    # Its lower wall is there; what is below it, a scale and a legend, is not.
    is_dark = pixels.max(axis=-1) < 0.5
    assert is_dark[-8:, 150].any()
    assert not is_dark[-3:].any()


def test_a_figure_has_a_light_and_a_dark_variant(tmp_path):
    results = collect_results([HOP_COUNT])
    (figure,) = (figure for figure in FIGURES if figure.name == "fig-15")
    figure.write(results, tmp_path)
    light = (tmp_path / "fig-15.svg").read_text()
    dark = (tmp_path / "fig-15-dark.svg").read_text()
    assert "paper: lower" in light
    assert "#222222" in light
    assert "#222222" not in dark
    assert "#d5d8e0" in dark


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.name)
def test_the_figures_of_the_page_are_there(figure):
    for suffix in ("", "-dark"):
        path = FIGURES_OF_PAGE / f"{figure.name}{suffix}.svg"
        assert path.is_file(), "run `iswarm reproduce --tables`"


@pytest.mark.parametrize(
    ("name", "result"), [("table-1", "sensitivity"), ("fig-15", "hop-count"), ("fig-16", "types")]
)
def test_figures_of_the_page_are_of_the_present_results(tmp_path, monkeypatch, name, result):
    monkeypatch.setattr("iswarm_mj.utils.intervals.RESAMPLES", 9999)  # as on the page
    (figure,) = (figure for figure in FIGURES if figure.name == name)
    figure.write(collect_results([ROOT / "results/default" / result]), tmp_path)
    for path in sorted(tmp_path.glob("*.svg")):
        drawn = (FIGURES_OF_PAGE / path.name).read_text()
        assert words_of(drawn) == words_of(path.read_text()), "run `iswarm reproduce --tables`"
        assert coordinates_of(drawn) == pytest.approx(coordinates_of(path.read_text()), abs=0.5)


def words_of(svg):
    """Return the texts of a figure."""
    return re.findall(r"<text[^>]*>([^<]*)</text>", svg)


def coordinates_of(svg):
    """Return the coordinates of a figure's lines, areas and marks [pt]."""
    paths = re.findall(r' d="([^"]*)"', svg)
    places = re.findall(r'<use [^>]*x="([-\d.]+)" y="([-\d.]+)"', svg)
    numbers = [number for path in paths for number in re.findall(r"-?\d+\.?\d*", path)]
    return [float(number) for number in [*numbers, *(n for place in places for n in place)]]
