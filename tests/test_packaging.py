"""Packaging: the contents of the archives, and the versions that the project's files state."""

import importlib.metadata
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

import iswarm_mj
from iswarm_mj.gripper.native.abi import KNOWN_RELEASES

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OPTIONAL = PROJECT["optional-dependencies"]


def with_extras(lines):
    """Yield requirements, in place of the project's own extras those of the extras."""
    for requirement in map(Requirement, lines):
        if requirement.name == PROJECT["name"]:
            for extra in requirement.extras:
                yield from with_extras(OPTIONAL[extra])
        else:
            yield requirement


REQUIREMENTS = [
    *with_extras(PROJECT["dependencies"]),
    *with_extras(OPTIONAL["dev"]),
    *with_extras(OPTIONAL["docs"]),
]

MODELS = [
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "models").rglob("*")
    if path.suffix in (".xml", ".obj")
]

FROM_ELSEWHERE = """
import numpy as np
import iswarm_mj
from iswarm_mj import SwarmConfig
from iswarm_mj.gripper import probe_factor
from iswarm_mj.engines.arena import compile_arena
print(iswarm_mj.__file__)
print(len(compile_arena(SwarmConfig(), 2, np.array([20e-6]), visual=True).hull))
print(float(probe_factor("pick", 1 / 512, 8.0)))
"""


def build(source, out, target):
    """Build an archive, "sdist" or "wheel", and return its path."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(out)]
    run = subprocess.run(command, cwd=source, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    (archive,) = out.glob("*.whl" if target == "wheel" else "*.tar.gz")
    return archive


@pytest.fixture(scope="module")
def sdist(tmp_path_factory):
    """Unpacked source archive."""
    folder = tmp_path_factory.mktemp("sdist")
    has_filter = hasattr(tarfile, "data_filter")  # from Python 3.11.4 on
    options = {"filter": "data"} if has_filter else {}
    with tarfile.open(build(ROOT, folder, "sdist")) as archive:
        archive.extractall(folder, **options)
    return folder / f"iswarm_mj-{PROJECT['version']}"


@pytest.fixture(scope="module")
def wheel(sdist, tmp_path_factory):
    """Unpacked wheel, made of the source archive as an installer would."""
    folder = tmp_path_factory.mktemp("wheel")
    with zipfile.ZipFile(build(sdist, folder, "wheel")) as archive:
        archive.extractall(folder / "installed")
    return folder / "installed"


@pytest.mark.slow
def test_both_archives_hold_the_data_unchanged(sdist, wheel):
    """The wheel has the models within the package."""
    meshes = ["models/meshes/leg.obj"]
    assert {"models/arena.xml", "models/robot.xml", "models/ball.xml", *meshes} <= set(MODELS)
    for name in MODELS:
        original = (ROOT / name).read_bytes()
        assert (sdist / name).read_bytes() == original
        assert (wheel / "iswarm_mj" / name).read_bytes() == original

    for name in (
        "__init__.pyi",
        "envs/__init__.pyi",
        "gripper/__init__.pyi",
        "gripper/laws/probe_table.csv",
        "py.typed",
        "paper/report/topics.csv",
        "paper/report/templates/report.html",
    ):
        original = (ROOT / "iswarm_mj" / name).read_bytes()
        assert (sdist / "iswarm_mj" / name).read_bytes() == original
        assert (wheel / "iswarm_mj" / name).read_bytes() == original

    for name in ("README.md", "LICENSE", "CITATION.cff", "CHANGELOG.md"):
        assert (sdist / name).is_file(), name


@pytest.mark.slow
def test_the_wheel_holds_all_modules_and_nothing_else(wheel):
    modules = {path.relative_to(ROOT) for path in (ROOT / "iswarm_mj").rglob("*.py")}
    assert {path.relative_to(wheel) for path in wheel.rglob("*.py")} == modules
    metadata = f"iswarm_mj-{PROJECT['version']}.dist-info"
    assert {path.name for path in wheel.iterdir()} == {"iswarm_mj", metadata}


@pytest.mark.slow
def test_the_wheel_finds_its_models_far_from_the_checkout(wheel, tmp_path):
    process = subprocess.run(
        [sys.executable, "-c", FROM_ELSEWHERE],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(wheel)},
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stderr

    place, n_robots, factor = process.stdout.split()
    assert Path(place).is_relative_to(wheel)
    assert int(n_robots) == 2
    assert float(factor) == pytest.approx(1, abs=0.02)


def test_versions_agree():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = re.findall(r'^version: "?([^"\s]+)"?$', citation, re.MULTILINE)
    assert [iswarm_mj.__version__, *cited] == [PROJECT["version"]] * 2


def test_mujoco_and_mjx_are_of_one_known_release():
    """It fails once an MJX for MuJoCo 4 is installed, which is then there to try."""
    mjx = importlib.metadata.version("mujoco-mjx")
    assert Version(mjx).major < 4, f"mujoco-mjx {mjx} exists: try it, and move both requirements"
    assert mjx == importlib.metadata.version("mujoco")
    assert mjx in KNOWN_RELEASES


def test_mujoco_can_call_the_entry_point_of_its_plugins():
    (plugins,) = PROJECT["entry-points"]["mujoco.plugins"].items()
    register = importlib.metadata.EntryPoint(*plugins, group="mujoco.plugins").load()
    assert sorted(register()) == ["iswarm.adhesion", "iswarm.electrostatic"]


def test_the_lock_satisfies_the_requirements():
    lock = (ROOT / ".ci/requirements.lock").read_text(encoding="utf-8")
    locked = re.findall(r"^([a-z0-9][a-z0-9.-]*)==([^\s;]+)", lock, re.MULTILINE)
    versions = {}
    for name, version in locked:
        versions.setdefault(name, []).append(version)

    for requirement in REQUIREMENTS:
        remedy = f"{requirement} is not in the lock file: remake it, see CONTRIBUTING.md"
        assert requirement.name in versions, remedy
        for version in versions[requirement.name]:
            assert requirement.specifier.contains(version), f"{version} is not {requirement}"

    place = re.search(r"^--|://| @ |file:", lock, re.MULTILINE)
    assert place is None, "the lock names a place to download from"
