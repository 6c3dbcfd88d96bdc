"""The MuJoCo library that the Python bindings use, wherever it is installed."""

import sys
from pathlib import Path

import mujoco
import pytest

from iswarm_mj.engines.mujoco_library import library
from iswarm_mj.utils.errors import UserError

find_library = library.__wrapped__
"""`library` without its cache."""


@pytest.fixture
def of_conda(tmp_path, monkeypatch):
    """Let the bindings lie in a package without the library, in an environment of conda.

    Returns:
        The library, and the environment's folder of libraries.
    """
    path = Path(find_library()._name)
    package = tmp_path / "lib" / "python3" / "site-packages" / "mujoco"
    monkeypatch.setattr(mujoco, "__file__", str(package / "__init__.py"))
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    folder = tmp_path / "lib"
    folder.mkdir()
    return path, folder


def test_the_library_of_a_wheel_lies_in_the_package():
    assert Path(find_library()._name).parent == Path(mujoco.__file__).parent


def test_the_library_of_conda_lies_in_the_environment(of_conda):
    path, folder = of_conda
    (folder / path.name).symlink_to(path)
    assert Path(find_library()._name).parent == folder


@pytest.mark.usefixtures("of_conda")
def test_a_library_that_is_nowhere_is_an_error_with_a_remedy():
    with pytest.raises(UserError, match=r"No MuJoCo library in .*; reinstall the package mujoco"):
        find_library()
