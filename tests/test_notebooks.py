"""The notebooks run, from top to bottom."""

import json
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def first_run(names):
    assert names["run"].is_over
    assert 0 < names["measures"].delivered == names["delivered"][-1]


def batched_rollouts(names):
    papers, walk = names["found"].values()
    assert papers.delivered.shape == walk.delivered.shape == (3,)
    assert papers.delivered.sum() > walk.delivered.sum() > 0
    assert (papers.delivered_after[:, -1] == papers.delivered).all()
    assert len(set(names["swept"].collisions)) > 1
    assert names["figure"].axes


SHOWN = {"00_first_run": first_run, "01_batched_rollouts": batched_rollouts}
"""What holds at the end of each notebook."""


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path):
    import matplotlib

    matplotlib.use("Agg")
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    names: dict = {"__name__": "__main__"}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]  # committed without outputs
            exec(compile("".join(cell["source"]), f"{path.name}:{cell['id']}", "exec"), names)
    SHOWN[path.stem](names)


def test_there_are_notebooks():
    assert NOTEBOOKS
