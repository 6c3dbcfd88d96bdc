"""What importing a part of the package loads. Who may import whom: the contracts of import-linter in pyproject.toml."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import iswarm_mj

LAWS = ["adhesion", "boundary_elements", "detachment", "electrostatics", "humidity", "maugis", "probe_table"]
"""Files of `gripper/laws/`."""


def test_laws_and_settings_are_light():
    """Importing the gripper's laws, the genome and the configuration loads neither engine, nor JAX, nor a viewer."""
    light = [
        *(f"gripper.laws.{name}" for name in [*LAWS, "sphere_plane"]),
        *("config", "output.trajectory", "strategy.genome", "commands.main"),
        *(f"utils.{name}" for name in ("arrays", "errors", "units", "jax_setup")),
    ]
    heavy = {"jax", "mujoco", "rerun", "scipy", "matplotlib", "trimesh"}
    code = "import sys\n" + "\n".join(f"import iswarm_mj.{name}" for name in light)
    code += f"\nprint(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_runs_on_the_host_do_without_mjx():
    """Importing it takes longer than all else together."""
    code = "import sys, iswarm_mj.simulation.rollout, iswarm_mj.experiments.runner.jobs\n"
    code += "print('mujoco.mjx' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


MODULES = sorted(Path(iswarm_mj.__file__).parent.rglob("*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: f"{path.parent.name}.{path.stem}")
def test_files_are_short(path):
    assert len(path.read_text().splitlines()) <= 300


@pytest.mark.parametrize(
    "path", [path for path in MODULES if path.stem == "__init__"], ids=lambda path: path.parent.name
)
def test_packages_import_nothing_of_the_package(path):
    """Importing a law must not import what lies beside it."""
    nodes = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert {ast.unparse(node) for node in nodes} <= {"import os"}
