"""The page of the report, which tables it takes, and figures that are drawn again from stored
tables."""

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

ROOT = Path(__file__).parents[2]


def test_the_page_is_whole_and_self_contained(results, tmp_path):
    """Links lead to places on it, pictures are in it, and each statement stands on it."""
    sections = write_report([results], tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert {*re.findall(r'href="#(\w+)"', page)} <= {
        *re.findall(r'id="(\w+)"', page)
    } and 'href="h' not in page
    sources = re.findall(r'src="data:image/[^,]*,([^"]*)"', page)
    assert len(sources) == page.count("<img src") >= 6
    for data in map(base64.b64decode, sources):
        assert data.startswith(b"\x89PNG") or b"<svg" in data[:2000]
    text = unescape(re.sub(r"<[^>]*>", "\n", page))
    for finding in (finding for section in sections for finding in section.findings):
        assert all(
            part in text
            for part in (finding.claim, finding.paper, finding.ours, finding.statistics)
        )
    assert {f.verdict for f in sections[3].findings} == {HOLDS}
    assert {f.verdict for f in sections[5].findings} == {NOT_RUN}


def test_full_tables_come_before_quick_ones(results, tmp_path):
    """However many rows these have."""
    full = collect_results([results])["hop-count"]
    assert full.path == results / "full/hop_count.parquet"
    assert list(collect_results([results])) == ["grasp", "evolve-paper", "hop-count"]
    write_table(
        tmp_path / "hop_count.parquet", [*full.rows, *full.rows], {**full.settings, "quick": True}
    )
    assert collect_results([tmp_path, results / "full"])["hop-count"].path == full.path
    assert len(collect_results([tmp_path])["hop-count"].rows) == 48


def test_links_out_of_the_directory_are_not_followed(results, tmp_path):
    inside = tmp_path / "inside"
    (inside / "types").mkdir(parents=True)
    write_table(inside / "types" / "evolution.parquet", search_rows(2), settings_of())
    for name in ("evolution.parquet", "type1.png"):
        (inside / name).symlink_to(results / "evolve" / "evolution.parquet")
    assert [result.path for result in collect_results([inside]).values()] == [
        inside / "types" / "evolution.parquet"
    ]
    assert list(files_in(inside, "*.png")) == []


def test_without_results_all_but_the_laws_is_open_and_signs_of_html_are_text(tmp_path, capsys):
    empty = tmp_path / "<i>"
    empty.mkdir()
    main(["report", "--results", str(empty), "--out", str(tmp_path / "r.html")])
    assert capsys.readouterr().out.startswith(f"no results found in {empty}")
    page = (tmp_path / "r.html").read_text()
    assert "<img src" not in page and "<i>" not in page and "&lt;i&gt;" in page


@pytest.mark.usefixtures("few_pixels")
@pytest.mark.parametrize("name", ["types", "sensitivity", "resolved-grasps", "infer"])
def test_each_experiment_draws_its_table(tmp_path, name, monkeypatch):
    monkeypatch.setattr("iswarm_mj.paper.analysis.statistics.RESAMPLES", 99)
    EXPERIMENTS[name].draw(
        read_table(ROOT / "results/default" / name / EXPERIMENTS[name].table)[0], tmp_path
    )
    assert list(tmp_path.glob("*.png"))
