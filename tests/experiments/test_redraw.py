"""Figures drawn anew from stored tables; runs that did not end are shown as such, with n and test in the caption."""

import shutil
from pathlib import Path

import pytest

from iswarm_mj.commands.main import main
from iswarm_mj.experiments.analysis.plots import sizes, unfinished
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
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


def test_bands_are_explained(tmp_path, figures):
    rows, _ = read_table(ROOT / "results-initial/robustness/robustness.parquet")
    EXPERIMENTS["robustness"].draw(rows, tmp_path)
    text = figures[0][0].get_supxlabel()
    assert "bands: from the first to the third quartile" in text and "n = 12 each" in text


def test_words_on_samples():
    ended, late = {"finished_at": 3, "max_steps": 9}, {"finished_at": None, "max_steps": 9}
    assert (
        unfinished([ended]) == "" and "1 run that" in unfinished([ended, late]) and "limit of 9" in unfinished([late])
    )
    assert (sizes([[ended], [late]]), sizes([[ended], [late, late]])) == ("n = 1 each.", "n = 1 to 2.")
