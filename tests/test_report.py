"""The report: statements on made-up results, what it reads, and pages that hold together."""

import base64
import re
from dataclasses import asdict, replace
from html.parser import HTMLParser

import numpy as np
import pytest
import tyro

from iswarm_mj.cli import main
from iswarm_mj.commands.evolve import Evolve
from iswarm_mj.config import ArenaConfig, OpticsConfig, SwarmConfig
from iswarm_mj.errors import UserError
from iswarm_mj.experiments import choices, evolution_findings, grasp_findings, hop_count, law_findings
from iswarm_mj.experiments.evolve import Search
from iswarm_mj.experiments.findings import FAILS, HOLDS, NOT_RUN, TOO_FEW
from iswarm_mj.experiments.jobs import Outcome
from iswarm_mj.experiments.report import report
from iswarm_mj.experiments.report_html import embedded
from iswarm_mj.experiments.report_results import collect, command
from iswarm_mj.experiments.study import Plan, row_of
from iswarm_mj.strategy.evolution import Operators
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tables import write_table


def search_rows(generations=120, population=10, learns=True, seed=0):
    """A made-up search: fitness rises up to generation 35; only those that count hops clean the arena."""
    rng = np.random.default_rng(seed)
    rows = []
    for generation in range(generations):
        level = min(generation, 35) / 35 if learns else 0.5
        for individual in range(population):
            scouts = rng.uniform(0, 0.4)
            counts = bool(rng.random() < 0.3 + 0.6 * level)
            clean = counts and bool(rng.random() < 0.9)
            genome = Genome(
                fraction_scouts=scouts, p_vector_forget=float(np.clip(0.4 - 0.7 * scouts + rng.normal(0, 0.04), 0, 1)),
                use_hop_count=counts, density_of_robots=float(np.clip(rng.normal(0.125, 0.002), 0.1, 0.2)),
            )  # fmt: skip
            fitness = (4000 if clean else 1500) + 3500 * level + rng.normal(0, 100)
            measures = {"n_robots": 297, "delivered": 72 if clean else 40, "fitness": float(fitness)}
            rows.append({"generation": generation, "individual": individual, **asdict(genome), **measures})
    return rows


def grasp_rows(grasp=25.0, release=42.0, slope=0.0):
    """Made-up trials: 5 radii, 3 humidities, 5 repeats."""
    rng = np.random.default_rng(0)
    rows = []
    for radius in np.linspace(15e-6, 25e-6, 5):
        for rh in (10.0, 30.0, 50.0):
            for repeat in range(5):
                common = {"radius": float(radius), "relative_humidity": rh, "repeat": repeat, "seed": 0,
                          "melted": False,
                          "work_tool_object": 1.4e-3, "work_object_substrate": 14.7e-3, "flight_time": None,
                          "landing_speed": None, "landed": None, "quasi_static_voltage": 25.0, "faulty": False,
                          "engine": "mujoco", "impl": "c", "step_voltage": 0.25}  # fmt: skip
                wet = (rh - 10) / 8
                lift = grasp + wet + slope * (radius * 1e6 - 20) + rng.normal(0, 1)
                drop = release + wet + rng.normal(0, 1)
                rows += [
                    {**common, "experiment": "no_contact", "gap": 1e-6, "voltage": None, "limit_voltage": 50.0},
                    {**common, "experiment": "grasp", "gap": 0.0, "voltage": float(lift), "limit_voltage": 80.0},
                    {**common, "experiment": "release", "gap": 5e-6, "voltage": float(drop), "limit_voltage": 80.0,
                     "landed": True},
                ]  # fmt: skip
    return rows


GRASP_SETTINGS = {
    "radii": [15e-6, 25e-6], "humidities": [10.0, 30.0], "repeats": 5, "seed": 4, "engine": "mujoco", "impl": "jax",
    "calibration": {},
}  # fmt: skip


def settings_of(method="paper", **changes):
    return asdict(replace(Search(method=method), **changes))


def by_claim(findings):
    return {finding.claim: finding for finding in findings}


@pytest.fixture(scope="module")
def found():
    """Findings of a made-up evolution beside a random search."""
    paper, random = (search_rows(), settings_of()), (search_rows(learns=False, seed=1), settings_of("random"))
    return by_claim(evolution_findings.findings({"paper": paper, "random": random}))


