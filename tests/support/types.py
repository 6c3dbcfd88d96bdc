"""The type checker of the tests."""

from collections import Counter
from functools import wraps

from beartype import BeartypeConf, beartype

CALLS = 3
"""Calls of a function with arguments and a result of the same types and shapes that are checked in
each test."""
_calls = Counter()
_is_pep484_tower = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""An int is a float, as PEP 484 says."""


def check(function):
    """Check a function where types or shapes are new to the test; it is prepared for that when it
    is first called.

    A run calls some functions at every control step, with the same ones. Results are checked like a
    further argument.
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
    """Type of an argument; of arrays also the shape and the type of the elements."""
    return type(value), getattr(value, "shape", None), getattr(value, "dtype", None)


def begin_test():
    """Count anew."""
    _calls.clear()
