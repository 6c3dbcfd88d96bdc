"""Compilation by numba of functions that Python calls."""

from collections.abc import Callable
from typing import Any

import numba


def cached(function: Callable, **options: Any) -> Any:
    """Compile a function once for all processes; where no directory for that can be written to, in each process.

    Args:
        function: to be compiled when it is first called.
        options: of `numba.njit`.
    """
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba's, of a package that is read-only and a home that cannot be used
        return numba.njit(**options)(function)
