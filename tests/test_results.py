"""What is said of the checked-in results, in findings and on pages, is what the code says of their tables."""

import re
from pathlib import Path

import numpy as np
import pytest

from iswarm_mj.experiments.analysis import verdicts
from iswarm_mj.experiments.analysis.measures import TIME, select, values
from iswarm_mj.experiments.report import engine_table
from iswarm_mj.experiments.report.assumptions import descriptions
from iswarm_mj.experiments.report.blocks import filled, outside
from iswarm_mj.experiments.report.results import collect
from iswarm_mj.experiments.report.statements import FINDINGS, findings_files, topics_of
from iswarm_mj.experiments.report.tables import Tables
from iswarm_mj.utils.tables import read_table, write_csv

ROOT = Path(__file__).parents[1]
PAGES = ["README.md", "CONTRIBUTING.md", "results/README.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))]
ENGINES = ("results", "results-mujoco")
REMEDY = "run `iswarm reproduce --tables`"
OTHER_TABLES = (
    "robots | steps | a step [ms] | memory at a fifth",
    "robots | recording",
    "part | model",
    "file | what is tried |",
    "what was asked for | at least",
    "part | planted | caught at first",
    "engine | balance: ms per control step",
    "kind | tried | broken when found |",
    "value | paper | initial | what the paper says",
    "package | contents",
    "column | unit | what it holds",
    "part | CPUs: `engine.py`, compiled by numba",
    "directory | command",
    "setting `optics.` | default | meaning",
    "robots | cores | ms per control step | sense | policy | physics | ARGoS 3, one core",
    "robots | worlds | reading | refinement | billion",
    "worlds | VMAS | environment",
    "file | contents |",
    "| delivered | picked up | collisions | clean worlds",
    "type | light | balls delivered | picked up",
    "once | now | test",
    "impl | robots | worlds | iterations | GPUs | million robot-physics-steps/s",
    "field | values | outside",
    "check | bits",
    "file | written by | what it holds",
    "exit code | meaning",
    "where | length | angle",
    "engine | where | use it for",
    "I want to | page",
    "method | returns",
    "eight worlds, ",
    "name | numbers | ",
    "robots | worlds | reading | `planar --refinement 1`: ms per control step",
)
"""Beginnings of the heads of tables that are not of results: on the code, and on speed with commands beside them."""


MADE = re.compile(r"<!-- made: .*?<!-- made -->", re.DOTALL)
"""Tables that the code determines, see `tools/make_tables.py`."""


def heads_of(page):
    """Heads of a page's tables outside of blocks."""
    text = MADE.sub("", outside((ROOT / page).read_text()))
    return re.findall(r"^\| *(.*)\n\|(?: *:?-+:? *\|)+$", text, re.MULTILINE)


@pytest.fixture(scope="module")
def tables():
    return Tables(ROOT)


@pytest.mark.parametrize("results", ["results", "results-initial", "results-mujoco"])
def test_findings_are_what_the_code_says_of_the_tables(tmp_path, results):
    files = findings_files(topics_of(collect([ROOT / results])))
    assert files and set(files) == set((ROOT / results).rglob(FINDINGS))
    for path, findings in files.items():
        write_csv(tmp_path / FINDINGS, [finding._asdict() for finding in findings])
        assert path.read_text() == (tmp_path / FINDINGS).read_text(), REMEDY


@pytest.mark.parametrize("part", engine_table.PARTS)
def test_both_engines_give_each_statement_the_same_verdict(part):
    planar, mujoco = (
        {finding.claim: finding.verdict for finding in found}
        for found in (findings_files(topics_of(collect([ROOT / at])))[ROOT / at / part / FINDINGS] for at in ENGINES)
    )
    assert planar == mujoco and len(planar) >= 4


@pytest.mark.parametrize("results", ["results", "results-initial"])
def test_evolutions_begin_as_random_search_does(results):
    """The first generation of all is drawn by the same numbers, and its runs end alike to the last bit."""
    first = []
    for method in ("paper", "random"):
        rows, _ = read_table(ROOT / results / f"evolve-{method}" / "evolution.parquet")
        first.append([row for row in rows if row["generation"] == 0])
    assert first[0] == first[1] and len(first[0]) == 160


def test_the_scatter_of_the_times_is_that_of_the_results():
    rows = collect([ROOT / "results/types"]).experiments["types"].rows
    times = [values(select(rows, type=name), TIME) for name in ("type1", "type2")]
    one, two = (100 * np.std(sample, ddof=1) / np.mean(sample) for sample in times)
    assert f"scatter by {one:.0f} and {two:.0f} %" in descriptions(verdicts)["EQUAL"]


@pytest.mark.parametrize("page", PAGES)
def test_numbers_on_pages_are_those_of_the_results(page, tables):
    text = (ROOT / page).read_text()
    assert filled(text, page, tables.content) == text, REMEDY


@pytest.mark.parametrize("page", PAGES)
def test_tables_of_results_stand_in_blocks(page):
    heads = heads_of(page)
    assert [head for head in heads if not head.startswith(OTHER_TABLES)] == []


def test_other_tables_are_there():
    heads = [head for page in PAGES for head in heads_of(page)]
    assert [known for known in OTHER_TABLES if not any(head.startswith(known) for head in heads)] == []


@pytest.mark.parametrize("page", ["docs/comparison.md", "docs/results.md"])
def test_a_changed_number_is_noticed(page, tables):
    """The last number of each block, changed by one digit, is not what the results give."""
    text = (ROOT / page).read_text()
    for block in re.finditer(r"<!-- results.*?<!-- end -->", text, re.DOTALL):
        *_, digit = re.finditer(r"\d", block[0])
        place = block.start() + digit.start()
        changed = text[:place] + str((int(digit[0]) + 1) % 10) + text[place + 1 :]
        assert filled(changed, page, tables.content) == text != changed
