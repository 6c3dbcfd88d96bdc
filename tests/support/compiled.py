"""Compiled functions that only other compiled functions call."""

import numba


def for_python(function):
    """Return a function that calls a compiled one, which has no wrapper for Python itself."""

    @numba.njit
    def call(*arguments):
        return function(*arguments)

    return call
