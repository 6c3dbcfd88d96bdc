"""The functions of numbers, compiled by NVIDIA Warp with 32-bit floats: Python's results, but for rounding."""

import importlib.util
import math
from types import FunctionType
from typing import get_type_hints

import numpy as np
import pytest
import warp as wp
from support.planar import rounded

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines import contact_geometry
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar import contact_law, ray_geometry, reception
from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.engines.planar.reception import read_light

MODULES = {"geometry": contact_geometry, "law": contact_law, "rays": ray_geometry, "light": reception}
KINDS = {float: "float({})", int: "int({})", bool: "{} != 0.0"}
N_SAMPLES = 3000
LIGHT = read_light(read_robot(), OpticsConfig())
SHAPE = 1.4, 0.6


def heading(rng):
    angle = rng.uniform(-4, 4)
    return math.cos(angle), math.sin(angle)


def law(rng):
    power = rng.choice([1.0, 2.0, 3.0])
    return rng.uniform(10, 40), rng.uniform(5, 20), 0.6, 0.97, 0.3, 0.3, power


def matrix(rng):
    root = rng.normal(size=(2, 2))
    h = root @ root.T + 0.3 * np.eye(2)
    return h[0, 0], h[0, 1], h[1, 1]


def pair(rng):
    return *rng.uniform(-1.4, 1.4, 2), *heading(rng), *heading(rng), *SHAPE, *SHAPE[::-1]


def ray(rng):
    return *rng.uniform(-4, 4, 2), *rng.uniform(-8, 8, 2), *heading(rng), *SHAPE


def two_rows(rng):
    """Of two rows, or of one, whose second impulse is 0."""
    is_two = rng.integers(2)
    p1, p2 = rng.exponential(size=2) * rng.integers(0, 2, 2) * (1, is_two)
    return p1, p2, *rng.normal(size=2), *matrix(rng), is_two


ARGUMENTS = {
    "separation": pair,
    "side_towards": lambda rng: (*rng.uniform(-2, 2, 2), *heading(rng), rng.integers(2)),
    "rectangle_contact": pair,
    "wall_contact": lambda rng: (rng.uniform(0.3, 1.6), *heading(rng), *heading(rng), *SHAPE),
    "impedance": lambda rng: (rng.uniform(-0.4, 0), *law(rng)),
    "regularisation": lambda rng: (rng.uniform(0.5, 0.99), rng.uniform(0.05, 0.2)),
    "offset": lambda rng: (rng.uniform(0.5, 0.99), rng.uniform(-0.4, 0), rng.uniform(-2, 2), *law(rng), 0.01),
    "two_impulses": two_rows,
    "velocity_change": lambda rng: tuple(rng.uniform(-2, 2, 10)),
    "meets_rectangle": ray,
    "_between_sides": lambda rng: (rng.uniform(-3, 3), rng.integers(-2, 3) / 2, 1.4),
    "meets_line": lambda rng: (*rng.uniform(-11, 11, 2), *rng.uniform(-8, 8, 2), *heading(rng), 10.0),
    "facing_side": lambda rng: tuple(rng.uniform(-5, 5, 2)),
    "onto_axis": lambda rng: (*rng.uniform(-5, 5, 2), *heading(rng)),
    "is_in_cone": lambda rng: (*rng.uniform(-5, 5, 2), LIGHT.led_tan),
    "is_crossed": ray,
}
"""Of each function, flat: a contact law stands for its fields."""


def functions_of(module):
    """A module's own functions of numbers, by name."""
    kinds = {float, int, bool, ContactLaw}
    own = {n: f for n, f in vars(module).items() if isinstance(f, FunctionType) and f.__module__ == module.__name__}
    return {n: f for n, f in own.items() if {k for a, k in get_type_hints(f).items() if a != "return"} <= kinds}


OWNERS = {name: space for space, module in MODULES.items() for name in functions_of(module)}


def parameters(function):
    return {name: kind for name, kind in get_type_hints(function).items() if name != "return"}


def source_of(name, space, function):
    """A kernel that calls the function with each row of numbers, and writes what it returns into another row."""
    lines, arguments, at = [], [], 0
    for parameter, kind in parameters(function).items():
        if kind is ContactLaw:
            lines.append(f"    {parameter} = {space}.ContactLaw()")
            lines += [f"    {parameter}.{field} = a[k, {at + i}]" for i, field in enumerate(ContactLaw._fields)]
            arguments.append(parameter)
            at += len(ContactLaw._fields)
        else:
            arguments.append(KINDS[kind].format(f"a[k, {at}]"))
            at += 1
    results = [f"r{i}" for i in range(n_results(function))]
    return "\n".join(
        [
            f"f_{name} = {space}.{name}",
            "@wp.kernel(enable_backward=False)",
            f"def k_{name}(a: wp.array2d(dtype=float), out: wp.array2d(dtype=float)):",
            "    k = wp.tid()",
            *lines,
            f"    {', '.join(results)} = f_{name}({', '.join(arguments)})",
            *(f"    out[k, {i}] = float({result})" for i, result in enumerate(results)),
            "",
        ]
    )


def n_results(function):
    return len(getattr(get_type_hints(function)["return"], "__args__", (0,)))


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    """All functions as kernels of one program."""
    path = tmp_path_factory.mktemp("kernels") / "kernels_of_numbers.py"
    parts = [source_of(name, space, functions_of(MODULES[space])[name]) for name, space in OWNERS.items()]
    imports = f"import warp as wp\nfrom iswarm_mj.engines.planar.gpu.functions import {', '.join(MODULES)}\n"
    path.write_text("\n".join([imports, *parts]))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def called(function, row):
    """What Python returns for flat arguments, as a tuple of numbers."""
    left, arguments = iter(row), []
    for kind in parameters(function).values():
        is_law = kind is ContactLaw
        arguments.append(ContactLaw(*(next(left) for _ in ContactLaw._fields)) if is_law else kind(next(left)))
    found = function(*arguments)
    return found if isinstance(found, tuple) else (found,)


def test_every_function_is_compiled_and_tested():
    assert ARGUMENTS.keys() == OWNERS.keys()


@pytest.mark.parametrize("name", ARGUMENTS)
def test_a_function_returns_what_python_returns(kernels, name):
    rng, function = np.random.default_rng(1), functions_of(MODULES[OWNERS[name]])[name]
    rows = rounded([ARGUMENTS[name](rng) for _ in range(N_SAMPLES)])
    expected = np.array([called(function, row) for row in rows.tolist()], float)
    given, out = wp.array(rows, dtype=float, device="cpu"), wp.zeros(expected.shape, dtype=float, device="cpu")
    wp.launch(getattr(kernels, f"k_{name}"), len(rows), [given], [out], device="cpu")
    np.testing.assert_allclose(out.numpy(), expected, rtol=2e-5, atol=1e-5)
    assert len(np.unique(expected, axis=0)) > 1
