"""The folder's functions of plain numbers, compiled by Warp as well.

Contact law, geometry and optics are written once, as functions that take and return numbers. On CPUs numba compiles
them, with 64-bit floats; on GPUs Warp does, with 32-bit floats.
"""

import atexit
import functools
import os
import tempfile
import typing
from collections.abc import Callable
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import warp as wp

from iswarm_mj.engines.planar import contact_geometry, contact_law, ray_geometry, reception


def _start() -> None:
    """Start Warp; its kernels are kept in its cache or, where nothing can be written there, until this process ends."""
    wp.config.log_level = wp.LOG_WARNING  # standard output is reserved for results
    try:
        wp.init()
        is_writable = os.access(wp.config.kernel_cache_dir, os.W_OK)
    except OSError:
        is_writable = False
    if not is_writable:
        place = tempfile.TemporaryDirectory(prefix="warp-")
        atexit.register(place.cleanup)
        wp.config.kernel_cache_dir = place.name
        wp.init()


_start()
_NUMBERS = (float, int, bool)
_RESIDENT = 512  # threads of a multiprocessor at once, which leave 128 registers to each


def in_warp(module: ModuleType) -> Any:
    """Return a module's own functions of numbers as Warp's, which call each other; named tuples become structs."""
    names, own = vars(module), {kind: kind for kind in _NUMBERS}
    space = dict(names)  # what the functions find under the names that they use
    for name, value in names.items():
        if isinstance(value, type) and issubclass(value, tuple) and value.__module__ == module.__name__:
            fields = typing.get_type_hints(value)
            if set(fields.values()) <= set(_NUMBERS):
                own[value] = wp.struct(type(name, (), {"__annotations__": fields, "__module__": __name__}))
    for name, value in names.items():
        if isinstance(value, FunctionType) and value.__module__ == module.__name__:
            kinds = {key: own.get(kind) for key, kind in value.__annotations__.items() if key != "return"}
            if None not in kinds.values():
                copy = FunctionType(value.__code__, space, name)
                copy.__annotations__ = kinds | {"return": value.__annotations__["return"]}
                space[name] = own[value] = wp.func(copy)
    return SimpleNamespace(**{original.__name__: compiled for original, compiled in own.items()})


geometry = in_warp(contact_geometry)
law = in_warp(contact_law)
rays = in_warp(ray_geometry)
light = in_warp(reception)
ContactLaw = law.ContactLaw


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
