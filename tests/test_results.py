"""What is said of the checked-in results, in findings and on pages, is what the code says of their
tables."""

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
ENGINES = ("results/default", "results/mujoco")
REMEDY = "run `iswarm reproduce --tables`"


@pytest.fixture(scope="module")
def tables():
    return ResultBlocks(ROOT)


@pytest.mark.parametrize(
    "results",
    [f"results/{name}" for name in ("default", "initial", "mujoco", "cells", "stops", "selected")],
)
def test_findings_are_what_the_code_says_of_the_tables(tmp_path, results, tables):
    made = [topic for topic in tables.topics(results) if topic.results]
    files = {topic.results[0].path.with_name(FINDINGS): topic.findings for topic in made}
    assert files and set(files) == set((ROOT / results).rglob(FINDINGS))
    for path, findings in files.items():
        write_csv(tmp_path / FINDINGS, [finding._asdict() for finding in findings])
        assert path.read_text() == (tmp_path / FINDINGS).read_text(), REMEDY


@pytest.mark.parametrize("part", ["hop-count", "density"])
def test_both_engines_give_each_statement_the_same_verdict(part):
    planar, mujoco = (
        {
            row["claim"]: row["verdict"]
            for row in csv.DictReader((ROOT / at / part / FINDINGS).open())
        }
        for at in ENGINES
    )
    assert planar == mujoco and len(planar) >= 4


def test_evolutions_begin_as_random_search_does():
    """The first generation of both is drawn by the same numbers; its runs were worlds of other
    batches."""
    first, drawn = (
        [],
        ("replicate", "individual", "n_robots", "seed", *(field.name for field in fields(Genome))),
    )
    for method in ("paper", "random"):
        rows, _ = read_table(ROOT / "results/default" / f"evolve-{method}" / "evolution.parquet")
        first.append([[row[name] for name in drawn] for row in rows if row["generation"] == 0])
    assert first[0] == first[1] and len(first[0]) == 160


@pytest.mark.parametrize("method", ["paper", "random", "cmaes"])
def test_searches_are_repeated_with_the_densities_of_the_results(method):
    (part,) = parts_of(Plan(), Execution(), 16, 1, [f"evolve-{method}"])
    _, settings = read_table(ROOT / "results/default" / part.name / part.table)
    assert part.settings["operators"] == settings["operators"]


@pytest.mark.parametrize("page", PAGES)
def test_numbers_on_pages_are_those_of_the_results(page, tables):
    text = (ROOT / page).read_text()
    assert fill_blocks(text, tables.content) == text, REMEDY
