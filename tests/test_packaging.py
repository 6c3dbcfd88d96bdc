"""What ships: the archives that the build makes, and what the project's files say of each other."""

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

import iswarm_mj

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
REQUIRED = {r.name: r for r in map(Requirement, PROJECT["dependencies"])}
_EXTRAS = PROJECT["optional-dependencies"]
EXTRA = {r.name: r for r in map(Requirement, (*_EXTRAS["dev"], *_EXTRAS["docs"]))}

MODELS = [
    p.relative_to(ROOT).as_posix()
    for p in (ROOT / "models").rglob("*")
    if p.suffix in (".xml", ".obj")
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
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(out)]
    run = subprocess.run(command, cwd=source, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    (archive,) = out.glob("*.whl" if target == "wheel" else "*.tar.gz")
    return archive


@pytest.fixture(scope="module")
def sdist(tmp_path_factory):
    """Unpacked source archive."""
    folder = tmp_path_factory.mktemp("sdist")
    with tarfile.open(build(ROOT, folder, "sdist")) as archive:
        archive.extractall(
            folder, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {})
        )  # since 3.11.4
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
    data = [
        "__init__.pyi",
        "envs/__init__.pyi",
        "gripper/__init__.pyi",
        "gripper/laws/probe_table.csv",
        "py.typed",
        "paper/report/topics.csv",
        "paper/report/templates/report.html",
    ]
    assert {
        "models/arena.xml",
        "models/robot.xml",
        "models/ball.xml",
        "models/meshes/leg.obj",
    } <= set(MODELS)
    for name in (*MODELS, *(f"iswarm_mj/{name}" for name in data)):
        original = (ROOT / name).read_bytes()
        assert (sdist / name).read_bytes() == original
        inside = name if name.startswith("iswarm_mj/") else f"iswarm_mj/{name}"
        assert (wheel / inside).read_bytes() == original
    for name in ("README.md", "LICENSE", "CITATION.cff", "CHANGELOG.md"):
        assert (sdist / name).is_file(), name


@pytest.mark.slow
def test_the_wheel_holds_all_modules_and_nothing_else(wheel):
    modules = {p.relative_to(ROOT).as_posix() for p in (ROOT / "iswarm_mj").rglob("*.py")}
    assert {p.relative_to(wheel).as_posix() for p in wheel.rglob("*.py")} == modules
    assert {p.name for p in wheel.iterdir()} == {
        "iswarm_mj",
        f"iswarm_mj-{PROJECT['version']}.dist-info",
    }


@pytest.mark.slow
def test_the_wheel_finds_its_models_far_from_the_checkout(wheel, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(wheel)}
    run = subprocess.run(
        [sys.executable, "-c", FROM_ELSEWHERE],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    place, n_robots, factor = run.stdout.split()
    assert Path(place).is_relative_to(wheel)
    assert int(n_robots) == 2
    assert float(factor) == pytest.approx(1, abs=0.02)


def test_versions_agree():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = re.findall(r'^version: "?([^"\s]+)"?$', citation, re.MULTILINE)
    assert [iswarm_mj.__version__, *cited] == [PROJECT["version"]] * 2


def test_the_lock_satisfies_the_requirements():
    lock = (ROOT / ".ci/requirements.lock").read_text(encoding="utf-8")
    locked = re.findall(r"^([a-z0-9][a-z0-9.-]*)==([^\s;]+)", lock, re.MULTILINE)
    names = {name for name, _ in locked}
    for requirement in (*REQUIRED.values(), *EXTRA.values()):
        assert requirement.name in names, (
            f"{requirement} is not in the lock file: remake it, see CONTRIBUTING.md"
        )
    for name, number in locked:
        wanted = REQUIRED.get(name, EXTRA.get(name))
        assert wanted is None or wanted.specifier.contains(number), (
            f"{name} {number} is locked, {wanted} is required"
        )
    assert not re.search(r"^--|://| @ |file:", lock, re.MULTILINE), (
        "the lock names a place to download from"
    )
