"""The shared library of MuJoCo that the Python bindings use."""

import ctypes
from functools import cache
from pathlib import Path

import mujoco

from iswarm_mj.utils.errors import UserError


@cache
def library() -> ctypes.CDLL:
    """The MuJoCo library that the Python bindings use."""
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            return ctypes.CDLL(str(path))
    raise UserError(f"No MuJoCo library in {folder}; reinstall the package mujoco from a wheel.")


def function_address(function: str) -> int:
    """Address of a function of the MuJoCo library."""
    return ctypes.cast(getattr(library(), function), ctypes.c_void_p).value or 0
