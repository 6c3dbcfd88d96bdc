"""The type checker of the tests."""

from collections import Counter
from functools import wraps

from beartype import BeartypeConf, beartype

CALLS = 20
"""Calls of a function that are checked in each test: a run calls some at every control step."""
_calls = Counter()
_is_pep484_tower = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""An int is a float, as PEP 484 says."""


def check(function):
    """Check the first calls of a function in each test; it is prepared for that when it is first called."""
    checked = None

    @wraps(function)
    def check_first(*args, **kwargs):
        nonlocal checked
        _calls[check_first] += 1
        if _calls[check_first] > CALLS:
            return None
        checked = checked or _is_pep484_tower(function)
        return checked(*args, **kwargs)

    return check_first


def begin_test():
    """Count anew."""
    _calls.clear()
