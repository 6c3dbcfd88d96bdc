"""Functions compiled by numba where nothing can be kept: a package that is read-only, and no home."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import iswarm_mj

CODE = """
import numpy as np
import iswarm_mj
from iswarm_mj.sensors.neighbours import find_neighbours
import iswarm_mj.engines.planar.physics, iswarm_mj.engines.planar.sight, iswarm_mj.gripper.plugin
found = find_neighbours(np.array([[[0.0, 0.0], [3.0, 4.0], [90.0, 0.0]]]), 6.0)
print(iswarm_mj.__file__, found.other.tolist(), found.distance.tolist())
"""


@pytest.mark.slow
def test_they_are_compiled_all_the_same(tmp_path):
    package = Path(iswarm_mj.__file__).parent
    copy = shutil.copytree(package, tmp_path / package.name, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [copy, *(path for path in copy.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").touch()  # a file, so that even root cannot write there
    shutil.copytree(package.parent / "models", tmp_path / "models")
    env = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    env |= {"HOME": "/dev/null/none", "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, env=env, cwd=tmp_path)
    assert done.stdout == f"{copy / '__init__.py'} [1, 0] [5.0, 5.0]\n", done.stderr