class TestEvolution:
    @pytest.mark.parametrize(
        "claim",
        ["RISES", "LEARNS", "BEATS", "MANY_FAIL", "COUNTED", "UNCOUNTED", "SCOUTS", "FORGET", "TRADE", "DENSITY",
         "SIGNALS", "WEIGHTS", "DISTANCES"],
    )  # fmt: skip
    def test_a_search_that_goes_as_the_papers(self, found, claim):
        assert found[getattr(evolution_findings, claim).text].verdict == HOLDS

    def test_what_was_not_run_is_said(self, found):
        assert found[evolution_findings.RIVAL.text].verdict == NOT_RUN
        assert {f.verdict for f in evolution_findings.findings({})} == {NOT_RUN}

    def test_shares_are_counted(self, found):
        """Those that clean the arena all count hops, as they were made."""
        rows = search_rows()
        clean = sum(row["delivered"] == 72 for row in rows)
        assert found[evolution_findings.COUNTED.text].ours.startswith(f"{clean} of {clean}, 100.0 %")
        assert found[evolution_findings.MANY_FAIL.text].ours.startswith(f"{1200 - clean} of 1200, ")

    def test_a_search_that_learns_nothing(self):
        rows = search_rows(learns=False)
        for row, other in zip(rows, np.random.default_rng(2).uniform(0, 1, len(rows)), strict=True):
            row["p_vector_forget"] = float(other)
            row["use_hop_count"] = bool(other < 0.5)
        found = by_claim(evolution_findings.findings({"paper": (rows, settings_of())}))
        for claim in ("RISES", "LEARNS", "COUNTED", "TRADE"):
            assert found[getattr(evolution_findings, claim).text].verdict == FAILS, claim

    @pytest.mark.parametrize("n, apart, verdict", [(5000, 0.0, HOLDS), (60, 0.2, TOO_FEW), (500, 1.0, FAILS)])
    def test_equal_is_what_surely_differs_by_little(self, n, apart, verdict):
        rng = np.random.default_rng(0)
        good, poor = ([{"x": v} for v in rng.normal(shift, 1, n)] for shift in (0, apart))
        assert evolution_findings._equal(evolution_findings.SCOUTS, "x", good, poor).verdict == verdict

    def test_the_best_runs_are_told_too(self, found):
        means = [np.mean(sorted(row["fitness"] for row in rows)[-100:])
                 for rows in (search_rows(), search_rows(learns=False, seed=1))]  # fmt: skip
        assert (
            f"of the 100 best runs {means[0]:.0f} against {means[1]:.0f}" in found[evolution_findings.BEATS.text].ours
        )

    def test_a_short_search_decides_nothing_that_needs_more(self):
        found = by_claim(evolution_findings.findings({"paper": (search_rows(10), settings_of())}))
        for claim in ("RISES", "LEARNS", "TRADE", "DENSITY", "SIGNALS"):
            assert found[getattr(evolution_findings, claim).text].verdict == TOO_FEW, claim

    @pytest.mark.parametrize(
        "n_good, n_counting, n_poor, n_not_counting, verdicts",
        [
            (5, 5, 4, 1, (TOO_FEW, TOO_FEW, TOO_FEW)),
            (29, 29, 29, 29, (HOLDS, TOO_FEW, TOO_FEW)),
            (60, 60, 40, 36, (HOLDS, HOLDS, HOLDS)),
            (60, 57, 40, 22, (HOLDS, TOO_FEW, TOO_FEW)),  # Wilson: 0.863 to 0.983, 0.398 to 0.693
            (970, 700, 30, 3, (FAILS, FAILS, FAILS)),
            (78, 78, 22, 0, (TOO_FEW, HOLDS, TOO_FEW)),  # Wilson: 0.150 to 0.311
        ],
    )
    def test_shares_are_judged_by_their_intervals(self, n_good, n_counting, n_poor, n_not_counting, verdicts):
        row = search_rows(1)[0]
        rows = [row | {"delivered": 72, "use_hop_count": k < n_counting} for k in range(n_good)]
        rows += [row | {"delivered": 40, "use_hop_count": k >= n_not_counting} for k in range(n_poor)]
        found = by_claim(evolution_findings.findings({"paper": (rows, settings_of())}))
        claims = (evolution_findings.MANY_FAIL, evolution_findings.COUNTED, evolution_findings.UNCOUNTED)
        assert tuple(found[claim.text].verdict for claim in claims) == verdicts

    def test_the_fittest_are_those_of_generations_35_to_100(self):
        rows = [{"generation": g, "fitness": float(g % 97), "individual": k} for g in range(120) for k in range(10)]
        top = evolution_findings.fittest(rows, 35, 100)
        assert (
            len(top) == 250
            and min(r["fitness"] for r in top) == 72
            and {r["generation"] for r in top} == set(range(72, 97))
        )


