"""The package's functions of plain numbers, compiled by Warp as well.

Contact law, geometry and optics are written once, as functions that take and return numbers. On
CPUs numba compiles them, with 64-bit floats; on GPUs Warp does, with 32-bit floats.
"""

import atexit
import functools
import math
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import warp as wp

from iswarm_mj.engines import contact_geometry
from iswarm_mj.engines.planar import (
    contact_law,
    contact_rows,
    in_sight,
    kinds,
    plane,
    ray_geometry,
    reception,
)
from iswarm_mj.engines.planar.compiled import SOURCES
from iswarm_mj.utils.compiled import version


def _start() -> None:
    """Start Warp, whose kernels are kept in its cache.

    Where that cannot be written to, they are kept until this process ends.

    Warp 1.18 would use a kernel whose structs were edited, so each state of the sources has its
    own folder.
    """
    wp.config.log_level = wp.LOG_WARNING  # standard output is reserved for results
    try:
        wp.init()
        folder = Path(wp.config.kernel_cache_dir) / f"iswarm_mj-{version(SOURCES)}"
        folder.mkdir(parents=True, exist_ok=True)
        wp.config.kernel_cache_dir = str(folder)
        is_writable = os.access(folder, os.W_OK)
    except OSError:
        is_writable = False
    if not is_writable:
        temporary = tempfile.TemporaryDirectory(prefix="warp-")
        atexit.register(temporary.cleanup)
        wp.config.kernel_cache_dir = temporary.name
        wp.init()


_start()
_RESIDENT_THREADS = 512  # threads of a multiprocessor at once, which leave 128 registers to each


def in_warp(module: ModuleType) -> Any:
    """Return a module with Warp's counterparts of its functions and named tuples.

    Functions and named tuples with arguments or fields of a type that Warp does not know stay as
    they are.
    """
    names = dict(vars(module))  # what the functions find under the names that they use
    for name, value in vars(module).items():
        if not isinstance(value, type | FunctionType | BuiltinFunctionType):
            continue
        is_new = value.__module__ == module.__name__ and value not in _COUNTERPARTS
        if is_new:
            counterpart = _struct(value) if isinstance(value, type) else _function(value, names)
            if counterpart is not None:
                _COUNTERPARTS[value] = counterpart
        names[name] = _COUNTERPARTS.get(value, value)
    return SimpleNamespace(**names)


def _struct(kind: type) -> Any:
    """Return a named tuple as a struct; None if Warp does not know the type of a field."""
    fields = {name: _COUNTERPARTS.get(field) for name, field in kind.__annotations__.items()}
    if not issubclass(kind, tuple) or None in fields.values():
        return None
    members = {"__annotations__": fields, "__module__": __name__}
    return wp.struct(type(kind.__name__, (), members))


def _function(function: FunctionType, names: dict[str, Any]) -> Any:
    """Return a function that finds its names in `names` as Warp's.

    It is None if Warp does not know the type of an argument."""
    annotations = dict(function.__annotations__)
    returned = annotations.pop("return")
    arguments = {name: _COUNTERPARTS.get(kind) for name, kind in annotations.items()}
    if None in arguments.values():
        return None
    copy = FunctionType(function.__code__, names, function.__name__)
    if isinstance(returned, type):  # tuples of types stay, as several results
        returned = _COUNTERPARTS[returned]
    copy.__annotations__ = arguments | {"return": returned}
    return wp.func(copy)


_COUNTERPARTS: dict[Any, Any] = {
    float: float,
    int: int,
    bool: bool,
    kinds.Places: wp.array(dtype=wp.vec4),
    kinds.Table: wp.array2d(dtype=float),
    kinds.Codes: wp.array2d(dtype=int),
    contact_geometry.where: wp.where,
    math.sqrt: wp.sqrt,
}
"""Warp's counterpart of each type of arguments, named tuple and function so far."""

Place = _struct(kinds.Place)
_COUNTERPARTS[kinds.Place] = Place


@wp.func
def place_of(places: wp.array(dtype=wp.vec4), robot: int) -> Place:
    """Return the place of a robot, as `kinds.place_of`; it is read at once."""
    place = places[robot]
    return Place(place[0], place[1], place[2], place[3])


