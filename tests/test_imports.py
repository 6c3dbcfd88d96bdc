"""What importing a part of the package loads. Who may import whom: the contracts of import-linter in pyproject.toml."""

import ast
import importlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import iswarm_mj

LAWS = ["adhesion", "capacitance", "detachment", "electrostatics", "humidity", "probe_table"]
"""Files of `gripper/laws/`."""


def test_laws_and_settings_are_light():
    """Importing the gripper's laws, the genome and the configuration loads neither engine, nor JAX, nor a viewer."""
    light = [
        *(f"gripper.laws.{name}" for name in LAWS),
        *("config", "output.trajectory", "strategy.genome", "commands.main"),
        *(f"utils.{name}" for name in ("arrays", "errors", "units", "jax_setup")),
    ]
    heavy = {"jax", "mujoco", "rerun", "scipy", "matplotlib", "trimesh"}
    code = "import sys\n" + "\n".join(f"import iswarm_mj.{name}" for name in light)
    code += f"\nprint(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_simulation_does_without_the_bench_and_mjx():
    """Large parts, which take longer to import than all else together, and only some runs need."""
    modules = [f"iswarm_mj.simulation.{path.stem}" for path in MODULES if path.parent.name == "simulation"]
    assert "iswarm_mj.simulation.run" in modules
    code = f"import sys, {', '.join(modules)}\n"
    code += "print([name for name in sys.modules if name.startswith(('iswarm_mj.gripper.bench', 'mujoco.mjx'))])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


MODULES = sorted(Path(iswarm_mj.__file__).parent.rglob("*.py"))


@pytest.mark.parametrize(
    "path", [path for path in MODULES if path.stem == "__init__"], ids=lambda path: path.parent.name
)
def test_packages_import_nothing_of_the_package(path):
    """Importing a law must not import what lies beside it. The root and environments offer what is asked for."""
    body = ast.parse(path.read_text()).body
    nodes = [node for node in body if not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")]
    found = [part for node in nodes for part in ast.walk(node) if isinstance(part, ast.Import | ast.ImportFrom)]
    lazy = {
        "from importlib import import_module",
        "from typing import TYPE_CHECKING, Any",
    }
    offers = path in (Path(iswarm_mj.__file__), Path(iswarm_mj.__file__).parent / "envs" / "__init__.py")
    assert {ast.unparse(node) for node in found} <= {"import os"} | (lazy if offers else set())


class TestRoot:
    def test_importing_it_is_light(self):
        code = "import sys, iswarm_mj; dir(iswarm_mj); print(sorted(m for m in sys.modules if m.startswith('iswarm')))"
        code += "; print(sorted({'jax', 'mujoco', 'numpy', 'pyarrow', 'rerun', 'numba'} & set(sys.modules)))"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert done.stdout == "['iswarm_mj']\n[]\n"

    def test_it_offers_what_it_names(self):
        """At run time, to type checkers and in `dir`, the same names from the same modules."""
        (block,) = [node for node in ast.parse(Path(iswarm_mj.__file__).read_text()).body if isinstance(node, ast.If)]
        typed = {
            alias.name: node.module
            for node in ast.walk(block)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        assert sorted(typed) == sorted(iswarm_mj.__all__)
        for name, module in typed.items():
            assert getattr(iswarm_mj, name) is getattr(importlib.import_module(module), name)
            assert name in dir(iswarm_mj)

    def test_another_name(self):
        with pytest.raises(AttributeError, match="module 'iswarm_mj' has no attribute 'Swarm'"):
            _ = iswarm_mj.Swarm
        with pytest.raises(ImportError, match="cannot import name 'Swarm'"):
            exec("from iswarm_mj import Swarm")

    def test_type_checkers_know_the_names(self, tmp_path):
        """Pyright, which has no other way than the block for it."""
        file = tmp_path / "user.py"
        file.write_text("from iswarm_mj import PRESETS, Run, SwarmConfig\nreveal_type(Run)\nreveal_type(PRESETS)\n")
        settings = tmp_path / "pyrightconfig.json"
        root = Path(iswarm_mj.__file__).parents[1]
        settings.write_text(json.dumps({"include": ["user.py"], "extraPaths": [str(root)]}))
        done = subprocess.run(
            ["pyright", "--pythonpath", sys.executable, "-p", settings], capture_output=True, text=True
        )
        assert 'Type of "Run" is "type[Run]"' in done.stdout, done.stdout
        assert 'Type of "PRESETS" is "dict[str, Genome]"' in done.stdout
        assert done.returncode == 0, done.stdout
