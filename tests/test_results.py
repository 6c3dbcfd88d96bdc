"""Checked-in results: findings and pages agree with what the code makes of their tables."""

import csv
from dataclasses import fields
from pathlib import Path

import pytest

from iswarm_mj.paper.report.page_blocks import ResultBlocks, fill_blocks
from iswarm_mj.paper.report.reproduce import parts_of
from iswarm_mj.paper.studies.experiment import FINDINGS, Plan
from iswarm_mj.search.pool import Execution
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.tables import read_table, write_csv

ROOT = Path(__file__).parents[1]
PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    "results/README.md",
    *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md")),
]
REMEDY = "run `iswarm reproduce --tables`"


@pytest.fixture(scope="module")
def tables():
    """Tables of the checked-in results, which pages state."""
    return ResultBlocks(ROOT)


@pytest.mark.parametrize(
    "results",
    [f"results/{name}" for name in ("default", "initial", "mujoco", "cells", "stops", "selected")],
)
def test_findings_are_what_the_code_says_of_the_tables(tmp_path, results, tables):
    files = {}
    for topic in tables.topics(results):
        if topic.results:
            files[topic.results[0].path.with_name(FINDINGS)] = topic.findings
    assert files
    assert set(files) == set((ROOT / results).rglob(FINDINGS))
    for path, findings in files.items():
        write_csv(tmp_path / FINDINGS, [finding._asdict() for finding in findings])
        assert path.read_text() == (tmp_path / FINDINGS).read_text(), REMEDY


def verdicts_of(findings):
    """Return the verdict of each claim in a file of findings."""
    with findings.open() as file:
        return {row["claim"]: row["verdict"] for row in csv.DictReader(file)}


OTHER_CONTACTS = pytest.mark.xfail(
    reason="MuJoCo's table has the contacts before those that begin at a margin", strict=True
)


@pytest.mark.parametrize("part", ["hop-count", pytest.param("density", marks=OTHER_CONTACTS)])
def test_both_engines_give_each_statement_the_same_verdict(part):
    of_planar = verdicts_of(ROOT / "results/default" / part / FINDINGS)
    of_mujoco = verdicts_of(ROOT / "results/mujoco" / part / FINDINGS)
    assert of_planar == of_mujoco
    assert len(of_planar) >= 4


DRAWN = ("replicate", "individual", "n_robots", "seed", *(field.name for field in fields(Genome)))
"""Columns of a table of evolution that are drawn, and measured by no run."""


def first_generation(method):
    """Return the drawn columns of the first generation of a search, row by row."""
    rows, _ = read_table(ROOT / "results/default" / f"evolve-{method}" / "evolution.parquet")
    return [[row[name] for name in DRAWN] for row in rows if row["generation"] == 0]


def test_evolutions_begin_as_random_search_does():
    """The first generation of both is drawn by the same numbers."""
    of_evolution = first_generation("paper")
    assert len(of_evolution) == 160
    assert of_evolution == first_generation("random")


@pytest.mark.parametrize("method", ["paper", "random", "cmaes"])
def test_searches_are_repeated_with_the_densities_of_the_results(method):
    (part,) = parts_of(Plan(), Execution(), 16, 1, [f"evolve-{method}"])
    _, settings = read_table(ROOT / "results/default" / part.name / part.table)
    # Tables of earlier versions lack operators that came later.
    assert part.settings["operators"].items() >= settings["operators"].items()


@pytest.mark.parametrize("page", PAGES)
def test_numbers_on_pages_are_those_of_the_results(page, tables):
    text = (ROOT / page).read_text()
    assert fill_blocks(text, tables.content) == text, REMEDY
