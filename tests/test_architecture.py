"""The floors of the package: a module imports from lower floors only. Sizes, docstrings, and what stays light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import iswarm_mj

PACKAGE = Path(iswarm_mj.__file__).parent

FLOORS = [
    [
        "__init__",
        "arrays",
        "compilation",
        "errors",
        "experiments.statistics",
        "hardware",
        "mjx",
        "settings",
        "timing",
        "trajectory",
        "units",
        "gripper.trace",
    ],
    [
        "config",
        "blueprint",
        "engines.body_trees",
        "experiments.findings",
        "files",
        "gripper.protocol",
        "sensors.neighbours",
    ],
    ["blueprint_grasp", "conditions", "experiments.measures", "figures", "hosts", "tables", "experiments.checkpoint"],
    [
        "record_grasp",
        "experiments.evolution_figure",
        "experiments.plots",
        "swarm_figure",
        "gripper.adhesion",
        "gripper.humidity",
        "gripper.maugis",
        "gripper.probe_table",
        "gripper.sphere_plane",
    ],
    [
        "gripper.electrostatics",
        "gripper.boundary_elements",
        "strategy.vectors",
        "strategy.genome",
        "gripper.plugin_abi",
    ],
    [
        "engines.timers",
        "gripper.detachment",
        "strategy.avoidance",
        "strategy.evolution",
        "sensors.messages",
        "sensors.optics",
        "gripper.plugin_native",
    ],
    [
        "sensors.exchange",
        "sensors.floor",
        "sensors.shadows",
        "strategy.controller",
        "experiments.choices",
        "experiments.evolution_findings",
        "experiments.optimisers",
        "layout",
        "model",
        "gripper.bench",
        "gripper.plugin_forces",
        "voltage_figures",
    ],
    [
        "gripper.handling",
        "grasp_figures",
        "experiments.grasp_findings",
        "gripper.experiment",
        "gripper.plugin",
        "sensors.links",
        "engines.base",
        "strategy.protocol",
        "strategy.turns",
        "strategy.vector_strategy",
        "engines.mujoco_batch",
        "engines.implicit_contacts",
        "engines.mjx_arena",
        "engines.planar_contacts",
    ],
    [
        "engines.mjx_motion",
        "engines.mjx_sight",
        "metrics",
        "strategy.signatures",
        "swarm",
        "gripper.bench_model",
        "gripper.mjx_forces",
    ],
    ["rollout", "experiments.law_findings", "gripper.bench_mjx", "gripper.bench_mujoco"],
    ["worlds", "snapshot", "record", "results", "gripper.bench_trace", "gripper.trials", "experiments.jobs"],
    ["batch_step", "cleaning", "gripper.bench_speed", "gripper.force_curve", "picture"],
    ["benchmark", "devices", "faults", "grasping", "video"],
    ["batched", "commands.grasp", "commands.picture"],
    ["batched_views", "benchmark_mjx", "rollouts", "commands.swarm_options", "experiments.batches"],
    ["cleaning_mjx", "experiments.pool"],
    ["experiments.evolve", "experiments.study"],
    ["commands.evolve", "commands.clean", "commands.bench"],
    [f"experiments.{name}" for name in ("hop_count", "density", "types", "sensitivity", "robustness")],
    ["experiments.registry", "commands.video"],
    ["commands.experiment", "experiments.report_results"],
    ["experiments.report_sections"],
    ["experiments.report_text"],
    ["experiments.report_html", "experiments.report_markdown"],
    ["experiments.report"],
    ["commands.report"],
    ["cli"],
    ["__main__"],
]
FLOOR = {name: floor for floor, names in enumerate(FLOORS) for name in names}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
GROUPS = ["commands", "engines", "experiments", "gripper", "sensors", "strategy"]
"""Packages whose `__init__` holds a docstring only."""


def imports(path: Path) -> set[str]:
    """Full names of all that a module imports, anywhere in it; of `from a import b` both a and a.b."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively"
            names |= {str(node.module)} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def modules_of_the_package(path: Path) -> set[str]:
    """Modules of the package that a module imports."""
    found = {name.removeprefix("iswarm_mj.") for name in imports(path) if name.startswith("iswarm_mj.")}
    return (found & MODULES.keys()) - set(GROUPS)