class TestGripper:
    def test_trials_that_go_as_the_papers(self):
        found = grasp_findings.findings(grasp_rows())
        assert {f.claim: f.verdict for f in found if f.verdict not in (HOLDS, "")} == {}
        assert sum("higher at" in f.claim for f in found) == 2

    @pytest.mark.parametrize(
        "changes, claim",
        [({"grasp": 33.0}, "GRASP"), ({"release": 49.0}, "RELEASE"), ({"slope": 0.6}, "FLAT_GRASP"),
         ({"release": 75.0}, "THEORY")],
    )  # fmt: skip
    def test_trials_that_do_not(self, changes, claim):
        found = by_claim(grasp_findings.findings(grasp_rows(**changes)))
        assert found[getattr(grasp_findings, claim).text].verdict == FAILS

    def test_single_trials_can_spoil_a_statement(self):
        rows = grasp_rows()
        rows[0]["voltage"] = 45.0
        next(r for r in rows if r["experiment"] == "grasp")["voltage"] = None
        next(r for r in rows if r["experiment"] == "release")["landed"] = False
        found = by_claim(grasp_findings.findings(rows))
        assert [found[getattr(grasp_findings, c).text].verdict for c in ("PURE", "ALWAYS", "RELIABLE")] == [FAILS] * 3

    def test_faulty_rows_do_not_count(self):
        rows = grasp_rows()
        for row in rows[::7]:
            row |= {"faulty": True, "voltage": 1000.0}
        assert FAILS not in {f.verdict for f in grasp_findings.findings(rows)}

    def test_laws(self):
        """The slips of the paper's numbers, and what its equations give; worked by hand in the laws' own tests."""
        found = {f.claim: f for f in law_findings.findings()}
        assert "106 to 1063 V; 123 to 1228 V" in found[law_findings.RANGE.text].ours
        assert (
            found[law_findings.CONSTANT.text].verdict == FAILS and "4.753e+05" in found[law_findings.CONSTANT.text].ours
        )
        assert found[law_findings.POINTS.text].ours == "2860 and 8380"
        assert "release 0.894, pick 0.57" in found[law_findings.ASYMPTOTE.text].ours
        assert found[law_findings.SQUARE.text].verdict == found[law_findings.SCALE.text].verdict == HOLDS


class TestChoices:
    def test_they_are_what_the_configuration_says_without_the_paper(self):
        found = {choice.name: choice for choice in choices.choices()}
        assert found["strategy.dust-range"].value == "0.75" and "sensed within" in found["strategy.dust-range"].meaning
        assert "optics.led-beam-aperture" not in found and "gripper.work-tool-object" not in found
        assert found["strategy.update-order"].value == "synchronous"
        assert all(choice.meaning for choice in found.values()) and len(found) > 15

    def test_what_was_fitted(self):
        assert {c.name for c in choices.fitted()} >= {"WORK_TOOL_OBJECT", "WORK_OBJECT_SUBSTRATE", "CONTACT_GAP"}
        assert choices.fitting().startswith("The default constants are a calibration, not measurements.")
        assert len(choices.operators()) >= 5 and all("\n" not in item for item in choices.operators())


