"""The notebooks run, from top to bottom, and come to what they show."""

import ast
import importlib
import importlib.util
import json
from pathlib import Path

import pyarrow.compute as pc
import pytest

import iswarm_mj

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


def first_run(names):
    assert names["run"].is_over
    assert 0 < names["measures"].delivered == names["delivered"][-1]
    assert names["saved"].result["picked"] == names["measures"].picked and names["count"].max() > 0
    assert Path("runs/first/clean.rrd").stat().st_size > 0


def batched_rollouts(names):
    papers, walk = names["found"].values()
    assert papers.delivered.shape == walk.delivered.shape == (3,)
    assert papers.delivered.sum() > walk.delivered.sum() > 0
    assert (papers.delivered_after[:, -1] == papers.delivered).all()
    assert len(set(names["swept"].collisions)) > 1
    assert names["figure"].axes


def own_strategy(names):
    walk, papers = names["walk"], names["papers"]
    assert papers.delivered.sum() > walk.delivered.sum() and Path("walk.rrd").stat().st_size > 0


def gripper(names):
    trace, pulls = names["trace"], names["pull_off"]
    assert trace.gap_plate.max() > 4e-6 > 1e-6 > trace.gap_plate[-1]  # it was lifted, and lies again
    assert 0 < pulls[0] < pulls[10] < pulls[20]
    lifts = {row.relative_humidity: row.voltage for row in names["rows"] if row.experiment == "grasp"}
    assert 20 < lifts[10.0] < lifts[50.0] < 40


def evolution(names):
    fitness, generation = names["fitness"], names["generation"]
    assert len(fitness) == 48 and names["best"].fitness <= fitness.max()
    assert fitness[generation == generation.max()].mean() > fitness[generation == 0].mean()


def recordings(names):
    """The same as the trajectories say."""
    saved, robots, links = iswarm_mj.load(names["out"]), names["robots"], names["links"]
    of_first = saved.links.filter(pc.field("world") == 0)
    assert sum(map(len, links["sender"].to_pylist())) == of_first.num_rows == len(names["heard"])
    assert names["heard"].sum() == pc.sum(of_first["is_heard"]).as_py()
    known = saved.robots.filter((pc.field("world") == 0) & pc.field("dust_hop").is_valid())
    assert sum(map(len, names["news"])) == known.num_rows > 0 and robots.num_rows == 301
    assert [row["delivered"] for row in names["runs"].to_pylist()] == saved.result["delivered"]
    assert names["lane"].num_rows > 1


SHOWN = {
    "00_first_run": first_run,
    "01_batched_rollouts": batched_rollouts,
    "02_own_strategy": own_strategy,
    "03_gripper": gripper,
    "04_evolution": evolution,
    "05_recordings": recordings,
}
"""What holds at the end of each notebook."""
FAST = ("00_first_run",)


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))["cells"]


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, id=p.stem, marks=[] if p.stem in FAST else pytest.mark.slow) for p in NOTEBOOKS],
)
def test_notebook_runs(path, tmp_path, monkeypatch):
    import matplotlib

    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    if "IPython" in path.read_text(encoding="utf-8"):
        pytest.importorskip("IPython", reason="it shows a picture in Jupyter")
    names: dict = {"__name__": "__main__"}
    for cell in read(path):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{path.name}:{cell['id']}", "exec"), names)
    SHOWN[path.stem](names)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_notebooks_import_is_there(path):
    cells = (cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code")
    code = "\n".join(line for cell in cells for line in "".join(cell["source"]).splitlines() if line[:1] not in "%!")
    imports = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.ImportFrom)]
    own = [(node.module, name.name) for node in imports for name in node.names if node.module.startswith("iswarm_mj")]
    for module, name in own:
        assert hasattr(importlib.import_module(module), name) or importlib.util.find_spec(f"{module}.{name}")
    assert own
