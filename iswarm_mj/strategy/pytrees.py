"""Objects of users, such as strategies, as pytrees of JAX, made of plain dataclasses."""

from dataclasses import Field, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.utils.errors import UserError


def as_pytree(given: Any, what: str) -> Any:
    """Return an object that JAX can handle: its class is made a pytree if it is none.

    Fields of dataclasses are arrays, which may differ from world to world, unless their type is
    bool, int, str, an enumeration, a path, a `Literal` or a tuple of these: such fields are
    compiled in, as are those with the metadata `static`. A class without fields needs nothing.

    Args:
        given: object of a user.
        what: word for the object, as "strategy".

    Raises:
        UserError: it is a class, or cannot be made a pytree.
    """
    refuse_class(given, what)
    is_pytree = not jax.tree_util.all_leaves([given])
    if is_pytree:
        return given

    name = type(given).__name__
    if not is_dataclass(given) and getattr(given, "__dict__", None):
        attributes = ", ".join(vars(given))
        raise UserError(
            f"{name} has attributes ({attributes}) but is not a dataclass; write @dataclass above "
            "the class and declare them as fields, or make it a pytree by "
            "jax.tree_util.register_pytree_node"
        )
    for field in _register(type(given)):
        value = getattr(given, field)
        try:
            hash(value)
        except TypeError:
            kind = type(value).__name__
            raise UserError(
                f"{name}.{field} is compiled in and must not change, but is a {kind}; use a tuple"
            ) from None
    return given


def refuse_class(given: Any, what: str) -> None:
    """Raise a UserError for a class in place of an object, whose name is `what`."""
    if isinstance(given, type):
        name = given.__name__
        raise UserError(f"{what} is the class {name} itself; give an object of it, as {name}()")


def as_arrays(given: Any, what: str) -> Any:
    """Return an object that JAX can handle with all its numbers as arrays.

    Args:
        given: object as `as_pytree` returns it.
        what: words for the object, as "task Cleaning".

    Raises:
        UserError: it holds something else.
    """
    for leaf in jax.tree.leaves(given):
        if not is_number(leaf):
            raise UserError(
                f"{what} holds a {type(leaf).__name__} where JAX expects an array; make what is no "
                'array static, by field(metadata={"static": True}), or its class a pytree by '
                "jax.tree_util.register_dataclass"
            )
    # JAX compiles another program for numbers without a type of their own, so all get one.
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(leaf)), given)


def is_number(leaf: Any) -> bool:
    """Return whether JAX can make an array of numbers of a leaf; random keys are none."""
    is_key = isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    return isinstance(leaf, jax.Array | np.ndarray | np.generic | bool | int | float) and not is_key


@cache
def _register(cls: type) -> tuple[str, ...]:
    """Make a pytree of a class, and return its fields that are compiled in.

    It is cached since JAX raises an error where a class is registered twice.

    Args:
        cls: a dataclass, or a class whose objects have no attributes (`as_pytree` refuses others):
            JAX rebuilds objects of their fields alone.
    """
    # A class that is no dataclass has objects without any state.
    all_fields = fields(cls) if is_dataclass(cls) else ()
    static = tuple(field.name for field in all_fields if is_static_field(cls, field))
    dynamic = tuple(field.name for field in all_fields if field.name not in static)

    def flatten(value: Any) -> tuple[Any, ...]:
        children = [(jax.tree_util.GetAttrKey(name), getattr(value, name)) for name in dynamic]
        return children, tuple(getattr(value, name) for name in static)

    def unflatten(static_values: tuple[Any, ...], children: Any) -> Any:
        # Without `__init__`, whose checks need numbers: JAX puts tracers in their place.
        value = object.__new__(cls)
        for name, part in zip(static + dynamic, (*static_values, *children), strict=True):
            object.__setattr__(value, name, part)  # also in frozen dataclasses
        return value

    jax.tree_util.register_pytree_with_keys(cls, flatten, unflatten)
    return static


def is_static_field(cls: type, field: Field) -> bool:
    """Return whether values of a field of a dataclass are compiled in."""
    if field.name in ("recorded", "payload"):
        return True
    if "static" in field.metadata:
        return bool(field.metadata["static"])
    try:
        return _is_static(get_type_hints(cls)[field.name])
    except (NameError, TypeError):  # a name that only type checkers know
        return False


def _is_static(kind: Any) -> bool:
    """Return whether values of a type are compiled in: all but floats, arrays, lists and others."""
    if isinstance(kind, type):
        return kind in (bool, int, str, bytes, NoneType) or issubclass(kind, Enum | Path)

    origin = get_origin(kind)
    if origin is Literal:
        return True
    if origin in (list, dict):
        return False
    parts = [part for part in get_args(kind) if part is not Ellipsis]
    return len(parts) > 0 and all(map(_is_static, parts))
