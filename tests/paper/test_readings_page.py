"""The page on readings says what the tables of the results say."""

from pathlib import Path

import numpy as np
import pytest

from iswarm_mj.config.swarm import INTERPRETATIONS, SwarmConfig
from iswarm_mj.paper.studies.experiment import varied
from iswarm_mj.paper.studies.reading_combinations import DEFAULT_LABELS, FACTORS
from iswarm_mj.paper.studies.reading_support import (
    accept_best,
    combinations_of,
    reproduced_statements,
    support_of_factors,
)
from iswarm_mj.search.rows import by
from iswarm_mj.utils.tables import read_table

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/readings.md"


@pytest.fixture(scope="module")
def rows():
    """Return the rows of the study."""
    return read_table(ROOT / "results/default/infer/infer.parquet")[0]


@pytest.fixture(scope="module")
def combinations(rows):
    """Return the combinations of readings that were run."""
    return combinations_of(rows)


@pytest.fixture(scope="module")
def support_of(combinations):
    """Return the support of each factor."""
    return support_of_factors(combinations)


class TestInference:
    """Statements of the runs of `infer` on the readings."""

    def test_the_selected_reading_is_that_of_the_rule(self, support_of):
        settings = {}
        for name, support in support_of.items():
            levels = FACTORS[name]
            assert support.counts.keys() == support.shares.keys() == levels.keys()
            settings |= dict(levels[support.replacement or DEFAULT_LABELS[name]])
        assert varied(SwarmConfig(), settings) == INTERPRETATIONS["selected"]

    def test_only_turns_pass_the_correction_for_many_factors(self, support_of):
        passing = {name for name, support in support_of.items() if support.adjusted_p < 0.05}
        assert passing == {"turns"}
        for share in support_of["dust_offset"].shares.values():
            assert share.low < 1 / 3 < share.high

    def test_the_best_combinations_do_not_take_the_paper_s_time(self, rows, combinations):
        kept = accept_best(combinations).accepted
        first_runs = [row for row in rows if row["combination"] == 0]
        _, held_out = reproduced_statements(first_runs)
        place = list(held_out).index("Type 1 takes 310 steps")
        for combination in kept:
            assert not combination.held_out[place]
            assert not combination.held_out[place + 1]

    def test_the_paper_s_reading_gives_what_was_held_out_but_less_of_the_rest(self, combinations):
        kept = accept_best(combinations).accepted
        paper, _ = (combination for combination in combinations if combination.is_named)
        assert all(paper.held_out)
        assert sum(paper.answers) < sum(kept[-1].answers)


def fittest(rows):
    """Return the row with the highest fitness."""
    return max(rows, key=lambda row: row["fitness"])


def evolution_cells(directory):
    """Return what the page says of some evolutions.

    That is the density, the points and the time of the fittest, the share of quick swarms, and the
    number of clean arenas without hop counts.
    """
    rows, _ = read_table(ROOT / directory / "evolution.parquet")
    last_eight = max(row["generation"] for row in rows) - 7
    late_densities = []
    for (_, generation), runs in by(rows, "replicate", "generation").items():
        if generation >= last_eight:
            late_densities.append(fittest(runs)["density_of_robots"])
    first_quartile, median, third_quartile = np.quantile(late_densities, [0.25, 0.5, 0.75])
    cells = [f"{median:.3f} ({first_quartile:.3f} to {third_quartile:.3f})"]

    best_runs = [fittest(runs) for runs in by(rows, "replicate").values()]
    for name in ("fitness", "finished_at"):
        values = [row[name] for row in best_runs]
        cells.append(f"{np.median(values):.0f} ({min(values):.0f} to {max(values):.0f})")

    is_quick = [row["finished_at"] < 250 for row in rows if row["finished_at"]]
    cells.append(f"{100 * np.mean(is_quick):.0f} %")
    is_clean = [row["delivered"] == 72 for row in rows if not row["use_hop_count"]]
    cells.append(f"{sum(is_clean)} of {len(is_clean)}")
    return cells


def page_table(head):
    """Return the cells of the page's table that begins so, by rows, without its head."""
    page = PAGE.read_text()
    table = page[page.index(head) :].split("\n\n")[0]
    rows = []
    for line in table.splitlines()[2:]:
        rows.append([cell.strip() for cell in line.split("|")[1:-1]])
    return rows


@pytest.mark.parametrize(
    ("results", "column"), [("default", 2), ("cells", 3), ("stops", 4), ("selected", 5)]
)
def test_the_page_s_table_of_evolutions(results, column):
    cells = [row[column] for row in page_table("| | the paper | default")]
    assert cells == evolution_cells(f"results/{results}/evolve-paper")


def test_the_page_s_table_of_stops():
    directories = [
        "results/cells/evolve-paper",
        "results/stops/share-25",
        "results/stops/evolve-paper",
        "results/stops/share-50",
    ]
    cells = [row[1:] for row in page_table("| stops, with `cells`")]
    assert cells == [evolution_cells(directory)[:3] for directory in directories]
