"""Packages that only some uses need: hidden, each command works or names the extra to install."""

import ast
import json
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import iswarm_mj
from iswarm_mj.commands.main import COMMANDS
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.extras import EXTRAS, naming_extras, require

PACKAGE = Path(iswarm_mj.__file__).parent
PROJECT = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OPTIONAL = PROJECT["optional-dependencies"]

HIDE = f"""
import sys
from importlib.machinery import PathFinder

HIDDEN = {sorted({module for modules in EXTRAS.values() for module in modules})}

class Hiding(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        is_hidden = name.partition(".")[0] in HIDDEN
        return None if is_hidden else super().find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = Hiding
"""
"""Let Python find no module of any extra, as where none is installed."""

RUN_COMMANDS = """
import contextlib, io, json
from iswarm_mj.commands.main import main

outcomes = []
for words in json.loads(sys.argv[1]):
    with contextlib.redirect_stderr(io.StringIO()) as error:
        try:
            main(words)
            code = 0
        except SystemExit as end:
            code = end.code
    outcomes.append((code, error.getvalue()))
print(json.dumps(outcomes))
"""

NEEDS = {
    ("play",): "play",
    ("replay",): "play",
    ("video",): "video",
    ("grasp",): "paper",
    ("grasp", "--force-curve"): "paper",
    ("fit",): "paper",
    ("tip",): "paper",
    ("report",): "paper",
    ("experiment", "hop-count"): "paper",
    ("reproduce",): "paper",
    ("sweep", "clean", "--over", "density=0.1,0.2"): "paper",
    ("compare", "type1", "type2"): "paper",
    ("evolve",): "search",
    ("train",): "search",
    ("tip", "--optimise"): "search",
}
"""Extra that is named by each command; which of its packages depends on the order of imports."""
OF_CORE = {"clean", "run", "inspect", "picture", "bench", "cache"}
"""Commands that need no extra."""


def names_of(requirements):
    return {Requirement(line).name for line in requirements}


def run_hidden(tmp_path, *commands):
    """Run commands in a process without the modules of any extra.

    Returns:
        Exit code and standard error of each.
    """
    process = subprocess.run(
        [sys.executable, "-c", HIDE + RUN_COMMANDS, json.dumps(commands)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(process.stdout.splitlines()[-1])


def test_commands_name_the_extra_that_they_need(tmp_path):
    outcomes = run_hidden(tmp_path, *NEEDS)
    for (words, extra), (code, error) in zip(NEEDS.items(), outcomes, strict=True):
        assert code == 2, words
        sentence = (
            rf'iswarm: the package \S+ is not installed; run pip install "iswarm-mj\[{extra}\]"\n'
        )
        assert re.fullmatch(sentence, error), words
    assert list(tmp_path.iterdir()) == []


def test_each_command_is_of_the_core_or_needs_an_extra():
    assert OF_CORE | {words[0] for words in NEEDS} == COMMANDS.keys()


def test_the_core_inspects_and_lists(tmp_path):
    trials = PACKAGE.parent / "results" / "default" / "grasp"
    commands = [["inspect", str(trials)], ["experiment", "--list"]]
    assert run_hidden(tmp_path, *commands) == [[0, ""], [0, ""]]


@pytest.mark.slow
def test_the_core_runs_records_and_draws(tmp_path):
    """`iswarm picture` draws where there is off-screen OpenGL, see `tests/output`."""
    run = ["clean", "--engine", "planar", "--robots", "4", "--steps", "3"]
    commands = [run, ["inspect"], ["experiment", "--help"], ["bench", "--robots", "4"]]
    codes = [code for code, _ in run_hidden(tmp_path, *commands)]
    assert codes == [0] * len(commands)
    assert (tmp_path / "runs" / "clean" / "clean.rrd").is_file()


def test_public_names_come_or_name_their_extra():
    code = HIDE + (
        "import iswarm_mj, iswarm_mj.envs\n"
        "for package in (iswarm_mj, iswarm_mj.envs):\n"
        "    for name in package.__all__:\n"
        "        try:\n"
        "            getattr(package, name)\n"
        "        except iswarm_mj.UserError as error:\n"
        "            print(name, str(error).partition('[')[2])\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    extra_of_name = dict(line.split() for line in process.stdout.splitlines())
    assert extra_of_name == {
        "Page": 'play]"',
        "play": 'play]"',
        "Training": 'search]"',
        "train": 'search]"',
        "SwarmEnv": 'marl]"',
        "SwarmParallelEnv": 'marl]"',
        "SwarmVectorEnv": 'marl]"',
        "parallel_env": 'marl]"',
        "single_env": 'marl]"',
        "vector_env": 'marl]"',
    }


def test_functions_that_draw_name_their_extra(tmp_path):
    """Before they compute, and they make no directory."""
    code = HIDE + (
        "from pathlib import Path\n"
        "import iswarm_mj as im\n"
        "out = Path('out')\n"
        "for call in (\n"
        "    lambda: im.design_tip(im.TipSettings(), out),\n"
        "    lambda: im.run_grasp(im.GraspSettings(), out),\n"
        "    lambda: im.run_force_curves(im.GraspSettings(), (0.0,), out),\n"
        "):\n"
        "    try:\n"
        "        call()\n"
        "    except im.UserError as error:\n"
        "        print(str(error).partition('[')[2])\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert process.stdout.splitlines() == ['paper]"'] * 3
    assert list(tmp_path.iterdir()) == []


def test_a_module_of_no_extra_stays_an_error_of_python():
    with pytest.raises(ModuleNotFoundError, match="no_such_module"), naming_extras():
        import no_such_module  # pyright: ignore[reportMissingImports] # noqa: F401


@pytest.mark.parametrize("extra", ["marl", "paper", "play", "search", "video"])
def test_what_is_installed_is_not_required_again(extra):
    require(extra)


def test_a_module_that_is_hidden_is_required(monkeypatch):
    monkeypatch.setitem(sys.modules, "cmaes", None)
    with pytest.raises(UserError, match="the package cmaes is not installed"):
        require("search")


@pytest.mark.parametrize("extra", EXTRAS)
def test_extras_install_the_modules_that_are_named(extra):
    """By the metadata of the installed packages; Ray is not installed for the tests."""
    packages = names_of(OPTIONAL[extra])
    if extra == "cluster":
        assert (EXTRAS[extra], packages) == (("ray",), {"ray"})
        return
    packages_of = packages_distributions()
    assert {packages_of[module][0].lower() for module in EXTRAS[extra]} == packages


def test_all_holds_the_extras_of_one_machine_with_a_cpu():
    (requirement,) = map(Requirement, OPTIONAL["all"])
    assert requirement.extras == EXTRAS.keys() - {"cluster", "warp"}


def test_the_core_requires_what_modules_import():
    """Each module that the package imports is of the core, or of an extra."""
    imported = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(node.module.partition(".")[0])

    of_extras = {module for modules in EXTRAS.values() for module in modules}
    outside = imported - sys.stdlib_module_names - of_extras - {"iswarm_mj"}
    packages_of = packages_distributions()
    packages = {name.lower() for module in outside for name in packages_of[module]}
    # With jax, numba and Gymnasium: the first two fix the releases, and the last need not be there.
    brought_along = {"jaxlib", "llvmlite", "cloudpickle"}
    assert packages - brought_along == names_of(PROJECT["dependencies"])
