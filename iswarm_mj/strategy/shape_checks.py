"""Checks of what users write against base classes: methods, and shapes and types of what these
return."""

from collections.abc import Collection, Sequence
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.utils.errors import UserError, shown

_TYPES = {Bool: jnp.bool_, Float: jnp.float32, Int: jnp.int32, UInt32: jnp.uint32}


def check_base(given: Any, base: type, what: str) -> None:
    """Check that an object or a class of a user derives from a base class and defines what it must.

    Args:
        given: by the user.
        base: that it must derive from, as `Task`.
        what: it is to be, with its article, as "a task".

    Raises:
        UserError: it does not derive from the class, lacks a method, or has one whose name is
            nearly that of another.
    """
    cls = given if isinstance(given, type) else type(given)
    name = cls.__name__
    if not issubclass(cls, base):
        raise UserError(
            f"{name} is not {what}, since it does not derive from {base.__name__}; write class "
            f"{name}({base.__name__}), with from iswarm_mj import {base.__name__}"
        )

    public = [method for method in dir(base) if not method.startswith("_")]
    abstract = getattr(cls, "__abstractmethods__", frozenset())
    missing = [
        method
        for method in public
        if method in abstract
        or (callable(getattr(base, method)) and not callable(getattr(cls, method)))
    ]
    if missing:
        raise UserError(
            f"{name} has no method {' and no method '.join(missing)}; {what} has it, see {base.__name__}"
        )
    _check_spelling(cls, base, public)


def _check_spelling(cls: type, base: type, public: Sequence[str]) -> None:
    """Refuse attributes of users' classes whose names are nearly those of attributes that they
    inherit.

    Args:
        cls: class of a user.
        base: class of this package that documents the methods.
        public: names of the attributes of the base.

    Raises:
        UserError: there is such an attribute.
    """
    known = {*public, *getattr(base, "ATTRIBUTES", ())}
    field_names = {field.name for field in fields(cls)} if is_dataclass(cls) else set()
    for parent in cls.__mro__:
        is_users_class = issubclass(parent, base) and not is_shipped(parent)
        if not is_users_class:
            continue
        own_names = set(vars(parent))
        inherited = sorted(known - own_names)
        for name in sorted(own_names - known - field_names):
            nearest = get_close_matches(name, inherited, n=1, cutoff=0.8)
            if nearest and not name.startswith("_"):
                raise UserError(
                    f"{cls.__name__}.{name} is never used: {base.__name__} has {nearest[0]}, but no {name}; rename it, "
                    f"or call a helper of your own _{name}"
                )


def is_shipped(cls: type) -> bool:
    """Return whether a class is one of this package, and not of a user."""
    return cls.__module__.split(".")[0] == "iswarm_mj"


def shapes_of(cls: Any, **sizes: int | tuple[int, ...]) -> dict[str, Any]:
    """Return the shapes and types that the annotations of a named tuple declare, as `Float[Array,
    "*B N 2"]`.

    Args:
        cls: the named tuple; fields with other annotations are left out.
        sizes: of its axes by their names; of several axes with a star, a tuple.
    """

    def shape(axes: str) -> list[int]:
        found: list[int] = []
        for axis in axes.split():
            size = sizes[axis.lstrip("*")] if axis.lstrip("*") in sizes else int(axis)
            found += size if isinstance(size, tuple) else [size]
        return found

    return {
        name: jax.ShapeDtypeStruct(shape(kind.dim_str), _TYPES[kind.dtype])
        for name, kind in cls.__annotations__.items()
        if hasattr(kind, "dim_str")
    }


def zeros_of(cls: Any, **sizes: int | tuple[int, ...]) -> dict[str, np.ndarray]:
    """Return NumPy arrays of zeros with the shapes and types that `shapes_of` returns."""
    return {name: np.zeros(its.shape, its.dtype) for name, its in shapes_of(cls, **sizes).items()}


def compare(method: str, given: Any, wanted: Any, what: str = "result") -> None:
    """Raise a UserError unless what a method returned has the structure, shapes and types of what
    it should.

    Args:
        method: its name.
        given: arrays, or their shapes and types.
        wanted: shapes and types, or arrays.
        what: is compared; a `memory` and `bodies` are to stay as they were.
    """
    same = " as it was given" if what in ("memory", "bodies") else ""
    if jax.tree.structure(given) != jax.tree.structure(wanted):
        raise UserError(
            f"{method} must return {_named(wanted)} as its {what}{same} (got {_named(given)})"
            f"{_differing(given, wanted)}; return the same type with the same parts"
        )
    for (path, mine), its in zip(
        jax.tree_util.tree_leaves_with_path(given), jax.tree.leaves(wanted), strict=True
    ):
        shape, kind = getattr(mine, "shape", None), getattr(mine, "dtype", None)
        if (shape, kind) != (its.shape, its.dtype):
            part = jax.tree_util.keystr(path)
            got = shown(repr(mine)) if shape is None or kind is None else f"{kind}{list(shape)}"
            remedy = (
                "convert it, for instance with astype"
                if shape == its.shape
                else "return one of that shape"
            )
            raise UserError(
                f"{method} must return {its.dtype}{list(its.shape)} as {part + ' of ' if part else ''}its {what}{same} "
                f"(got {got}); {remedy}"
            )


def check_names(method: str, given: Any, names: Collection[str], attribute: str) -> None:
    """Raise a UserError unless a method returned a dictionary with the names that an attribute
    declares."""
    if not isinstance(given, dict) or set(given) != set(names):
        got = (
            ", ".join(map(str, given)) or "nothing"
            if isinstance(given, dict)
            else f"a {type(given).__name__}"
        )
        wanted = ", ".join(names) or "nothing"
        raise UserError(
            f"{method} must return by name what {attribute} declares, {wanted} (got {got})"
        )


def _differing(given: Any, wanted: Any) -> str:
    """Return which parts of a tree are missing and which are too many; nothing where the names do
    not differ."""
    mine, theirs = (
        {jax.tree_util.keystr(path) for path, _ in _leaves(tree)} for tree in (given, wanted)
    )
    missing = [f"without {path}" for path in sorted(theirs - mine) if path]
    unknown = [f"with {path}" for path in sorted(mine - theirs) if path]
    return "".join(f", {part}" for part in (*missing, *unknown))


def _leaves(tree: Any) -> Any:
    return jax.tree_util.tree_leaves_with_path(tree)


def _named(tree: Any) -> str:
    if hasattr(tree, "shape") and hasattr(tree, "dtype"):
        return "an array"
    n, name = len(jax.tree.leaves(tree)), type(tree).__name__
    return name if jax.tree_util.all_leaves([tree]) else f"{name} of {n} array{'s' * (n != 1)}"
