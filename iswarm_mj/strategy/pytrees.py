"""Strategies, and other objects of users, as pytrees of JAX, made of plain dataclasses."""

from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import jax

from iswarm_mj.utils.errors import UserError

_STATIC = (bool, int, str, bytes, NoneType)
_METHODS = ("init", "picks", "act")


def check_methods(given: Any) -> None:
    """Check that a strategy, or a class of strategies, has the methods of `strategy.protocol.Strategy`.

    A class with a method `for_world` makes strategies, and need not be one.

    Raises:
        UserError: one is missing.
    """
    if hasattr(given, "for_world"):
        return
    names = ("say", *_METHODS) if "payload" in dir(given) else _METHODS
    missing = [method for method in names if not callable(getattr(given, method, None))]
    if missing:
        raise UserError(
            f"{_name(given)} has no method {' and no method '.join(missing)}; a strategy has {', '.join(names)}, "
            "see iswarm_mj.strategy.protocol.Strategy"
        )
    if hasattr(given, "say") and "payload" not in dir(given):
        raise UserError(
            f"{_name(given)} has a method say, but no attribute payload; declare what it says, as "
            'payload = {"count": Integer(bits=4)} with iswarm_mj.sensors.fields'
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

    Fields of dataclasses are arrays, which may differ from world to world, unless their type is bool, int, str, an
    enumeration, a path, a `Literal` or a tuple of these: such fields are compiled in, as are those with the metadata
    `static`. A class without fields needs nothing.

    Args:
        given: by the user.
        what: it is, as "strategy".

    Raises:
        UserError: it is a class, or cannot be made a pytree.
    """
    name = _name(given)
    if isinstance(given, type):
        raise UserError(f"{what} is the class {name} itself; give an object of it, as {name}()")
    if not jax.tree_util.all_leaves([given]):
        return given
    if not is_dataclass(given) and getattr(given, "__dict__", None):
        raise UserError(
            f"{name} has attributes ({', '.join(vars(given))}) but is not a dataclass; write @dataclass above "
            "the class and declare them as fields, or make it a pytree by jax.tree_util.register_pytree_node"
        )
    _register(type(given))
    for f in fields(given) if is_dataclass(given) else ():
        if _is_static_field(type(given), f):
            _check_hash(name, f.name, getattr(given, f.name))
    return given


@cache
def _register(cls: type) -> None:
    """Make a pytree of a class; its objects are made anew without `__init__`, whose checks need numbers."""
    own = fields(cls) if is_dataclass(cls) else ()
    static = [f.name for f in own if _is_static_field(cls, f)]
    dynamic = [f.name for f in own if f.name not in static]

    def flatten(given: Any) -> tuple[list[Any], tuple[Any, ...]]:
        return [getattr(given, name) for name in dynamic], tuple(getattr(given, name) for name in static)

    def with_keys(given: Any) -> tuple[list[Any], tuple[Any, ...]]:
        children, rest = flatten(given)
        return [(jax.tree_util.GetAttrKey(n), child) for n, child in zip(dynamic, children, strict=True)], rest

    def unflatten(rest: tuple[Any, ...], children: Any) -> Any:
        made = object.__new__(cls)
        for name, value in (*zip(static, rest, strict=True), *zip(dynamic, children, strict=True)):
            object.__setattr__(made, name, value)
        return made

    jax.tree_util.register_pytree_with_keys(cls, with_keys, unflatten, flatten)


def _is_static_field(cls: type, field: Any) -> bool:
    if field.name in ("recorded", "payload"):
        return True
    if "static" in field.metadata:
        return bool(field.metadata["static"])
    try:
        kind = get_type_hints(cls)[field.name]
    except (NameError, TypeError):  # a name that only type checkers know
        return False
    return _is_static(kind)


def _is_static(kind: Any) -> bool:
    """Whether values of this type are compiled in."""
    if kind in _STATIC or get_origin(kind) is Literal:
        return True
    if isinstance(kind, type) and issubclass(kind, Enum | Path):
        return True
    parts = [part for part in get_args(kind) if part is not Ellipsis]
    return bool(parts) and get_origin(kind) not in (list, dict) and all(map(_is_static, parts))


def _check_hash(name: str, field: str, value: Any) -> None:
    try:
        hash(value)
    except TypeError:
        raise UserError(
            f"{name}.{field} is compiled in and must not change, but is a {type(value).__name__}; use a tuple"
        ) from None


def _name(given: Any) -> str:
    return given.__name__ if isinstance(given, type) else type(given).__name__
