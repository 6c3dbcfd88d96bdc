"""The page of the report, and the tables that it takes."""

import base64
import re
from html import unescape
from pathlib import Path

import pytest
from support.findings import search_rows, settings_of

from iswarm_mj.commands.main import main
from iswarm_mj.paper.analysis.findings import HOLDS, NOT_RUN
from iswarm_mj.paper.report.html_report import write_report
from iswarm_mj.paper.report.results import collect_results, files_in
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.utils.tables import read_table, write_table

RESULTS = Path(__file__).parents[2] / "results/default"


@pytest.fixture(scope="module")
def written(results, tmp_path_factory):
    """Return the sections of a report, and its page."""
    path = tmp_path_factory.mktemp("report") / "report.html"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("iswarm_mj.utils.intervals.RESAMPLES", 1999)
        sections = write_report([results], path)
    return sections, path.read_text()


class TestPage:
    @pytest.fixture
    def sections(self, written):
        """Return the sections of the report."""
        return written[0]

    @pytest.fixture
    def page(self, written):
        """Return the page of the report."""
        return written[1]

    def test_links_lead_to_places_on_it(self, page):
        targets = set(re.findall(r'href="#(\w+)"', page))
        places = set(re.findall(r'id="(\w+)"', page))
        assert targets <= places
        assert 'href="h' not in page

    def test_it_contains_its_pictures(self, page):
        pictures = re.findall(r'src="data:image/[^,]*,([^"]*)"', page)
        assert len(pictures) == page.count("<img src") >= 6
        for picture in map(base64.b64decode, pictures):
            assert picture.startswith(b"\x89PNG") or b"<svg" in picture[:2000]

    def test_each_statement_stands_on_it(self, page, sections):
        text = unescape(re.sub(r"<[^>]*>", "\n", page))
        for section in sections:
            for finding in section.findings:
                assert finding.claim in text
                assert finding.paper in text
                assert finding.ours in text
                assert finding.statistics in text

    def test_verdicts_follow_from_the_results(self, sections):
        assert {finding.verdict for finding in sections[3].findings} == {HOLDS}
        assert {finding.verdict for finding in sections[5].findings} == {NOT_RUN}

    def test_signs_of_html_are_text(self, tmp_path, capsys):
        """Here in the name of a directory without results."""
        empty = tmp_path / "<i>"
        empty.mkdir()
        main(["report", "--results", str(empty), "--out", str(tmp_path / "r.html")])
        assert capsys.readouterr().out.startswith(f"no results found in {empty}")
        page = (tmp_path / "r.html").read_text()
        assert "<img src" not in page
        assert "<i>" not in page
        assert "&lt;i&gt;" in page


class TestTables:
    def test_full_ones_come_before_quick_ones_however_many_rows_these_have(self, results, tmp_path):
        collected = collect_results([results])
        assert list(collected) == ["grasp", "evolve-paper", "hop-count"]
        full = collected["hop-count"]
        assert full.path == results / "full/hop_count.parquet"

        quick_settings = {**full.settings, "quick": True}
        write_table(tmp_path / "hop_count.parquet", [*full.rows, *full.rows], quick_settings)
        assert collect_results([tmp_path, results / "full"])["hop-count"].path == full.path
        assert len(collect_results([tmp_path])["hop-count"].rows) == 48

    def test_links_out_of_the_directory_are_not_followed(self, results, tmp_path):
        table = tmp_path / "inside/types/evolution.parquet"
        table.parent.mkdir(parents=True)
        write_table(table, search_rows(2), settings_of())
        for name in ("evolution.parquet", "type1.png"):
            link = tmp_path / "inside" / name
            link.symlink_to(results / "evolve" / "evolution.parquet")
        collected = collect_results([tmp_path / "inside"])
        assert [result.path for result in collected.values()] == [table]
        assert list(files_in(tmp_path / "inside", "*.png")) == []


@pytest.mark.usefixtures("few_pixels")
@pytest.mark.parametrize("name", ["types", "sensitivity", "resolved-grasps", "infer"])
def test_each_experiment_draws_its_table(tmp_path, name, monkeypatch):
    monkeypatch.setattr("iswarm_mj.utils.intervals.RESAMPLES", 99)
    rows, _ = read_table(RESULTS / name / EXPERIMENTS[name].table)
    EXPERIMENTS[name].draw(rows, tmp_path)
    assert list(tmp_path.glob("*.png"))
