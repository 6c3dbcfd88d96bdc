"""Functions of MuJoCo that its Python bindings leave out: shared library, timers, warnings."""

import ctypes
import sys
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
        UserError: it is neither where a wheel has it, nor where conda has it.
    """
    environment = Path(sys.prefix)
    of_wheel = Path(mujoco.__file__).parent
    of_conda = (environment / "lib", environment / "Library" / "bin")
    for folder in (of_wheel, *of_conda):
        for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
            for path in sorted(folder.glob(pattern)):
                return ctypes.CDLL(str(path))
    raise UserError(f"No MuJoCo library in {of_wheel}; reinstall the package mujoco from a wheel.")


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
