"""Files for releases: workflows, images, recipe and notebooks agree with pyproject.toml."""

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml
from make_tables import table_of_notebooks
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PYTHONS = [
    text.rpartition(" ")[2]
    for text in PROJECT["classifiers"]
    if text.startswith("Programming Language :: Python :: 3.")
]


def read_yaml(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def test_the_suite_runs_on_all_pythons_and_systems():
    matrix = read_yaml(".github/workflows/ci.yml")["jobs"]["suite"]["strategy"]["matrix"]
    assert matrix["python"] == PYTHONS == ["3.11", "3.12", "3.13", "3.14"]
    assert [system.partition("-")[0] for system in matrix["system"]] == [
        "ubuntu",
        "macos",
        "windows",
    ]
    allowed = SpecifierSet(PROJECT["requires-python"])
    assert [allowed.contains(f"3.{minor}") for minor in range(10, 16)] == [
        False,
        *[True] * 4,
        False,
    ]


def test_only_the_job_that_publishes_has_a_permission_and_none_a_secret():
    release = read_yaml(".github/workflows/release.yml")
    permissions = {name: job.get("permissions") for name, job in release["jobs"].items()}
    publish = permissions.pop("publish")
    assert publish == {"id-token": "write"}
    assert set(permissions.values()) == {None}
    assert release["permissions"] == {"contents": "read"}
    assert release["jobs"]["publish"]["environment"] == "pypi"
    assert "secrets." not in (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")


def test_nothing_is_published_without_the_suite():
    jobs = read_yaml(".github/workflows/release.yml")["jobs"]
    assert jobs["publish"]["needs"] == ["ci", "use"]
    assert jobs["ci"] == {"uses": "./.github/workflows/ci.yml"}
    events = read_yaml(".github/workflows/ci.yml")[True]  # YAML reads `on` as a boolean
    assert "workflow_call" in events


def test_caches_of_pip_follow_the_requirements():
    """By default, setup-python asks for a requirements.txt, which is not here."""
    for job in read_yaml(".github/workflows/ci.yml")["jobs"].values():
        (setup,) = (step for step in job["steps"] if "setup-python" in step.get("uses", ""))
        assert setup["with"]["cache-dependency-path"] == "pyproject.toml"


def test_the_recipe_has_the_version_and_the_requirements():
    recipe = read_yaml("conda/recipe.yaml")
    assert recipe["context"]["version"] == PROJECT["version"]

    python, *lines = recipe["requirements"]["run"]
    lowest = recipe["context"]["python_min"]
    assert (
        python.replace("python ", "").replace("${{ python_min }}", lowest)
        == (PROJECT["requires-python"])
    )
    name_of_conda = {"mujoco": "mujoco-python"}
    expected = {}
    for requirement in map(Requirement, PROJECT["dependencies"]):
        expected[name_of_conda.get(requirement.name, requirement.name)] = requirement.specifier
    in_recipe = {}
    for line in lines:
        name, _, versions = line.partition(" ")
        in_recipe[name] = SpecifierSet(versions)
    assert in_recipe == expected


def test_the_recipe_has_the_address_of_the_repository():
    """Both are empty until there is one, which conda-forge takes with maintainers only."""
    address = PROJECT.get("urls", {}).get("Repository")
    recipe = read_yaml("conda/recipe.yaml")
    about = recipe["about"]
    assert [about.get("homepage"), about.get("repository")] == [address, address]
    assert bool(recipe["extra"]["recipe-maintainers"]) == bool(address)


@pytest.mark.parametrize("name", ["Dockerfile", "Dockerfile.gpu"])
def test_images_copy_files_that_exist_and_are_not_ignored(name):
    text = (ROOT / "docker" / name).read_text(encoding="utf-8")
    assert re.search(r"^FROM python:([\d.]+)-slim$", text, re.MULTILINE)[1] in PYTHONS
    sources = [
        source
        for line in re.findall(r"^COPY (.*) /source/\S*$", text, re.MULTILINE)
        for source in line.split()
    ]
    kept = re.findall(
        r"^!(.*)$", (ROOT / ".dockerignore").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert sorted(sources) == sorted(kept)
    assert [source for source in sources if not (ROOT / source).exists()] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_begin_with_the_cell_that_installs_the_package(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    codes = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    first_of_all = json.loads(NOTEBOOKS[0].read_text(encoding="utf-8"))["cells"][1]
    assert codes[0] == "".join(first_of_all["source"])
    assert "iswarm-mj[all]" in codes[0]
    assert "iswarm_mj" not in codes[0].replace('find_spec("iswarm_mj")', "")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_read_no_file_of_the_checkout(path):
    """Colab opens a notebook alone."""
    assert "../" not in path.read_text(encoding="utf-8")


def test_links_to_notebooks_follow_the_address_of_the_repository():
    assert "http" not in table_of_notebooks(None)
    linked = table_of_notebooks("https://github.com/someone/something/")
    assert "github/someone/something/blob/main/notebooks/00_first_run.ipynb)" in linked
    assert "gh/someone/something/main?labpath=notebooks/00_first_run.ipynb)" in linked
