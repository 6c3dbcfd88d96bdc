"""Functions of numbers that numba compiles, JAX traces and NumPy broadcasts, from one source.

A module of such functions imports `exp`, `log2` and `sqrt` from `math`, and `where`, `clip` and `whole` from here, and
has no branches. `numbers_of` gives its functions the same names of another library.
"""

import sys
from collections.abc import Callable, Mapping
from functools import cache
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any


def where(condition: Any, yes: Any, no: Any) -> Any:
    """`yes` if the condition holds, otherwise `no`; both are evaluated."""
    return yes if condition else no


def clip(value: Any, low: Any, high: Any) -> Any:
    """The nearest number between two limits."""
    return min(max(value, low), high)


def whole(value: Any) -> Any:
    """A number of at least 0 without its fraction, an integer."""
    return int(value)


def numbers_of(module: ModuleType, names: Mapping[str, Any], wrap: Callable[[Any], Any] = lambda f: f) -> Any:
    """A module's functions with other meanings of some names.

    Args:
        module: of functions of numbers, which call each other and laws.
        names: of the module, with what they mean instead.
        wrap: compiles a function.
    """
    space = {**vars(module), **names}
    for name, function in vars(module).items():
        if isinstance(function, FunctionType) and name not in names:
            own = function.__module__ == module.__name__
            space[name] = wrap(FunctionType(function.__code__, space, name) if own else function)
    return SimpleNamespace(**space)


def in_arrays(module: ModuleType, library: ModuleType) -> Any:
    """A module's functions for arrays of NumPy or of JAX."""
    return _in_arrays(module.__name__, library.__name__)


@cache
def _in_arrays(module: str, library: str) -> Any:
    xp = sys.modules[library]
    names = {name: getattr(xp, name) for name in ("where", "clip", "exp", "log", "log2", "sqrt", "abs")}
    names |= {"min": xp.minimum, "max": xp.maximum}
    return numbers_of(sys.modules[module], names | {"whole": lambda value: xp.floor(value).astype(int)})