def test_each_module_has_a_floor():
    assert sorted([*FLOOR, *GROUPS]) == sorted(MODULES)


def test_modules_import_from_lower_floors_only():
    upward = [
        f"{name} (floor {floor}) imports {other} (floor {FLOOR[other]})"
        for name, floor in FLOOR.items()
        for other in sorted(modules_of_the_package(MODULES[name]))
        if FLOOR[other] >= floor
    ]
    assert upward == []


def test_floors_are_as_low_as_can_be():
    """Each module stands right above the highest that it imports, but for those that are set apart."""
    for name in ("swarm", "rollout", "cleaning", "benchmark", "cli", "__main__", "gripper.detachment"):
        below = [FLOOR[other] for other in modules_of_the_package(MODULES[name])]
        assert max(below) == FLOOR[name] - 1, name


def test_imports_are_seen(tmp_path):
    """In functions, of modules from packages, and of names from modules."""
    path = tmp_path / "module.py"
    path.write_text(
        "from iswarm_mj import layout\nfrom iswarm_mj.gripper import handling\nimport iswarm_mj.swarm as s\n"
        "def f():\n    from iswarm_mj.units import RD\n"
    )
    assert modules_of_the_package(path) == {"layout", "gripper.handling", "swarm", "units"}


@pytest.mark.parametrize("name", GROUPS)
def test_packages_import_nothing(name):
    assert imports(MODULES[name]) == set()


MJX = {"mjx", "engines.mjx_arena"}
PLUGIN = {
    "gripper.bench_mjx",
    "gripper.bench_model",
    "gripper.bench_mujoco",
    "gripper.bench_speed",
    "gripper.bench_trace",
    "gripper.mjx_forces",
    "gripper.plugin",
    "gripper.plugin_abi",
    "gripper.plugin_forces",
    "gripper.plugin_native",
}


@pytest.mark.parametrize(
    "library, allowed",
    [
        ("rerun", {"record", "blueprint", "record_grasp", "blueprint_grasp"}),
        ("mujoco", {"model", "engines.mujoco_batch", "rollout", "picture", *PLUGIN, *MJX}),
        ("tyro", {"cli", "commands.experiment", "commands.swarm_options", "commands.picture", "commands.video"}),
    ],
)
def test_libraries_are_met_in_few_places(library, allowed):
    users = {name for name, path in MODULES.items() if library in {i.split(".")[0] for i in imports(path)}}
    assert users and users <= allowed


LAWS = ["adhesion", "detachment", "electrostatics", "humidity", "maugis", "probe_table", "sphere_plane"]
"""Files of `gripper/` that hold laws."""


def test_laws_and_settings_are_light():
    """Importing the gripper's laws, the genome and the configuration loads neither engine, nor JAX, nor a viewer."""
    light = [
        *(f"gripper.{name}" for name in [*LAWS, "boundary_elements"]),
        "arrays",
        "config",
        "errors",
        "units",
        "trajectory",
        "compilation",
        "strategy.genome",
        "cli",
    ]
    heavy = {"jax", "mujoco", "rerun", "scipy", "matplotlib", "trimesh"}
    code = "import sys\n" + "\n".join(f"import iswarm_mj.{name}" for name in light)
    code += f"\nprint(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("name", MODULES)
def test_files_are_short(name):
    assert len(MODULES[name].read_text().splitlines()) <= 300


@pytest.mark.parametrize("name", MODULES)
def test_all_that_is_public_is_documented(name):
    """Modules, and the functions, classes and methods without a leading underscore."""
    tree = ast.parse(MODULES[name].read_text())
    bare = [] if ast.get_docstring(tree) else ["the module"]

    def visit(node: ast.AST, prefix: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.ClassDef | ast.FunctionDef) and not child.name.startswith("_"):
                if not ast.get_docstring(child):
                    bare.append(prefix + child.name)
                if isinstance(child, ast.ClassDef):
                    visit(child, f"{prefix}{child.name}.")

    visit(tree, "")
    assert bare == []
