"""Imports: what each part of the package loads, and what packages offer.

The contracts of import-linter in pyproject.toml say which part may import which.
"""

import ast
import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

import iswarm_mj

LAWS = ["adhesion", "detachment", "electrostatics", "probe_table"]
"""Files of `gripper/laws/`."""


def modules_after(code):
    """Return the modules that a process has loaded after some code.

    It has no variables of the libraries, such as MUJOCO_GL, which drawing sets: those whose
    variables are set are imported to check them.
    """
    code += "\nimport sys; print(*sys.modules)"
    of_libraries = ("JAX_", "NUMBA_", "MUJOCO_GL", "XLA_FLAGS")
    environ = {
        name: value for name, value in os.environ.items() if not name.startswith(of_libraries)
    }
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environ
    )
    return set(process.stdout.splitlines()[-1].split())


def names_below(prefix, names):
    """Return the names that begin with a prefix."""
    return {name for name in names if name.startswith(prefix)}


def test_the_root_is_light():
    """It loads neither NumPy nor any large package."""
    loaded = modules_after(
        "import iswarm_mj; dir(iswarm_mj); iswarm_mj.envs; dir(iswarm_mj.gripper)"
    )
    of_package = names_below("iswarm", loaded) - names_below("iswarm_mj.utils", loaded)
    packages = {"iswarm_mj", "iswarm_mj._version", "iswarm_mj.envs", "iswarm_mj.gripper"}
    assert of_package == packages
    assert not {"jax", "mujoco", "numpy", "pyarrow", "rerun", "numba"} & loaded


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
    heavy = {"jax", "mujoco", "rerun", "scipy", "matplotlib", "trimesh"}
    assert not heavy & modules_after(code)


def test_fits_do_without_mujoco_and_jax():
    loaded = modules_after(
        "from iswarm_mj import fit\n"
        "columns = {'radius [um]': [15, 20], 'humidity [%]': [10, 10], 'voltage [V]': [24, 27]}\n"
        "fit(columns).proposal"
    )
    assert not {"jax", "mujoco", "numba", "matplotlib"} & loaded


def test_simulation_does_without_the_bench_and_mjx():
    """These take longer to import than all else together, and only some runs need them."""
    simulation = Path(iswarm_mj.__file__).parent / "simulation"
    modules = [f"iswarm_mj.simulation.{path.stem}" for path in sorted(simulation.glob("*.py"))]
    loaded = modules_after(f"import {', '.join(modules)}")
    assert not names_below("iswarm_mj.gripper.bench", loaded)
    assert not names_below("mujoco.mjx", loaded)


@pytest.mark.parametrize("package", ["iswarm_mj", "iswarm_mj.envs", "iswarm_mj.gripper"])
def test_a_package_offers_what_its_stub_names(package):
    """A stub imports each name as itself, so that type checkers take it for public."""
    offering = importlib.import_module(package)
    stub = ast.parse(Path(offering.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    names = []
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                assert alias.asname == alias.name
                names.append(alias.name)
    assert sorted(names) == sorted(offering.__all__) == sorted(dir(offering))
