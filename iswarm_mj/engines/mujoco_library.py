"""Functions of MuJoCo that its Python bindings leave out: shared library, timers, warnings."""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import mujoco

from iswarm_mj.utils.errors import UserError


@cache
def library() -> ctypes.CDLL:
    """Return the MuJoCo library that the Python bindings use.

    Raises:
        UserError: it is not where a wheel has it.
    """
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            return ctypes.CDLL(str(path))
    raise UserError(f"No MuJoCo library in {folder}; reinstall the package mujoco from a wheel.")


def function_address(function: str) -> int:
    """Return the address of a function of the MuJoCo library."""
    return address_of(library(), function)


def address_of(shared_library: ctypes.CDLL, function: str) -> int:
    """Return the address of a function of a library that is loaded."""
    pointer = ctypes.cast(getattr(shared_library, function), ctypes.c_void_p)
    return pointer.value or 0


@contextmanager
def without_timers() -> Iterator[None]:
    """Leave `MjData.timer` at zero within the block, in all threads; physics is the same.

    A step of a small model is a third faster. The clock is MuJoCo's global callback `mjcb_time`,
    which its Python bindings install and cannot put back themselves.
    """
    clock = ctypes.c_void_p.in_dll(library(), "mjcb_time")
    callback = clock.value
    clock.value = None
    try:
        yield
    finally:
        clock.value = clock.value or callback


def keep_no_log() -> None:
    """Keep MuJoCo from writing warnings to MUJOCO_LOG.TXT, unless a handler is already set.

    Engines report as faults what the warnings are about.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_ignore)


def _ignore(_: str) -> None:
    """Ignore a warning."""
