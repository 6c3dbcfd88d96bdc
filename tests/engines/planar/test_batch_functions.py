"""Functions of numbers, compiled by NVIDIA Warp with 32-bit floats, against Python.

A kernel is written for each function: it calls the function with each row of a table of numbers.
A named tuple among the arguments stands for its fields, one after the other.
"""

import importlib
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
from iswarm_mj.engines.contact_geometry import ContactPoints, Corners, Ends, Rectangle, Side
from iswarm_mj.engines.planar import contact_law, ray_geometry, reception
from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.engines.planar.kinds import Wall
from iswarm_mj.engines.planar.ray_geometry import Ray
from iswarm_mj.engines.planar.reception import Point, Port, read_light

MODULES = {
    "geometry": contact_geometry,
    "law": contact_law,
    "rays": ray_geometry,
    "light": reception,
}
"""Modules of functions, by the names of their counterparts in `gpu.functions`."""
NUMBERS = {float: "float({})", int: "int({})", bool: "{} != 0.0"}
"""Types of numbers, with their expressions of an element of the table."""
TUPLES = {
    ContactLaw: "law.ContactLaw",
    ContactPoints: "geometry.ContactPoints",
    Corners: "geometry.Corners",
    Ends: "geometry.Ends",
    Point: "light.Point",
    Port: "light.Port",
    Ray: "rays.Ray",
    Rectangle: "geometry.Rectangle",
    Side: "geometry.Side",
    Wall: "shared.Wall",
}
"""Named tuples of numbers, with their structs."""

N_SAMPLES = 3000
LED_TAN = read_light(read_robot(), OpticsConfig()).led_tan
HALF_EDGES = 1.4, 0.6
TIMESTEP = 0.01


def heading(rng):
    """Return cosine and sine of a random angle."""
    angle = rng.uniform(-4, 4)
    return math.cos(angle), math.sin(angle)


def rectangle(rng):
    """Return the fields of a rectangle near the origin."""
    return *rng.uniform(-0.7, 0.7, 2), *heading(rng), *HALF_EDGES


def two_rectangles(rng):
    """Return the fields of two rectangles that overlap or are near each other."""
    return *rectangle(rng), *rng.uniform(-2.0, 2.0, 2), *heading(rng), *HALF_EDGES[::-1]


def two_facing_sides(rng):
    """Return two sides whose normals are at most 45 degrees from opposite."""
    angle = rng.uniform(-4, 4)
    opposite = angle + math.pi + rng.uniform(-math.pi / 4, math.pi / 4)
    reference = math.cos(angle), math.sin(angle), *HALF_EDGES
    incident = math.cos(opposite), math.sin(opposite), *HALF_EDGES
    return *reference, *incident


def ends(rng):
    """Return the ends of a side of which a part is in front of another one."""
    start = rng.uniform(-2, 0.5)
    return start, rng.uniform(-1, 1), start + rng.uniform(1, 2), rng.uniform(-1, 1)


def ends_on_any_side(rng):
    """Return the ends of a side in front of another one, to the left or to the right of it."""
    start, start_height, end, end_height = ends(rng)
    shift = rng.choice([-4.0, 0.0, 4.0])
    return start + shift, start_height, end + shift, end_height


def law(rng):
    """Return the fields of a contact law."""
    margin = rng.uniform(0.0, 0.3)
    power = rng.choice([1.0, 2.0, 3.0])
    return rng.uniform(10, 40), rng.uniform(5, 20), margin, 0.6, 0.97, 0.3, 0.3, power


def matrix(rng):
    """Return the three elements of a symmetric positive definite matrix."""
    root = rng.normal(size=(2, 2))
    positive = root @ root.T + 0.3 * np.eye(2)
    return positive[0, 0], positive[0, 1], positive[1, 1]


def ray(rng):
    """Return the fields of a ray."""
    return *rng.uniform(-4, 4, 2), *rng.uniform(-8, 8, 2)


def ray_and_rectangle(rng):
    """Return the fields of a ray and of a rectangle at the origin."""
    return *ray(rng), 0.0, 0.0, *heading(rng), *HALF_EDGES


def two_rows(rng):
    """Return arguments of two rows, or of one, whose second impulse is 0."""
    is_two = rng.integers(2)
    p1, p2 = rng.exponential(size=2) * rng.integers(0, 2, 2) * (1, is_two)
    return p1, p2, *rng.normal(size=2), *matrix(rng), is_two


ARGUMENTS = {
    "wider_gap": lambda rng: (*rng.uniform(-1, 1, 1), 0, *rng.uniform(-1, 1, 1), 2),
    "separation": two_rectangles,
    "choose": lambda rng: (rng.integers(2), *two_rectangles(rng)),
    "side_towards": lambda rng: (*rectangle(rng), *rng.uniform(-2, 2, 2), rng.integers(2)),
    "ends_of": lambda rng: (*two_facing_sides(rng), *rng.uniform(-2, 2, 2)),
    "clip_side": lambda rng: (*ends(rng), 1.4),
    "nearest_corners": lambda rng: (*ends_on_any_side(rng), 1.4),
    "rectangle_contact": two_rectangles,
    "wall_contact": lambda rng: (rng.uniform(0.3, 1.6), *heading(rng), *rectangle(rng)),
    "impedance": lambda rng: (rng.uniform(-0.4, 0), *law(rng)),
    "regularisation": lambda rng: (rng.uniform(0.5, 0.99), rng.uniform(0.05, 0.2)),
    "offset": lambda rng: (
        rng.uniform(0.5, 0.99),
        rng.uniform(-0.4, 0),
        rng.uniform(-2, 2),
        *law(rng),
        TIMESTEP,
    ),
    "two_impulses": two_rows,
    "velocity_change": lambda rng: tuple(rng.uniform(-2, 2, 4)),
    "into_frame": lambda rng: (*rng.uniform(-5, 5, 2), *heading(rng)),
    "meets_rectangle": ray_and_rectangle,
    "between_sides": lambda rng: (rng.uniform(-3, 3), rng.integers(-2, 3) / 2, 1.4),
    "meets_wall_at": lambda rng: (
        *rng.uniform(-11, 11, 2),
        *rng.uniform(-8, 8, 2),
        *heading(rng),
        10.0,
    ),
    "is_crossed": ray_and_rectangle,
    "facing_side": lambda rng: tuple(rng.uniform(-5, 5, 2)),
    "is_in_cone": lambda rng: (*rng.uniform(-5, 5, 2), LED_TAN),
    "port": lambda rng: (*rng.uniform(-5, 5, 4), *heading(rng)),
}
"""Random arguments of each function, flat."""


