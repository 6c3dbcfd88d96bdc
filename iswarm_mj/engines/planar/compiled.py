"""Compilation of this folder's functions by numba."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.core import config

from iswarm_mj.utils import compiled as compilation

compiled = numba.njit(nogil=True)
"""For functions that other compiled functions call."""

uncounted: Any = numba.njit(nogil=True, _nrt=False)  # pyright: ignore[reportCallIssue]
"""For those that allocate nothing and return no arrays. Without this option of numba, which refuses others, each use of
an array in a tuple counts its owners, and that takes most of the time of light."""

inlined = numba.njit(nogil=True, forceinline=True)
"""For those that are called so often that handing over their arguments, tuples of arrays and numbers, would show."""


def version() -> str:
    """Return a name for the present state of the engines' sources."""
    sources = b"".join(path.read_bytes() for path in sorted(Path(__file__).parents[1].rglob("*.py")))
    return hashlib.sha256(sources).hexdigest()[:16]


def cached(function: Callable) -> Any:
    """Compile a function that Python calls, once for all processes.

    Numba looks for changes in the function's own file only, and would go on with a program whose callees were edited.
    Here each state of the engines has its own place in the user's cache.
    """
    place = platformdirs.user_cache_path("iswarm_mj", appauthor=False) / "numba" / version()
    before = config.CACHE_DIR
    config.CACHE_DIR = str(place)
    try:
        return compilation.cached(function, nogil=True)
    finally:
        config.CACHE_DIR = before
