"""The folder's functions of plain numbers, compiled by Warp as well.

Contact law, geometry and optics are written once, as functions that take and return numbers. On CPUs numba compiles
them, with 64-bit floats; on GPUs Warp does, with 32-bit floats.
"""

import atexit
import functools
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType, SimpleNamespace
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
    """Start Warp; its kernels are kept in its cache or, where nothing can be written there, until this process ends.

    Warp 1.18 would go on with a kernel whose structs were edited, so that each state of the sources has its own place.
    """
    wp.config.log_level = wp.LOG_WARNING  # standard output is reserved for results
    try:
        wp.init()
        own = Path(wp.config.kernel_cache_dir) / f"iswarm_mj-{version(SOURCES)}"
        own.mkdir(parents=True, exist_ok=True)
        wp.config.kernel_cache_dir, is_writable = str(own), os.access(own, os.W_OK)
    except OSError:
        is_writable = False
    if not is_writable:
        place = tempfile.TemporaryDirectory(prefix="warp-")
        atexit.register(place.cleanup)
        wp.config.kernel_cache_dir = place.name
        wp.init()


_start()
_RESIDENT = 512  # threads of a multiprocessor at once, which leave 128 registers to each


def in_warp(module: ModuleType) -> Any:
    """Return a module's functions of known kinds as Warp's, which call each other; named tuples become structs."""
    space = dict(vars(module))  # what the functions find under the names that they use
    for name, value in vars(module).items():
        if isinstance(value, type | FunctionType):
            if value.__module__ == module.__name__ and value not in _KINDS:
                made = _struct(value) if isinstance(value, type) else _function(value, space)
                _KINDS.update({} if made is None else {value: made})
            space[name] = _KINDS.get(value, value)
    return SimpleNamespace(**space)


def _struct(kind: type) -> Any:
    """A named tuple as a struct; None if there is a field of another kind."""
    fields = {name: _KINDS.get(field) for name, field in kind.__annotations__.items()}
    if not issubclass(kind, tuple) or None in fields.values():
        return None
    return wp.struct(type(kind.__name__, (), {"__annotations__": fields, "__module__": __name__}))


def _function(function: FunctionType, space: dict[str, Any]) -> Any:
    """A function that finds its names in `space`; None if there is an argument of another kind."""
    kinds = {name: _KINDS.get(kind) for name, kind in function.__annotations__.items() if name != "return"}
    if None in kinds.values():
        return None
    copy = FunctionType(function.__code__, space, function.__name__)
    returned = function.__annotations__["return"]  # tuples stay, as several results
    copy.__annotations__ = kinds | {"return": _KINDS[returned] if isinstance(returned, type) else returned}
    return wp.func(copy)


@wp.func
def _place_of(places: wp.array(dtype=wp.vec4), i: int) -> wp.vec4:
    """As `kinds.place_of`, read at once."""
    return places[i]


@wp.func
def _two_impulses(
    p1: float, p2: float, w1: float, w2: float, h11: float, h12: float, h22: float, is_two: bool
) -> tuple[float, float]:
    """As `contact_law.two_impulses`, without branches, in which the threads of a warp would wait for each other."""
    inverse, inverse1, inverse2 = 1.0 / (h11 * h22 - h12 * h12), 1.0 / h11, 1.0 / h22
    both1, both2 = p1 + (h12 * w2 - h22 * w1) * inverse, p2 + (h12 * w1 - h11 * w2) * inverse
    alone1, alone2 = wp.max(0.0, p1 - (w1 - h12 * p2) * inverse1), wp.max(0.0, p2 - (w2 - h12 * p1) * inverse2)
    are_both = is_two and both1 >= 0.0 and both2 >= 0.0
    is_first = not is_two or w2 + h12 * (alone1 - p1) - h22 * p2 >= 0.0
    q1 = wp.where(are_both, both1, wp.where(is_first, alone1, 0.0))
    q2 = wp.where(are_both, both2, wp.where(is_first, 0.0, alone2))
    return q1, q2


_KINDS: dict[Any, Any] = {kind: kind for kind in (float, int, bool)} | {
    kinds.Triple: wp.vec3,
    kinds.Place: wp.vec4,
    kinds.Places: wp.array(dtype=wp.vec4),
    kinds.Table: wp.array2d(dtype=float),
    kinds.Velocity: wp.vec4,
    kinds.Codes: wp.array2d(dtype=int),
    kinds.place_of: _place_of,
    contact_law.two_impulses: _two_impulses,
    contact_geometry.where: wp.where,
}
"""Of each kind of argument, named tuple and function so far: what it is in Warp."""
law = in_warp(contact_law)
geometry = in_warp(contact_geometry)
rays = in_warp(ray_geometry)
light = in_warp(reception)
arena = in_warp(plane)
_KINDS[kinds.Kinds] = wp.array(dtype=arena.Kind)
rows = in_warp(contact_rows)
view = in_warp(in_sight)
ContactLaw, Kind, Light, Plane, View = law.ContactLaw, arena.Kind, light.Light, arena.Plane, view.View


def words_of(*parameters: tuple) -> np.ndarray:
    """Numbers of named tuples as they lie in their structs, in words of 32 bits, which kernels of JAX take."""
    return np.array(list(map(tuple, parameters)), _KINDS[type(parameters[0])].numpy_dtype()).view(np.int32)


@wp.func
def plane_in(words: wp.array(dtype=int)):
    """(1,) the parameters in `words_of` a plane, to be read where they are needed, since registers are scarce."""
    return wp.array(ptr=words.ptr, shape=(1,), dtype=Plane)


@wp.func
def light_in(words: wp.array(dtype=int)):
    """(1,) likewise, of the light."""
    return wp.array(ptr=words.ptr, shape=(1,), dtype=Light)


@wp.func
def kinds_in(words: wp.array(dtype=int), n: int):
    """(n,) likewise, the kinds of bodies."""
    return wp.array(ptr=words.ptr, shape=(n,), dtype=Kind)


@functools.cache
def jax_kernel(function: Callable, is_fast: bool, n_threads: int | None, n_outputs: int, *in_out: str) -> Any:
    """Return a kernel as a function of JAX's arrays.

    Args:
        function: of the kernel.
        is_fast: divisions, roots and sines are rounded less exactly, as GPUs can.
        n_threads: of a block; None for Warp's choice.
        n_outputs: number of outputs, those that are changed in place included.
        in_out: names of the arguments that are changed in place.
    """
    bounds = None if n_threads is None else (n_threads, max(1, _RESIDENT // n_threads))
    options = {"fast_math": is_fast}
    kernel = wp.kernel(function, enable_backward=False, module="unique", module_options=options, launch_bounds=bounds)
    return wp.jax_kernel(kernel, num_outputs=n_outputs, in_out_argnames=list(in_out), block_dim=n_threads)