def write_hop_count(directory, plan):
    def outcome(job):
        counts = job.genome.use_hop_count
        time = 150 + job.seed % 20 if counts else None
        return Outcome(66 if counts else 20, 70, 280 * (10 if counts else 30), 60.0 if counts else 200.0, time, 9, 1.0)

    directory.mkdir(parents=True)
    rows = [row_of(entry, outcome(entry.job)) for entry in hop_count.entries(plan)]
    settings = {"experiment": "hop-count", "engine": "mujoco", **asdict(plan)}
    write_table(directory / "hop_count.parquet", rows, settings)
    write_table(directory / "findings.parquet", [{"claim": "x"}], settings)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Directories with some results: hop counts, one quick, a search, trials."""
    root = tmp_path_factory.mktemp("results")
    write_hop_count(root / "quick", Plan(quick=True, seed=9))
    write_hop_count(root / "full", Plan(config=SwarmConfig(optics=OpticsConfig(wall_range=2.0))))
    for name in ("evolve", "trials"):
        (root / name).mkdir()
    write_table(root / "evolve/evolution.parquet", search_rows(), settings_of())
    write_table(root / "trials/trials.parquet", grasp_rows(), GRASP_SETTINGS)
    (root / "trials/other.parquet").write_bytes(b"something else")
    return root


class TestResults:
    def test_full_tables_come_before_quick_ones(self, results):
        found = collect([results])
        assert found.experiments["hop-count"].path == results / "full/hop_count.parquet"
        assert found.left_out == [results / "quick/hop_count.parquet"]
        assert set(found.searches) == {"paper"} and found.trials is not None

    def test_commands_make_them_again(self, results):
        found = collect([results])
        assert command(found.experiments["hop-count"]) == (
            "iswarm experiment hop-count --genome type1 --seed 0 --optics.wall-range 2.0 --out DIR"
        )
        assert command(found.searches["paper"]).startswith(
            "iswarm evolve --method paper --generations 120 --population 10 "
        )
        assert command(found.trials).startswith(
            "iswarm grasp --radius 1.5e-05 2.5e-05 --rh 10 30 --repeats 5 --seed 4 "
        )
        assert " --quick" in command(collect([results / "quick"]).experiments["hop-count"])

    def test_operators_and_another_setting_are_told(self, tmp_path):
        """The command brings back the settings; a comment says what is not the paper's."""
        search = Search(
            SwarmConfig(arena=ArenaConfig(n_dust=24), optics=OpticsConfig(line_of_sight=False)),
            Operators(elite=3, relative_span=True), steps=200,
        )  # fmt: skip
        write_table(tmp_path / "evolution.parquet", search_rows(1), asdict(search))
        told, _, comment = command(collect([tmp_path]).searches["paper"]).partition("  # ")
        assert comment == "not the paper's setting: arena.n-dust 24, 200 steps"
        given = tyro.cli(Evolve, args=told.split()[2:])
        assert (given.operators, given.arena, given.optics, given.steps) == (
            search.operators, search.config.arena, search.config.optics, 200,
        )  # fmt: skip

    def test_an_experiment_in_another_arena_is_told(self, tmp_path):
        write_hop_count(tmp_path / "a", Plan(config=SwarmConfig(arena=ArenaConfig(n_dust=24))))
        assert command(collect([tmp_path]).experiments["hop-count"]).endswith(
            " --arena.n-dust 24 --out DIR  # not the paper's setting: arena.n-dust 24"
        )

    def test_a_genome_that_is_no_preset_is_told(self, tmp_path):
        write_hop_count(tmp_path / "a", Plan(genome=replace(PRESETS["type1"], fraction_scouts=0.5)))
        assert "--genome GENOME.json" in command(collect([tmp_path]).experiments["hop-count"])

    def test_a_directory_that_is_not_there(self, capsys):
        with pytest.raises(SystemExit) as stop:
            main(["report", "--results", "nowhere"])
        assert stop.value.code == 2 and "--results was nowhere; it must be a directory" in capsys.readouterr().err


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

    def test_each_statement_stands_in_both_with_its_verdict(self, written):
        sections, out, page = written
        text, markdown = " ".join(page.text), out.with_suffix(".md").read_text()
        findings = [finding for section in sections for finding in section.findings]
        assert len(findings) > 45
        for finding in findings:
            assert finding.claim in text and finding.paper in text and finding.ours in text
            assert f"| {finding.claim} | {finding.source} |" in markdown
        assert text.count("does not hold") >= sum(f.verdict == FAILS for f in findings)
        assert {f.verdict for f in sections[3].findings} == {HOLDS}
        assert {f.verdict for f in sections[5].findings} == {NOT_RUN}

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

    def test_without_results_all_but_the_laws_is_open(self, tmp_path, capsys):
        (tmp_path / "empty").mkdir()
        main(["report", "--results", str(tmp_path / "empty"), "--out", str(tmp_path / "r.html")])
        assert "not run yet" in capsys.readouterr().out
        page = Page()
        page.feed((tmp_path / "r.html").read_text())
        assert page.open == [] and page.sources == []

    def test_signs_of_html_are_text(self, written):
        assert "p &lt; 0.01" in written[1].read_text()

    def test_a_large_drawing_is_shown_as_pixels(self, tmp_path):
        (tmp_path / "a.png").write_bytes(b"\x89PNG few")
        (tmp_path / "a.svg").write_bytes(b"<svg>" + b" " * 500_000)
        assert embedded(tmp_path / "a.png").startswith("data:image/png;base64,")
        (tmp_path / "a.svg").write_bytes(b"<svg/>")
        assert embedded(tmp_path / "a.png") == "data:image/svg+xml;base64," + base64.b64encode(b"<svg/>").decode()

    def test_a_place_that_cannot_be_written_to_is_named_as_given(self, results, tmp_path):
        (tmp_path / "file").touch()
        with pytest.raises(
            UserError, match=r"--out was \S*/file/r\.html, which cannot .* in a directory of yours: choo"
        ):
            report([results / "quick"], tmp_path / "file" / "r.html")
        (tmp_path / "r.html").mkdir()
        with pytest.raises(UserError, match=r"r\.html cannot be written to \(Is a directory\)"):
            report([results / "quick"], tmp_path / "r.html")

    @pytest.mark.parametrize(
        "flags, said",
        [(["--out", "r.pdf"], "must be a name ending in .html"), (["--results"], "--results was empty")],
    )
    def test_bad_flags_end_with_a_sentence(self, flags, said, capsys):
        with pytest.raises(SystemExit) as stop:
            main(["report", *flags])
        assert stop.value.code == 2 and said in capsys.readouterr().err
