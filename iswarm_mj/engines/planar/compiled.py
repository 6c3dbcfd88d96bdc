"""Compilation of this folder's functions by numba."""

from functools import partial
from pathlib import Path
from typing import Any

import numba

from iswarm_mj.utils import compiled as compilation

compiled = numba.njit(nogil=True)
"""For functions that other compiled functions call."""

uncounted: Any = numba.njit(nogil=True, _nrt=False)  # pyright: ignore[reportCallIssue]
"""For those that allocate nothing and return no arrays. Without this option of numba, which refuses others, each use of
an array in a tuple counts its owners, and that takes most of the time of light."""

inlined = numba.njit(nogil=True, forceinline=True)
"""For those that are called so often that handing over their arguments, tuples of arrays and numbers, would show."""

SOURCES = Path(__file__).parents[1]
"""Folder of the engines."""

cached = partial(compilation.cached, sources=SOURCES, nogil=True)
"""For those that Python calls."""
