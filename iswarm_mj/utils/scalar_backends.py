"""Functions of numbers that numba compiles, JAX traces and NumPy broadcasts, from one source.

A module of such functions imports `exp`, `log2` and `sqrt` from `math`, and `where`, `clip` and
`whole` from here, and has no branches. `numbers_of` gives its functions the same names of another
library.
"""

import sys
from collections.abc import Callable, Mapping
from functools import cache
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any


def where(condition: Any, yes: Any, no: Any) -> Any:
    """Return `yes` if the condition holds, otherwise `no`; both are evaluated."""
    return yes if condition else no


def clip(value: Any, low: Any, high: Any) -> Any:
    """Return the nearest number between two limits."""
    return min(max(value, low), high)


def whole(value: Any) -> Any:
    """Return a number of at least 0 without its fraction, as an integer."""
    return int(value)


def numbers_of(
    module: ModuleType, names: Mapping[str, Any], wrap: Callable[[Any], Any] = lambda f: f
) -> Any:
    """Return the functions of a module with other meanings of some names.

    Args:
        module: of functions of numbers, which call each other and laws.
        names: of the module, with what they mean instead.
        wrap: compiles a function.
    """
    namespace = {**vars(module), **names}
    for name, function in vars(module).items():
        if not isinstance(function, FunctionType) or name in names:
            continue
        if function.__module__ == module.__name__:  # its names are looked up in the namespace
            function = FunctionType(function.__code__, namespace, name)
        namespace[name] = wrap(function)
    return SimpleNamespace(**namespace)


def in_arrays(module: ModuleType, library: ModuleType) -> Any:
    """Return the functions of a module for arrays of NumPy or of JAX."""
    return _in_arrays(module.__name__, library.__name__)


@cache
def _in_arrays(module: str, library: str) -> Any:
    """Return the functions of a module for arrays, see `in_arrays`; by names, which are
    hashable."""
    xp = sys.modules[library]
    same = ("where", "clip", "exp", "log", "log2", "sqrt", "abs")
    names = {name: getattr(xp, name) for name in same}
    names |= {
        "min": xp.minimum,
        "max": xp.maximum,
        "whole": lambda value: xp.floor(value).astype(int),
    }
    return numbers_of(sys.modules[module], names)
