"""Decorators by which numba compiles this package's functions."""

from functools import partial
from pathlib import Path
from typing import Any

import numba

from iswarm_mj.utils import compiled as compilation

compiled = numba.njit(nogil=True)
"""Compile a function that other compiled functions call."""

uncounted: Any = numba.njit(nogil=True, _nrt=False)  # pyright: ignore[reportCallIssue]
"""Compile a function that allocates nothing and returns no arrays.

Without this option of numba, each use of an array in a tuple counts its owners, which takes most
of the time of light."""

inlined = numba.njit(nogil=True, forceinline=True)
"""Compile a function that is called so often that passing its arguments would take time."""

SOURCES = Path(__file__).parents[1]
"""Folder of the engines."""

cached = partial(compilation.cached, sources=SOURCES, nogil=True)
"""Compile a function that Python calls, once for all processes."""
