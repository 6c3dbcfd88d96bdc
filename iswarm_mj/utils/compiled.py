"""Compilation by numba of functions that Python or C calls."""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.core import config


@cache
def version(sources: Path) -> str:
    """Return a name for the present state of the Python files in a folder."""
    text = b"".join(path.read_bytes() for path in sorted(sources.rglob("*.py")))
    return hashlib.sha256(text).hexdigest()[:16]


def cached(
    function: Callable, sources: Path | None = None, compiler: Callable[..., Any] = numba.njit, **options: Any
) -> Any:
    """Compile a function once for all processes; where no directory for that can be written to, in each process.

    Args:
        function: to be compiled, by `njit` when it is first called.
        sources: folder in which the functions are that it calls. Numba looks for changes in the function's own file
            only, and would go on with a program whose callees were edited; so each state of the folder has its own
            place in the user's cache.
        compiler: a decorator of numba.
        options: of the compiler.
    """
    before = config.CACHE_DIR
    if sources is not None:
        place = platformdirs.user_cache_path("iswarm_mj", appauthor=False) / "numba" / version(sources)
        config.CACHE_DIR = str(place)
    try:
        return compiler(cache=True, **options)(function)
    except RuntimeError:  # numba's, of a package that is read-only and a home that cannot be used
        return compiler(**options)(function)
    finally:
        config.CACHE_DIR = before
