"""Decorators by which numba compiles this package's functions.

Compiling takes most of a first start, and about as long for each function, however short. A
function is compiled again for each type of its arguments, of which each constant is one; functions
of `kinds.shared` and of NumPy also for callers with other options. So functions that only others
call get no wrappers for Python and C, most have the same options, and arrays come from `np.empty`
alone.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np

from iswarm_mj.utils import compiled as compilation

_WITHOUT_WRAPPERS: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of functions that other compiled functions call, and nothing else."""

compiled = numba.njit(**_WITHOUT_WRAPPERS)
"""Compile a function that other compiled functions call."""

uncounted: Any = numba.njit(_nrt=False, **_WITHOUT_WRAPPERS)  # pyright: ignore[reportCallIssue]
"""Compile a function that allocates nothing and returns no arrays.

Without this option of numba, each use of an array in a tuple counts its owners, which takes most
of the time of light."""

inlined: Any = numba.njit(  # pyright: ignore[reportCallIssue]
    _nrt=False, forceinline=True, **_WITHOUT_WRAPPERS
)
"""Compile a function as `uncounted` does that is called so often that passing its arguments would
take time, or in one place only."""

SOURCES = Path(__file__).parents[1]
"""Folder of the engines."""

cached = partial(compilation.cached, sources=SOURCES, nogil=True)
"""Compile a function that Python calls, once for all processes."""


@compiled
def missing_indices(n: int) -> np.ndarray:
    """Return an array (N,) of -1."""
    indices = np.empty(n, np.int64)
    for k in range(n):
        indices[k] = -1
    return indices