@wp.func
def _two_impulses(
    p1: float,
    p2: float,
    w1: float,
    w2: float,
    h11: float,
    h12: float,
    h22: float,
    is_two: bool,
) -> tuple[float, float]:
    """Return what `contact_law.two_impulses` does.

    It has no branches, in which the threads of a warp would wait for each other.
    """
    # Both rows push.
    inverse = 1.0 / (h11 * h22 - h12 * h12)
    both1 = p1 + (h12 * w2 - h22 * w1) * inverse
    both2 = p2 + (h12 * w1 - h11 * w2) * inverse
    are_both = is_two and both1 >= 0.0 and both2 >= 0.0

    # The first row pushes alone, unless that contradicts the second row.
    alone1 = wp.max(0.0, p1 - (w1 - h12 * p2) * (1.0 / h11))
    alone2 = wp.max(0.0, p2 - (w2 - h12 * p1) * (1.0 / h22))
    is_first = not is_two or w2 + h12 * (alone1 - p1) - h22 * p2 >= 0.0
    single1 = wp.where(is_first, alone1, 0.0)
    single2 = wp.where(is_first, 0.0, alone2)
    return wp.where(are_both, both1, single1), wp.where(are_both, both2, single2)


# Modules in the order of their imports. Functions that are written again for Warp come first.
_COUNTERPARTS[kinds.place_of] = place_of
_COUNTERPARTS[contact_law.two_impulses] = _two_impulses
geometry = in_warp(contact_geometry)
shared = in_warp(kinds)
law = in_warp(contact_law)
rays = in_warp(ray_geometry)
light = in_warp(reception)
arena = in_warp(plane)
_COUNTERPARTS[kinds.Kinds] = wp.array(dtype=arena.Kind)
rows = in_warp(contact_rows)
view = in_warp(in_sight)

ContactLaw = law.ContactLaw
Kind = arena.Kind
Light = light.Light
Plane = arena.Plane
Rectangle = geometry.Rectangle
Scene = view.Scene
Velocity = shared.Velocity
View = view.View


def words_of(*parameters: tuple) -> np.ndarray:
    """Return the numbers of named tuples as they lie in their structs, in words of 32 bits.

    Kernels in JAX programs take arrays only, so parameters travel as words. They become constants
    of these programs, so bytes between fields are 0: with whatever lay in memory each process would
    compile a program of its own.
    """
    struct = _COUNTERPARTS[type(parameters[0])]
    structs = np.zeros(len(parameters), struct.numpy_dtype())
    for index, parameter in enumerate(parameters):
        structs[index] = tuple(parameter)
    return structs.view(np.int32)


@wp.func
def plane_in(words: wp.array(dtype=int)):
    """Return the plane in `words_of` as an array (1,).

    It is read where it is needed, since registers are scarce."""
    return wp.array(ptr=words.ptr, shape=(1,), dtype=Plane)


@wp.func
def light_in(words: wp.array(dtype=int)):
    """Return the light in `words_of` as an array (1,)."""
    return wp.array(ptr=words.ptr, shape=(1,), dtype=Light)


@wp.func
def kinds_in(words: wp.array(dtype=int), n_bodies: int):
    """Return the kinds of bodies in `words_of` as an array (n_bodies,)."""
    return wp.array(ptr=words.ptr, shape=(n_bodies,), dtype=Kind)


@functools.cache
def jax_kernel(
    function: Callable,
    is_fast: bool,
    n_threads: int | None,
    n_outputs: int,
    *in_out: str,
) -> Any:
    """Return a kernel as a function of JAX arrays.

    Args:
        function: the kernel's function.
        is_fast: round divisions, roots and sines less exactly, as GPUs can.
        n_threads: threads of a block; None for Warp's choice.
        n_outputs: number of outputs, with arguments that are changed in place.
        in_out: names of arguments that are changed in place.
    """
    bounds = None if n_threads is None else (n_threads, max(1, _RESIDENT_THREADS // n_threads))
    options = {"fast_math": is_fast}
    kernel = wp.kernel(
        function,
        enable_backward=False,
        module="unique",
        module_options=options,
        launch_bounds=bounds,
    )
    return wp.jax_kernel(
        kernel,
        num_outputs=n_outputs,
        in_out_argnames=list(in_out),
        block_dim=n_threads,
    )