def parameters(function):
    """Return the types of a function's parameters by their names."""
    hints = get_type_hints(function)
    return {name: kind for name, kind in hints.items() if name != "return"}


def functions_of(module):
    """Return a module's own functions of numbers, by their names."""
    known = NUMBERS.keys() | TUPLES.keys()
    functions = {}
    for name, value in vars(module).items():
        is_own = isinstance(value, FunctionType) and value.__module__ == module.__name__
        if is_own and set(parameters(value).values()) <= known:
            functions[name] = value
    return functions


FUNCTIONS = {
    name: (module_name, function)
    for module_name, module in MODULES.items()
    for name, function in functions_of(module).items()
}
"""All functions by their names, with the names of their modules."""


def results_of(function):
    """Return names for a function's results, r0, r1 ..., and the numbers in them as expressions."""
    returned = get_type_hints(function)["return"]
    if returned in TUPLES:
        return ["r0"], [f"r0.{field}" for field in returned._fields]
    n_results = len(getattr(returned, "__args__", (0,)))
    names = [f"r{k}" for k in range(n_results)]
    return names, names


def source_of(name, module_name, function):
    """Return the source of a kernel that calls a function with each row of a table."""
    # Arguments, each of the next columns of the table.
    lines = []
    arguments = []
    column = 0
    for parameter, kind in parameters(function).items():
        if kind in TUPLES:
            lines.append(f"    {parameter} = {TUPLES[kind]}()")
            for field, number in kind.__annotations__.items():
                value = NUMBERS[number].format(f"table[k, {column}]")
                lines.append(f"    {parameter}.{field} = {value}")
                column += 1
            arguments.append(parameter)
        else:
            arguments.append(NUMBERS[kind].format(f"table[k, {column}]"))
            column += 1

    names, numbers = results_of(function)
    writes = [f"    results[k, {i}] = float({number})" for i, number in enumerate(numbers)]
    return "\n".join(
        [
            f"f_{name} = {module_name}.{name}",
            "@wp.kernel(enable_backward=False)",
            f"def k_{name}(table: wp.array2d(dtype=float), results: wp.array2d(dtype=float)):",
            "    k = wp.tid()",
            *lines,
            f"    {', '.join(names)} = f_{name}({', '.join(arguments)})",
            *writes,
            "",
        ]
    )


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    """Return a module with the kernels of all functions, as one program."""
    path = tmp_path_factory.mktemp("kernels") / "kernels_of_numbers.py"
    names = ", ".join([*MODULES, "shared"])
    imports = f"import warp as wp\nfrom iswarm_mj.engines.planar.gpu.functions import {names}\n"
    sources = [source_of(name, *function) for name, function in FUNCTIONS.items()]
    path.write_text("\n".join([imports, *sources]))

    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def call_in_python(function, row):
    """Return the results of a function for flat arguments, as a tuple of numbers."""
    numbers = iter(row)
    arguments = []
    for kind in parameters(function).values():
        if kind in TUPLES:
            arguments.append(kind(*(next(numbers) for _ in kind._fields)))
        else:
            arguments.append(kind(next(numbers)))
    result = function(*arguments)
    return result if isinstance(result, tuple) else (result,)


def test_every_function_is_compiled_and_tested():
    assert ARGUMENTS.keys() == FUNCTIONS.keys()


@pytest.mark.parametrize("name", ARGUMENTS)
def test_a_function_returns_what_python_returns(kernels, name):
    rng = np.random.default_rng(1)
    _, function = FUNCTIONS[name]
    rows = rounded([ARGUMENTS[name](rng) for _ in range(N_SAMPLES)])
    expected = np.array([call_in_python(function, row) for row in rows.tolist()], float)
    table = wp.array(rows, dtype=float, device="cpu")
    results = wp.zeros(expected.shape, dtype=float, device="cpu")
    wp.launch(getattr(kernels, f"k_{name}"), N_SAMPLES, [table], [results], device="cpu")

    np.testing.assert_allclose(results.numpy(), expected, rtol=2e-5, atol=1e-5)
    assert len(np.unique(expected, axis=0)) > 1


@pytest.mark.parametrize("mode", ["sector", "power"])
def test_words_of_parameters_do_not_depend_on_what_lay_in_memory(mode):
    """They are constants of programs, which processes find in the cache if all are the same."""
    functions = importlib.import_module("iswarm_mj.engines.planar.gpu.functions")
    light = read_light(read_robot(), OpticsConfig(mode=mode))
    n_bytes = functions.words_of(light).nbytes
    words = []
    for byte in (0x00, 0xFF):
        blocks = [np.full(n_bytes, byte, np.uint8) for _ in range(100)]
        del blocks
        words.append(functions.words_of(light).tolist())
    assert words[0] == words[1]
