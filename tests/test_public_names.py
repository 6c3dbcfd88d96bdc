"""The public names: pages, examples and notebooks do with them, and docs/api.md lists them and
nothing else."""

import ast
import importlib
import json
import re
import textwrap
from importlib.util import find_spec
from pathlib import Path

import pytest

from iswarm_mj.engines.registry import ENGINE_PLUGINS as ENGINES
from iswarm_mj.strategy.library import STRATEGIES, TASKS

ROOT = Path(__file__).parents[1]
PACKAGES = ("iswarm_mj", "iswarm_mj.envs", "iswarm_mj.gripper")
"""Packages with public names, which their stubs list."""
ENGINE = ROOT / "tests/data/teleport.py"
"""The engine that docs/architecture.md gives as an example."""


def public_names(package):
    """Return the module that defines each public name of a package, without the packages among
    them."""
    stub = Path(importlib.import_module(package).__file__).with_suffix(".pyi")
    imports = [
        node
        for node in ast.parse(stub.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom)
    ]
    return {
        alias.name: f"{package}.{node.module}"
        for node in imports
        if node.module
        for alias in node.names
    }


NAMES = {package: public_names(package) for package in PACKAGES}
ALL = [(package, name, module) for package in PACKAGES for name, module in NAMES[package].items()]


def programs_of_page(path):
    """Return the Python of a page: its blocks, and what its commands pass to `python -c`."""
    programs = []
    for _, language, block in re.findall(
        r"^( *)```(python|bash|sh)\b[^\n]*\n(.*?)^\1```",
        path.read_text(encoding="utf-8"),
        re.DOTALL | re.MULTILINE,
    ):
        block = textwrap.dedent(block)
        programs += (
            [block] if language == "python" else re.findall(r'python -c "(.*?)"', block, re.DOTALL)
        )
    return programs


def programs_of_notebook(path):
    """Return the cells of a notebook with code, without its commands."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    return [
        "\n".join(line for line in source.splitlines() if line[:1] not in ("%", "!"))
        for source in sources
    ]


def programs_of(path):
    """Return the Python in a file for users."""
    if path.suffix == ".md":
        return programs_of_page(path)
    return (
        programs_of_notebook(path)
        if path.suffix == ".ipynb"
        else [path.read_text(encoding="utf-8")]
    )


def private_uses(program):
    """Return what a program imports of the package, or uses as its attribute, that is not
    public."""
    nodes = list(ast.walk(ast.parse(program)))
    used, names_of_root = [], set()
    for node in nodes:
        if isinstance(node, ast.Import):
            modules = [alias for alias in node.names if alias.name.split(".")[0] == "iswarm_mj"]
            used += [alias.name for alias in modules if alias.name not in PACKAGES]
            names_of_root |= {alias.asname or "iswarm_mj" for alias in modules}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "iswarm_mj":
            offered = NAMES.get(node.module, {})
            used += [
                f"{node.module}.{alias.name}" for alias in node.names if alias.name not in offered
            ]

    offered = {*NAMES["iswarm_mj"], "envs", "gripper", "__version__"}
    for node in nodes:
        is_attribute = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        if is_attribute and node.value.id in names_of_root and node.attr not in offered:
            used.append(f"iswarm_mj.{node.attr}")
    return used


FILES = sorted(
    [
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "examples").glob("*.py"),
        *(ROOT / "notebooks").glob("*.ipynb"),
        ROOT / "README.md",
        ENGINE,
    ]
)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_users_need_no_private_name(path):
    assert [used for program in programs_of(path) for used in private_uses(program)] == []


def test_private_names_are_found():
    """Each way of importing them is tried."""
    assert private_uses("from iswarm_mj.config.swarm import SwarmConfig") == [
        "iswarm_mj.config.swarm.SwarmConfig"
    ]
    assert private_uses("from iswarm_mj import SwarmConfig, config") == ["iswarm_mj.config"]
    assert private_uses("import iswarm_mj.gripper.plugin") == ["iswarm_mj.gripper.plugin"]
    assert private_uses("import iswarm_mj as im\nim.load('runs')\nim.output.load('runs')") == [
        "iswarm_mj.output"
    ]
    assert programs_of_page(ROOT / "docs/gripper.md")[-1].startswith(
        "from iswarm_mj.gripper import"
    )


def documentation_of(module, name):
    """Return the docstring of what a module defines; None where it defines no such name, or says
    nothing of it."""
    body = ast.parse(Path(find_spec(module).origin).read_text(encoding="utf-8")).body
    for node, following in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name == name:
            return ast.get_docstring(node)
        targets = node.targets if isinstance(node, ast.Assign) else []
        if name in {target.id for target in targets if isinstance(target, ast.Name)}:
            is_text = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            return following.value.value if is_text else None
    return None


@pytest.mark.parametrize(("package", "name", "module"), ALL, ids=lambda value: value)
def test_a_public_name_is_there_and_documented(package, name, module):
    assert getattr(importlib.import_module(package), name) is getattr(
        importlib.import_module(module), name
    )
    assert documentation_of(module, name)


def test_the_reference_lists_the_public_names_and_nothing_else():
    listed = re.findall(
        r"^::: (\S+)$", (ROOT / "docs/api.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert sorted(listed) == sorted(f"{package}.{name}" for package, name, _ in ALL)


@pytest.mark.parametrize("offer", [STRATEGIES, TASKS, ENGINES], ids=lambda offer: offer.word)
def test_errors_about_classes_of_users_refer_to_public_names(offer):
    package, _, name = offer.base.rpartition(".")
    assert name in NAMES[package]
