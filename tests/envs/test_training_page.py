"""The scripts of docs/training.md run as they stand there, and what they train comes nearer to the
lamp."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[2] / "docs" / "training.md"
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The page's files."""
    folder = tmp_path_factory.mktemp("training")
    for name, text in re.findall(r"```python\n# (\w+\.py)\n(.*?)```", PAGE.read_text(), re.DOTALL):
        (folder / name).write_text(text)
    return folder


def ran(folder, *words):
    """Numbers in what a script prints."""
    path = os.pathsep.join([str(PAGE.parents[1]), os.environ.get("PYTHONPATH", "")])
    how = {"cwd": folder, "env": os.environ | {"PYTHONPATH": path}, "timeout": 900}
    done = subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, check=False, **how
    )
    assert done.returncode == 0, done.stderr
    return [float(number) for number in re.findall(r"(-?\d+) mm", done.stdout)]


def test_jax_learns_and_the_policy_runs(folder):
    distances = ran(folder, "learn.py")
    assert len(distances) == 30 and distances[0] > 40 and max(distances[-5:]) < 15
    flags = [
        "--task=lamp.py:Lamp",
        "--strategy=learned.py:policy",
        "--robots=20",
        "--steps=60",
        "--engine=planar",
    ]
    ran(folder, "-m", "iswarm_mj", "run", *flags)
    with np.load(folder / "runs/task/trajectory.npz") as file:
        assert file["metric_distance"][0] > 40 and file["metric_distance"][-1] < 15


@pytest.mark.parametrize(
    ("script", "packages"),
    [("ppo.py", ["stable_baselines3", "supersuit"]), ("multi_agent.py", ["torchrl"])],
)
def test_learners_of_others(folder, script, packages):
    if not all(map(importlib.util.find_spec, packages)):
        pytest.skip(f"needs {' and '.join(packages)}")
    *_, last = ran(folder, script)
    if script == "ppo.py":
        assert last < 15
    else:
        assert last > 35
