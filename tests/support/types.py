"""The type checker of the tests: beartype, where types or shapes are new to a test."""

from collections import Counter
from functools import wraps

from beartype import BeartypeConf, beartype

CALLS = 3
"""Calls of a function with the same types and shapes that are checked in each test."""
_calls = Counter()
_is_pep484_tower = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""An int is a float, as PEP 484 says."""


def check(function):
    """Return a function that checks its arguments where their types or shapes are new to the test.

    A run calls some functions at every control step, with the same types. Results are checked like
    a further argument. Beartype prepares the function when it is first called.
    """
    checked = None

    @wraps(function)
    def check_new(*args, **kwargs):
        nonlocal checked
        call = check_new, *map(kind, args), *map(kind, kwargs.values())
        _calls[call] += 1
        if _calls[call] > CALLS:
            return None
        checked = checked or _is_pep484_tower(function)
        return checked(*args, **kwargs)

    return check_new


def kind(value):
    """Return the type of an argument; for arrays also the shape and the type of the elements."""
    return type(value), getattr(value, "shape", None), getattr(value, "dtype", None)


def begin_test():
    """Count the calls of the next test from zero."""
    _calls.clear()
