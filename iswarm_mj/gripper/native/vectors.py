"""Vectors of three numbers in functions that numba compiles: tuples, which stay in registers."""

from math import sqrt

from iswarm_mj.gripper.native.abi import compiled


@compiled
def vector_at(numbers, index):
    """Return the vector with this index in a pointer to consecutive vectors."""
    first = 3 * index
    return numbers[first], numbers[first + 1], numbers[first + 2]


@compiled
def dot(a, b):
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def norm(a):
    """Return the length of a vector."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@compiled
def scaled(factor, a):
    """Return a vector times a number."""
    return factor * a[0], factor * a[1], factor * a[2]


@compiled
def plus(a, b):
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def minus(a, b):
    """Return the difference of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def cross(a, b):
    """Return the vector product of two vectors."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )
