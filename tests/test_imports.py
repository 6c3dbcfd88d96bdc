"""What importing a part of the package loads. Who may import whom: the contracts of import-linter
in pyproject.toml."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import iswarm_mj

LAWS = ["adhesion", "detachment", "electrostatics", "probe_table"]
"""Files of `gripper/laws/`."""


def loaded(code):
    """Modules that a process has after some code."""
    code += "\nimport sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_the_root_is_light():
    found = loaded("import iswarm_mj; dir(iswarm_mj); iswarm_mj.envs; dir(iswarm_mj.gripper)")
    packages = {"iswarm_mj", "iswarm_mj._version", "iswarm_mj.envs", "iswarm_mj.gripper"}
    own = {name for name in found if name.startswith("iswarm")}
    assert {name for name in own if not name.startswith("iswarm_mj.utils")} == packages
    assert not {"jax", "mujoco", "numpy", "pyarrow", "rerun", "numba"} & found


HELP = """
from iswarm_mj.commands.main import main
for words in (["--help"], ["clean", "--help"], ["bench", "--help-all"]):
    try:
        main(words)
    except SystemExit as end:
        assert end.code == 0
"""


def test_laws_settings_workers_and_help_are_light():
    """They load neither engine, nor JAX, nor a viewer."""
    light = [f"gripper.laws.{name}" for name in LAWS]
    light += [
        "config.swarm",
        "output.trajectory",
        "strategy.genome",
        "utils.pool",
        "utils.jax_setup",
    ]
    code = "".join(f"import iswarm_mj.{name}\n" for name in light) + HELP
    assert not {"jax", "mujoco", "rerun", "scipy", "matplotlib", "trimesh"} & loaded(code)


def test_simulation_does_without_the_bench_and_mjx():
    """Large parts, which take longer to import than all else together, and only some runs need."""
    modules = [
        f"iswarm_mj.simulation.{path.stem}" for path in MODULES if path.parent.name == "simulation"
    ]
    found = loaded(f"import {', '.join(modules)}")
    assert [
        name for name in found if name.startswith(("iswarm_mj.gripper.bench", "mujoco.mjx"))
    ] == []


MODULES = sorted(Path(iswarm_mj.__file__).parent.rglob("*.py"))


@pytest.mark.parametrize("package", ["iswarm_mj", "iswarm_mj.envs", "iswarm_mj.gripper"])
def test_a_package_offers_what_its_stub_names(package):
    """At run time, in `dir`, and to type checkers, for which a stub imports each name as itself."""
    offering = importlib.import_module(package)
    stub = ast.parse(Path(offering.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imported = [
        alias for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names
    ]
    assert [alias.name for alias in imported if alias.asname != alias.name] == []
    names = sorted(alias.name for alias in imported)
    assert names == sorted(offering.__all__) == sorted(dir(offering))
