"""Pages of the report, which hold together."""

import base64
import re
import shutil
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

from iswarm_mj.commands.main import main
from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, KINDS, NOT_RUN
from iswarm_mj.experiments.report.results import collect
from iswarm_mj.experiments.report.writer import data_uri, report
from iswarm_mj.utils.errors import UserError

ROOT = Path(__file__).parents[2]


class Page(HTMLParser):
    """Checks that tags are balanced, and collects links, sources and text."""

    VOID = ("meta", "img", "br", "link")

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.links, self.sources, self.text = [], set(), set(), [], []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids |= {given["id"]} if "id" in given else set()
        self.links |= {given["href"]} if "href" in given else set()
        self.sources += [given["src"]] if "src" in given else []
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def written(results, tmp_path_factory):
    """Sections, path and content of a report."""
    out = tmp_path_factory.mktemp("report") / "report.html"
    sections = report([results], out)
    page = Page()
    page.feed(out.read_text())
    return sections, out, page


class TestReport:
    def test_the_page_is_whole_and_self_contained(self, written):
        page = written[2]
        assert page.open == [] and all(link[0] == "#" and link[1:] in page.ids for link in page.links)
        assert page.sources and all(source.startswith("data:image/") for source in page.sources)
        assert not re.search(r"https?://(?!www\.w3\.org)", written[1].read_text())
        assert "<code>" in written[1].read_text() and not any("`" in text for text in page.text)
        for source in page.sources:
            data = base64.b64decode(source.partition(",")[2])
            assert data.startswith(b"\x89PNG") or b"<svg" in data[:2000]

    def test_tables_can_be_read_on_a_phone_and_on_paper(self, written):
        """Heads repeat on printed pages; cells say of which column they are, where a narrow page stacks them."""
        text = written[1].read_text()
        tables = re.findall(r"<table.*?</table>", text, re.DOTALL)
        assert len(tables) > 10 and all(table.count("<thead>") == table.count("<tbody>") == 1 for table in tables)
        claims = [table for table in tables if 'class="claims' in table]
        for table in claims:
            heads = re.findall("<th>(.*?)</th>", table)
            named = re.findall('<td data-name="(.*?)">', table)
            assert named == heads[1:] * table.count("<tr data-verdict")
        assert len(claims) == len(written[0])

    def test_each_statement_stands_in_both_with_its_verdict(self, written):
        sections, out, page = written
        text, markdown = " ".join(page.text), out.with_suffix(".md").read_text()
        findings = [finding for section in sections for finding in section.findings]
        assert len(findings) > 45
        for finding in findings:
            assert finding.claim in text and finding.paper in text and finding.ours in text
            assert f"| {finding.claim} | {finding.source} |" in markdown
            assert finding.kind in KINDS and f"| {finding.kind} |" in markdown
        assert text.count("does not hold") >= sum(f.verdict == FAILS for f in findings)
        assert {f.verdict for f in sections[3].findings} == {HOLDS}
        assert {f.verdict for f in sections[5].findings} == {NOT_RUN}

    def test_verdicts_are_counted_by_kind(self, written):
        """Each cell of the summary is the number of the statements of its verdict and kind."""
        findings = [finding for section in written[0] for finding in section.findings]
        head, _, *lines = re.search(r"(\| Verdict \|(?:.*\n)+?)\n", written[1].with_suffix(".md").read_text())[
            1
        ].splitlines()
        kinds = [cell.strip() for cell in head.strip("| ").split("|")][1:-1]
        assert set(kinds) == {finding.kind for finding in findings} == set(KINDS)
        told = {}
        for line in lines:
            verdict, *numbers, total = (cell.strip("* ") for cell in line.strip("|").split("|"))
            assert sum(map(int, numbers)) == int(total)
            told |= {(verdict, kind): int(number) for kind, number in zip(kinds, numbers, strict=True) if number != "0"}
        assert told == Counter((finding.verdict or "not judged", finding.kind) for finding in findings)

    def test_figures_of_the_markdown_are_there(self, written):
        out = written[1]
        found = re.findall(r"!\[[^]]*\]\(([^)]+)\)", out.with_suffix(".md").read_text())
        assert len(found) >= 6 and all((out.parent / name).is_file() for name in found)

    def test_commands_are_told(self, written):
        text = " ".join(written[2].text)
        assert "iswarm experiment hop-count --genome type1 --seed 0 --optics.wall-range 2.0" in text
        assert "iswarm experiment density" in text and "iswarm evolve --method random" in text

    def test_a_quick_version_is_told(self, results, written, tmp_path):
        quick = report([results / "quick"], tmp_path / "r.html")
        assert "quick version" in quick[3].title and "quick version" not in written[0][3].title

    def test_other_results_stand_beside_the_first(self, results, tmp_path):
        """Values of the quick runs in a further cell of the statements on hop counts; all others have none."""
        sections = report([results / "full"], tmp_path / "r.html", beside=results / "quick")
        page = Page()
        page.feed((tmp_path / "r.html").read_text())
        assert page.open == []
        other = {f.claim: f for f in collect([results / "quick"]).used["hop-count"].findings}
        lines = (tmp_path / "r.md").read_text().splitlines()
        assert lines.count(next(line for line in lines if line.startswith("| Statement"))) == len(sections)
        for finding in sections[3].findings:
            line = next(line for line in lines if line.startswith(f"| {finding.claim} |"))
            theirs = other[finding.claim]
            assert line.endswith(
                f"**{finding.verdict}** | **{theirs.verdict}** {theirs.ours} |"
            ) and theirs.ours in " ".join(page.text)
        assert all(line.count(" | ") == 7 for line in lines if line.startswith("| Swarms of density"))

    def test_without_results_all_but_the_laws_is_open(self, tmp_path, capsys):
        (tmp_path / "empty").mkdir()
        main(["report", "--results", str(tmp_path / "empty"), "--out", str(tmp_path / "r.html")])
        told = capsys.readouterr().out
        assert "not run yet" in told
        assert told.startswith(f"no results found in {tmp_path / 'empty'}; the statements that are judged need none\n")
        page = Page()
        page.feed((tmp_path / "r.html").read_text())
        assert page.open == [] and page.sources == []

    def test_signs_of_html_are_text(self, tmp_path):
        (tmp_path / "<i>").mkdir()
        main(["report", "--results", str(tmp_path / "<i>"), "--out", str(tmp_path / "r.html")])
        text = (tmp_path / "r.html").read_text()
        assert "&lt;i&gt;" in text and "<i>" not in text

    def test_a_large_drawing_is_shown_as_pixels(self, tmp_path):
        (tmp_path / "a.png").write_bytes(b"\x89PNG few")
        (tmp_path / "a.svg").write_bytes(b"<svg>" + b" " * 500_000)
        assert data_uri(tmp_path / "a.png").startswith("data:image/png;base64,")
        (tmp_path / "a.svg").write_bytes(b"<svg/>")
        assert data_uri(tmp_path / "a.png") == "data:image/svg+xml;base64," + base64.b64encode(b"<svg/>").decode()

    def test_a_place_that_cannot_be_written_to_is_named_as_given(self, results, tmp_path):
        (tmp_path / "file").touch()
        with pytest.raises(
            UserError, match=r"^out must be a file in a writable directory \(got \S*/file/r\.html\); choose another"
        ):
            report([results / "quick"], tmp_path / "file" / "r.html")
        (tmp_path / "r.html").mkdir()
        with pytest.raises(UserError, match=r"r\.html cannot be written \(Is a directory\)"):
            report([results / "quick"], tmp_path / "r.html")

    @pytest.mark.parametrize(
        "flags, said",
        [
            (["--out", "r.pdf"], "--out must be a name that ends in .html"),
            (["--results"], "--results must be at least one directory"),
            (["--results", ".", "--beside", "nowhere"], "--beside must be an existing directory"),
        ],
    )
    def test_bad_flags_end_with_a_sentence(self, flags, said, capsys):
        with pytest.raises(SystemExit) as stop:
            main(["report", *flags])
        assert stop.value.code == 2 and said in capsys.readouterr().err


def test_the_page_has_links_to_videos_and_stays_small(tmp_path):
    results = tmp_path / "results"
    shutil.copytree(ROOT / "results-initial/types", results / "types")
    film = bytes(6_000_000)
    (results / "types/type1.mp4").write_bytes(film)
    out = tmp_path / "of mine.html"
    report([results], out)
    text = out.read_text()
    (source,) = re.findall('<video[^>]* src="(.*?)">', text)
    assert source == "of%20mine_figures/type1.mp4" and f'<a href="{source}">type1.mp4</a>' in text
    assert (tmp_path / unquote(source)).read_bytes() == film
    assert len(text) < 5_000_000 and text.count("data:image/png") >= 4
