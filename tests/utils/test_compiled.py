"""Functions compiled by numba where nothing can be kept: a package that is read-only, and no
home."""

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from numba.core import config

import iswarm_mj
from iswarm_mj.utils.compiled import cached, version

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
    copy = shutil.copytree(
        package, tmp_path / package.name, ignore=shutil.ignore_patterns("__pycache__")
    )
    for folder in [copy, *(path for path in copy.rglob("*") if path.is_dir())]:
        (folder / "__pycache__").touch()  # a file, so that even root cannot write there
    shutil.copytree(package.parent / "models", tmp_path / "models")
    env = {
        name: value
        for name, value in os.environ.items()
        if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    }
    env |= {"HOME": "/dev/null/none", "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, env=env, cwd=tmp_path
    )
    assert done.stdout == f"{copy / '__init__.py'} [1, 0] [5.0, 5.0]\n", done.stderr


def test_threads_leave_the_directory_of_numba_as_it_was(tmp_path, monkeypatch):
    """The second thread begins before the first one ends, and ends after it, if nothing holds it
    back."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    second_began, first_ended = threading.Event(), threading.Event()

    def compile_first(**_):
        second.start()
        second_began.wait(1)
        return lambda function: function

    def compile_second(**_):
        second_began.set()
        first_ended.wait(60)
        return lambda function: function

    second = threading.Thread(
        target=cached, args=[len], kwargs={"sources": tmp_path, "compiler": compile_second}
    )
    cached(len, sources=tmp_path, compiler=compile_first)
    first_ended.set()
    second.join()
    assert str(tmp_path) == config.CACHE_DIR


def test_versions_of_sources_tell_their_files_apart(tmp_path):
    """Also where all of them together have the same content."""
    for folder, files in (
        ("one", {"a.py": "1\n2\n", "b.py": ""}),
        ("other", {"a.py": "1\n", "b.py": "2\n"}),
    ):
        (tmp_path / folder).mkdir()
        for name, content in files.items():
            (tmp_path / folder / name).write_text(content)
    assert version(tmp_path / "one") != version(tmp_path / "other")
