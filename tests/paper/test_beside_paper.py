"""The page with our figures beside the paper's values: its cards and its figures."""

from pathlib import Path

import pytest

from iswarm_mj.paper.analysis.findings import FAILS, HOLDS, NOT_IN_PAPER, UNDECIDED
from iswarm_mj.paper.report import beside_paper
from iswarm_mj.paper.report.beside_paper import cards, tally
from iswarm_mj.paper.report.paper_figures import FIGURES, TABLE_1
from iswarm_mj.paper.report.results import collect_results, topics_of

ROOT = Path(__file__).parents[2]
HOP_COUNT = ROOT / "results/default/hop-count"
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
            == "**4** statements of the paper are judged: 1 holds, 2 do not, 1 is undecided."
        )


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
    unused = beside_paper._verdict_on_table_1
    rows = collect_results([ROOT / "results/default/sensitivity"])["sensitivity"].rows
    assert unused(rows).startswith("**All 11 values are used unchanged.**")


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
        path = ROOT / f"results/default/beside-paper/{figure.name}{suffix}.svg"
        assert path.is_file(), "run `iswarm reproduce --tables`"
