"""Strategies, and other objects of users, as pytrees of JAX, made of plain dataclasses."""

from dataclasses import Field, fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.strategy.base import Strategy, StrategyFactory, overrides
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import check_class


def check_methods(given: Any) -> None:
    """Check that a strategy, or a class of strategies or of what makes them, has the methods of its
    base class.

    Raises:
        UserError: it derives from no base class, lacks a method, or says something without
            declaring its fields.
    """
    cls = _class(given)
    if issubclass(cls, StrategyFactory) and not issubclass(cls, Strategy):
        check_class(cls, StrategyFactory, "what makes strategies")
        return
    check_class(cls, Strategy, "a strategy")
    declares = "payload" in dir(given)
    if overrides(cls, Strategy, "say") and not declares:
        raise UserError(
            f"{cls.__name__} has a method say, but no attribute payload; declare what it says, as "
            'payload = {"count": Integer(bits=4)} with iswarm_mj.Integer'
        )
    if declares and not overrides(cls, Strategy, "say"):
        raise UserError(
            f"{cls.__name__} has an attribute payload, but no method say; write one, see Strategy.say"
        )


def as_strategy(given: Any) -> Any:
    """Return a strategy that JAX can handle, see `as_pytree`.

    Raises:
        UserError: it lacks a method, is a class, or cannot be made a pytree.
    """
    check_methods(given)
    return as_pytree(given, "strategy")


def as_pytree(given: Any, what: str) -> Any:
    """Return an object that JAX can handle: its class is made a pytree if it is none.

    Fields of dataclasses are arrays, which may differ from world to world, unless their type is
    bool, int, str, an enumeration, a path, a `Literal` or a tuple of these: such fields are
    compiled in, as are those with the metadata `static`. A class without fields needs nothing.

    Args:
        given: by the user.
        what: it is, as "strategy".

    Raises:
        UserError: it is a class, or cannot be made a pytree.
    """
    name = _class(given).__name__
    if isinstance(given, type):
        raise UserError(f"{what} is the class {name} itself; give an object of it, as {name}()")
    if not jax.tree_util.all_leaves([given]):
        return given
    if not is_dataclass(given) and getattr(given, "__dict__", None):
        raise UserError(
            f"{name} has attributes ({', '.join(vars(given))}) but is not a dataclass; write @dataclass above "
            "the class and declare them as fields, or make it a pytree by jax.tree_util.register_pytree_node"
        )
    for field in _register(type(given)):
        try:
            hash(getattr(given, field))
        except TypeError:
            kind = type(getattr(given, field)).__name__
            raise UserError(
                f"{name}.{field} is compiled in and must not change, but is a {kind}; use a tuple"
            ) from None
    return given


def as_arrays(given: Any, what: str) -> Any:
    """Return an object that JAX can handle with all its numbers as arrays.

    Args:
        given: see `as_pytree`.
        what: it is, as "task Cleaning".

    Raises:
        UserError: it holds something else.
    """
    for leaf in jax.tree.leaves(given):
        if not is_number(leaf):
            raise UserError(
                f"{what} holds a {type(leaf).__name__} where JAX expects an array; make what is no array static, by "
                'field(metadata={"static": True}), or its class a pytree by jax.tree_util.register_dataclass'
            )
    # With types named, or numbers without one of their own would make another program.
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(leaf)), given)


def is_number(leaf: Any) -> bool:
    """Return whether JAX takes something for an array of numbers, which random keys are not."""
    is_key = isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    return isinstance(leaf, jax.Array | np.ndarray | np.generic | bool | int | float) and not is_key


@cache
def _register(cls: type) -> tuple[str, ...]:
    """Make a pytree of a class, and return its fields that are compiled in.

    JAX rebuilds its objects without `__init__`, whose checks need numbers.
    """
    own = fields(cls) if is_dataclass(cls) else ()
    static = tuple(f.name for f in own if is_static_field(cls, f))
    dynamic = tuple(f.name for f in own if f.name not in static)

    def flatten(given: Any) -> tuple[Any, ...]:
        children = [(jax.tree_util.GetAttrKey(name), getattr(given, name)) for name in dynamic]
        return children, tuple(getattr(given, name) for name in static)

    def unflatten(rest: tuple[Any, ...], children: Any) -> Any:
        made = object.__new__(cls)
        for name, value in zip(static + dynamic, (*rest, *children), strict=True):
            object.__setattr__(made, name, value)
        return made

    jax.tree_util.register_pytree_with_keys(cls, flatten, unflatten)
    return static


def is_static_field(cls: type, field: Field) -> bool:
    """Return whether values of a field are compiled in."""
    if field.name in ("recorded", "payload"):
        return True
    if "static" in field.metadata:
        return bool(field.metadata["static"])
    try:
        return _is_static(get_type_hints(cls)[field.name])
    except (NameError, TypeError):  # a name that only type checkers know
        return False


def _is_static(kind: Any) -> bool:
    """Whether values of this type are compiled in."""
    if isinstance(kind, type):
        return kind in (bool, int, str, bytes, NoneType) or issubclass(kind, Enum | Path)
    parts = [part for part in get_args(kind) if part is not Ellipsis]
    is_plain = get_origin(kind) not in (list, dict) and all(map(_is_static, parts))
    return get_origin(kind) is Literal or (bool(parts) and is_plain)


def _class(given: Any) -> type:
    return given if isinstance(given, type) else type(given)
