"""What the page on readings says is what the tables of the results say."""

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
from iswarm_mj.utils.tables import read_table

ROOT = Path(__file__).parents[2]


def test_the_selected_reading_is_that_of_the_rule_and_the_page_says_what_is_supported():
    """Which readings pass the correction; what of the two halves the best combinations and `paper`
    reproduce."""
    rows, _ = read_table(ROOT / "results/default/infer/infer.parquet")
    every = combinations_of(rows)
    found, (_, kept), (paper, _) = (
        support_of_factors(every),
        accept_best(every),
        [c for c in every if c.is_named],
    )
    settings = {}
    for name, levels in FACTORS.items():
        assert found[name].counts.keys() == found[name].shares.keys() == levels.keys()
        settings |= dict(levels[found[name].replacement or DEFAULT_LABELS[name]])
    assert varied(SwarmConfig(), settings) == INTERPRETATIONS["selected"]
    assert {name for name, one in found.items() if one.adjusted_p < 0.05} == {"turns"}
    assert all(share.low < 1 / 3 < share.high for share in found["dust_offset"].shares.values())
    times = [*reproduced_statements([row for row in rows if row["combination"] == 0])[1]].index(
        "Type 1 takes 310 steps"
    )
    assert not any(c.held_out[place] for c in kept for place in (times, times + 1))
    assert all(paper.held_out) and sum(paper.answers) < sum(kept[-1].answers)


def told(part):
    """What the page says of an evolution: density, points and time of the fittest, quick swarms,
    those without hops."""
    rows = read_table(ROOT / part / "evolution.parquet")[0]
    last, fittest = max(row["generation"] for row in rows) - 7, {}
    for row in rows:
        for key in ((row["replicate"], row["generation"]), row["replicate"]):
            if row["fitness"] > fittest.get(key, row | {"fitness": -1.0})["fitness"]:
                fittest[key] = row
    late = [
        row["density_of_robots"]
        for key, row in fittest.items()
        if isinstance(key, tuple) and key[1] >= last
    ]
    runs = [row for key, row in fittest.items() if isinstance(key, int)]
    clean = [row for row in rows if row["finished_at"]]
    without = [row for row in rows if not row["use_hop_count"]]
    return [
        "{1:.3f} ({0:.3f} to {2:.3f})".format(*np.quantile(late, [0.25, 0.5, 0.75])),
        *(
            f"{np.median(values):.0f} ({min(values):.0f} to {max(values):.0f})"
            for values in ([row[name] for row in runs] for name in ("fitness", "finished_at"))
        ),
        f"{100 * np.mean([row['finished_at'] < 250 for row in clean]):.0f} %",
        f"{sum(row['delivered'] == 72 for row in without)} of {len(without)}",
    ]


def table(head):
    """Cells of the page's table that begins so, without its head, by rows."""
    page = (ROOT / "docs" / "readings.md").read_text()
    lines = page[page.index(head) :].split("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


@pytest.mark.parametrize(
    ("results", "column"),
    [("results/default", 2), ("results/cells", 3), ("results/stops", 4), ("results/selected", 5)],
)
def test_the_page_s_table_of_evolutions(results, column):
    assert [row[column] for row in table("| | the paper | default")] == told(
        f"{results}/evolve-paper"
    )


def test_the_page_s_table_of_stops():
    parts = [
        "results/cells/evolve-paper",
        *(f"results/stops/{p}" for p in ("share-25", "evolve-paper", "share-50")),
    ]
    assert [row[1:] for row in table("| stops, with `cells`")] == [told(part)[:3] for part in parts]
