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

PROGRAM = """
import numpy as np
import iswarm_mj
from iswarm_mj.sensors.neighbours import find_neighbours
import iswarm_mj.engines.planar.physics, iswarm_mj.engines.planar.sight, iswarm_mj.gripper.plugin
pairs = find_neighbours(np.array([[[0.0, 0.0], [3.0, 4.0], [90.0, 0.0]]]), 6.0)
print(iswarm_mj.__file__, pairs.other.tolist(), pairs.distance.tolist())
"""


@pytest.mark.slow
def test_they_are_compiled_all_the_same(tmp_path):
    package = Path(iswarm_mj.__file__).parent
    without_caches = shutil.ignore_patterns("__pycache__")
    copy = shutil.copytree(package, tmp_path / package.name, ignore=without_caches)
    shutil.copytree(package.parent / "models", tmp_path / "models")
    for folder in [copy, *(path for path in copy.rglob("*") if path.is_dir())]:
        # A file in the place of the folder, so that even root cannot write there.
        (folder / "__pycache__").touch()

    unset = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    environment["HOME"] = "/dev/null/none"
    environment["PYTHONPATH"] = str(tmp_path)
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    process = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert process.stdout == f"{copy / '__init__.py'} [1, 0] [5.0, 5.0]\n", process.stderr


def test_threads_leave_the_directory_of_numba_as_it_was(tmp_path, monkeypatch):
    """The second thread begins before the first one ends, and ends after it, unless something holds
    it back."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    second_began = threading.Event()
    first_ended = threading.Event()

    def compile_first(**_):
        second.start()
        second_began.wait(1)
        return lambda function: function

    def compile_second(**_):
        second_began.set()
        first_ended.wait(2)  # the first thread may need the lock once more before it ends
        return lambda function: function

    options = {"sources": tmp_path, "compiler": compile_second}
    second = threading.Thread(target=cached, args=[len], kwargs=options)
    cached(len, sources=tmp_path, compiler=compile_first)
    first_ended.set()
    second.join()
    assert str(tmp_path) == config.CACHE_DIR


def test_versions_of_sources_tell_their_files_apart(tmp_path):
    """Also where all of them together have the same content."""

    def version_of(folder, **contents):
        (tmp_path / folder).mkdir()
        for name, content in contents.items():
            (tmp_path / folder / f"{name}.py").write_text(content)
        return version(tmp_path / folder)

    assert version_of("one", a="1\n2\n", b="") != version_of("other", a="1\n", b="2\n")
