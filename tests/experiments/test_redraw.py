"""Figures drawn anew from stored tables; runs that did not end are shown as such, with n and test in the caption."""

import re
import shutil
from pathlib import Path

import pytest
from helpers_findings import replicated, settings_of

from iswarm_mj.commands.main import main
from iswarm_mj.experiments.analysis.plots_of_searches import draw_searches
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.tasks.measures import Measures, fitness
from iswarm_mj.utils.tables import read_table

ROOT = Path(__file__).parents[2]


@pytest.fixture
def figures(monkeypatch):
    """Figures by name as they are drawn, before they are written."""
    from iswarm_mj.output import plot_style

    kept, blank = [], plot_style.blank

    def keep(*args):
        kept.append(blank(*args))
        return kept[-1]

    monkeypatch.setattr(plot_style, "blank", keep)
    return kept


def test_a_directory_of_results(tmp_path, capsys):
    for name in ("hop-count/hop_count.parquet", "grasp/trials.parquet"):
        (tmp_path / name).parent.mkdir()
        shutil.copy(ROOT / "results" / name, tmp_path / name)
    main(["reproduce", "--figures", "--results", str(tmp_path)])
    drawn = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*") if path.suffix in (".png", ".svg")}
    assert drawn == {
        "hop-count/hop_count.png",
        "grasp/grasp_voltage.png",
        "grasp/grasp_voltage_humidity.png",
        "grasp/release_voltage.png",
        "grasp/no_contact.png",
    }
    assert str(tmp_path / "hop-count/hop_count.png") in capsys.readouterr().out


def test_runs_that_did_not_end_are_triangles(tmp_path, figures):
    rows, _ = read_table(ROOT / "results/hop-count/hop_count.parquet")
    EXPERIMENTS["hop-count"].draw(rows, tmp_path)
    drawing, panels = figures[0]
    late = sum(row["finished_at"] is None for row in rows)
    assert late == 12
    counts = [sum(len(line.get_xdata()) for line in axes.lines if line.get_marker() == "^") for axes in panels]
    assert counts == [late, 0, 0, 0]
    text = drawing.get_supxlabel()
    assert "12 runs that had not reached the goal at the limit of 1200 steps" in text and "n = 12 each" in text
    assert "Mann-Whitney" in text and all("p = " in axes.get_title(loc="left") for axes in panels)


def test_effects_have_a_key_and_a_marked_axis(tmp_path, figures):
    rows, _ = read_table(ROOT / "results-initial/sensitivity/sensitivity.parquet")
    EXPERIMENTS["sensitivity"].draw(rows, tmp_path)
    drawing, (axes,) = figures[0]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["slower", "faster", "interval includes zero"]
    assert "logarithmic beyond" in axes.get_xlabel() and "n = 10 runs each" in drawing.get_supxlabel()
    texts = {text.get_text() for text in axes.get_yticklabels()}
    assert {"wall_range = 3.0 rd", "max_turn = 45.0 deg", "tool_reach = 0.0001 m", "scouts_pick = True"} <= texts


def test_bands_are_explained(tmp_path, figures):
    rows, _ = read_table(ROOT / "results-initial/robustness/robustness.parquet")
    EXPERIMENTS["robustness"].draw(rows, tmp_path)
    text = figures[0][0].get_supxlabel()
    assert "bands: from the first to the third quartile" in text and "n = 12 each" in text


@pytest.mark.parametrize("replicates", [1, 3])
def test_searches_say_of_how_many_runs(tmp_path, figures, replicates):
    rows = replicated(replicates)
    draw_searches({"paper": (rows, settings_of())}, tmp_path)
    fitness, trade, *_ = (drawing.get_supxlabel() for drawing, _ in figures)
    n_generations = len({row["generation"] for row in rows})
    each = f"{n_generations} generations of {len(rows) // n_generations // replicates} runs"
    assert each in fitness and (f"n = {replicates} searches" in fitness) == (replicates > 1)
    assert "250 fittest runs of generations 35 to 100" in trade and ("One search." in trade) == (replicates == 1)


def test_the_figure_of_a_search_states_what_fitness_is(tmp_path, figures):
    draw_searches({"paper": (replicated(1), settings_of())}, tmp_path)
    told = " ".join(figures[0][0].get_supxlabel().split())
    picked, delivered, left, collision = map(float, re.findall(r"\d[\d.]*(?= (?:points )?for each)", told))
    measures = Measures(delivered=3, picked=3, collisions=40, finished_at=10, mean_carriage_steps=None)
    expected = 3 * picked + 3 * delivered + 5 * left - 40 * collision / 8
    assert fitness(measures, n_robots=8, n_dust=3, max_steps=15) == pytest.approx(expected)
    measures = measures._replace(delivered=2, finished_at=None)
    expected = 3 * picked + 2 * delivered - 40 * collision / 8
    assert fitness(measures, n_robots=8, n_dust=3, max_steps=15) == pytest.approx(expected)


def test_each_figure_of_an_experiment_has_its_number_of_runs(tmp_path, figures):
    for name in ("density", "types", "robustness", "time-step"):
        rows, _ = read_table(ROOT / f"results-initial/{name}/{name.replace('-', '_')}.parquet")
        EXPERIMENTS[name].draw(rows, tmp_path)
    texts = [drawing.get_supxlabel() for drawing, _ in figures]
    assert len(texts) == 4 and all("n = " in text and "Tests stand in the findings." in text for text in texts)
