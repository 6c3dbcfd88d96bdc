"""The examples run on MuJoCo and on the planar engine."""

from pathlib import Path

import pytest
from helpers_cli import code_of
from helpers_small import FLAGS

import iswarm_mj

EXAMPLES = Path(__file__).parents[1] / "examples"
ARGUMENTS = {
    "contest": ("--task", f"{EXAMPLES}/contest.py:Contest", "--strategy", "forager=0.5", "type1=0.5", *FLAGS),
}


@pytest.mark.parametrize("engine", ["mujoco", "planar"])
@pytest.mark.parametrize("name", ARGUMENTS)
def test_an_example_runs(name, engine, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    size = ["--robots=16", "--steps=40", "--seed=1"]
    assert code_of("run", *ARGUMENTS[name], *size, f"--engine={engine}") == 0
    saved = iswarm_mj.load("runs/task")
    assert saved.result["steps"] == 40
