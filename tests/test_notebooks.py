"""The notebooks run from top to bottom, and their results are those that their texts describe."""

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
    """Check that a run delivers balls, and that its files agree."""
    assert names["run"].is_over
    measures = names["measures"]
    assert 0 < measures.delivered == names["delivered"][-1]
    assert names["saved"].result["picked"] == measures.picked
    assert names["count"].max() > 0
    assert Path("runs/first/clean.rrd").stat().st_size > 0


def batched_rollouts(names):
    """Check that the paper's strategy beats a walk straight on, in all worlds together."""
    papers, walk = names["found"].values()
    assert papers.delivered.shape == walk.delivered.shape == (3,)
    assert papers.delivered.sum() > walk.delivered.sum() > 0
    assert (papers.delivered_after[:, -1] == papers.delivered).all()
    assert len(set(names["swept"].collisions)) > 1
    assert names["figure"].axes


def own_strategy(names):
    """Check that the paper's strategy beats the user's, whose recording is there."""
    assert names["papers"].delivered.sum() > names["walk"].delivered.sum()
    assert Path("walk.rrd").stat().st_size > 0


def gripper(names):
    """Check that a ball is lifted and released, and that humidity raises the voltage."""
    gap = names["trace"].gap_plate
    assert gap.max() > 4e-6
    assert gap[-1] < 1e-6
    pull_off = names["pull_off"]
    assert 0 < pull_off[0] < pull_off[10] < pull_off[20]

    grasps = [row for row in names["rows"] if row.experiment == "grasp"]
    voltage = {row.relative_humidity: row.voltage for row in grasps}
    assert 20 < voltage[10.0] < voltage[50.0] < 40


def evolution(names):
    """Check that the last generation is fitter than the first."""
    fitness = names["fitness"]
    generation = names["generation"]
    assert len(fitness) == 48
    assert names["best"].fitness <= fitness.max()
    last = fitness[generation == generation.max()]
    first = fitness[generation == 0]
    assert last.mean() > first.mean()


def recordings(names):
    """Check that recordings have what the tables of the trajectories have."""
    saved = iswarm_mj.load(names["out"])
    is_first_world = pc.field("world") == 0

    links = saved.links.filter(is_first_world)
    senders = names["links"]["sender"].to_pylist()
    assert sum(map(len, senders)) == links.num_rows == len(names["heard"])
    assert names["heard"].sum() == pc.sum(links["is_heard"]).as_py()

    assert names["robots"].num_rows == 301
    knows_dust = pc.field("dust_hop").is_valid()
    with_vector = saved.robots.filter(is_first_world & knows_dust)
    assert sum(map(len, names["news"])) == with_vector.num_rows > 0

    delivered = [row["delivered"] for row in names["runs"].to_pylist()]
    assert delivered == saved.result["delivered"]
    assert names["lane"].num_rows > 1


def calibrate(names):
    """Check that grasps determine only the difference of the works, and a release the rest."""
    works = names["works"]
    assert works["plate - tool"].is_determined
    assert not works["tool"].is_determined
    assert not works["plate"].is_determined

    proposal = names["proposal"]
    assert proposal.prediction.kind == "release"
    width_before = proposal.before.high - proposal.before.low
    width_after = proposal.after.high - proposal.after.low
    assert 0 < width_after < width_before / 4

    # The release that was measured then narrows the work as proposed.
    measured = names["more"].estimates["work_tool_object"].interval
    assert measured.high - measured.low < width_before / 4
    assert names["figure"].axes


SHOWN = {
    "00_first_run": first_run,
    "01_batched_rollouts": batched_rollouts,
    "02_own_strategy": own_strategy,
    "03_gripper": gripper,
    "04_evolution": evolution,
    "05_recordings": recordings,
    "calibrate": calibrate,
}
"""Function that checks the names which each notebook defines."""
FAST = ("00_first_run", "calibrate")


def code_cells(path):
    """Return the source of each code cell by its name in tracebacks."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    sources = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            sources[f"{path.name}:{cell['id']}"] = "".join(cell["source"])
    return sources


def notebook(path):
    """Return the parameter of a test of a notebook."""
    marks = [] if path.stem in FAST else pytest.mark.slow
    return pytest.param(path, id=path.stem, marks=marks)


@pytest.mark.parametrize("path", [notebook(path) for path in NOTEBOOKS])
def test_notebook_runs(path, tmp_path, monkeypatch):
    import matplotlib

    matplotlib.use("Agg")
    folder = tmp_path / "notebooks"
    folder.mkdir()
    monkeypatch.chdir(folder)
    if "IPython" in path.read_text(encoding="utf-8"):
        pytest.importorskip("IPython", reason="it shows a picture in Jupyter")
    names: dict = {"__name__": "__main__"}
    for name, source in code_cells(path).items():
        exec(compile(source, name, "exec"), names)
    SHOWN[path.stem](names)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_import_only_what_exists(path):
    lines = "\n".join(code_cells(path).values()).splitlines()
    code = "\n".join(line for line in lines if not line.startswith(("%", "!")))
    statements = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.ImportFrom)]
    of_package = [node for node in statements if node.module.startswith("iswarm_mj")]
    assert of_package
    for node in of_package:
        module = importlib.import_module(node.module)
        for alias in node.names:
            exists = hasattr(module, alias.name) or importlib.util.find_spec(
                f"{node.module}.{alias.name}"
            )
            assert exists, alias.name
