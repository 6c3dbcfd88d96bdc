"""What protocols ask of strategies, tasks and engines of users: methods, and shapes and types of what these return."""

from collections.abc import Collection, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.utils.errors import UserError, shown

_TYPES = {Bool: jnp.bool_, Float: jnp.float32, Int: jnp.int32, UInt32: jnp.uint32}


def check_has(given: Any, methods: Sequence[str], what: str, protocol: str) -> None:
    """Check that an object or a class of a user has the methods of a protocol.

    Args:
        given: by the user.
        methods: that it needs.
        what: it is to be, with its article, as "a strategy".
        protocol: where they are described.

    Raises:
        UserError: one is missing.
    """
    missing = [method for method in methods if not callable(getattr(given, method, None))]
    if missing:
        name = given.__name__ if isinstance(given, type) else type(given).__name__
        raise UserError(
            f"{name} has no method {' and no method '.join(missing)}; {what} has {', '.join(methods)}, see {protocol}"
        )


def shapes_of(cls: Any, **sizes: int | tuple[int, ...]) -> dict[str, Any]:
    """Return the shapes and types that the annotations of a named tuple declare, as `Float[Array, "*B N 2"]`.

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
    """Raise a UserError unless what a method returned has the structure, shapes and types of what it should.

    Args:
        method: its name.
        given: arrays, or their shapes and types.
        wanted: shapes and types, or arrays.
        what: is compared; a `memory` and `bodies` are to stay as they were.
    """
    same = " as it was given" if what in ("memory", "bodies") else ""
    if jax.tree.structure(given) != jax.tree.structure(wanted):
        raise UserError(
            f"{method} must return {_named(wanted)} as its {what}{same} (got {_named(given)}); return the same type "
            "with the same parts"
        )
    for (path, mine), its in zip(jax.tree_util.tree_leaves_with_path(given), jax.tree.leaves(wanted), strict=True):
        shape, kind = getattr(mine, "shape", None), getattr(mine, "dtype", None)
        if (shape, kind) != (its.shape, its.dtype):
            part = jax.tree_util.keystr(path)
            got = shown(repr(mine)) if shape is None or kind is None else f"{kind}{list(shape)}"
            remedy = "convert it, for instance with astype" if shape == its.shape else "return one of that shape"
            raise UserError(
                f"{method} must return {its.dtype}{list(its.shape)} as {part + ' of ' if part else ''}its {what}{same} "
                f"(got {got}); {remedy}"
            )


def check_names(method: str, given: Any, names: Collection[str], attribute: str) -> None:
    """Raise a UserError unless a method returned a dictionary with the names that an attribute declares."""
    if not isinstance(given, dict) or set(given) != set(names):
        got = ", ".join(map(str, given)) or "nothing" if isinstance(given, dict) else f"a {type(given).__name__}"
        wanted = ", ".join(names) or "nothing"
        raise UserError(f"{method} must return by name what {attribute} declares, {wanted} (got {got})")


def _named(tree: Any) -> str:
    if hasattr(tree, "shape") and hasattr(tree, "dtype"):
        return "an array"
    n, name = len(jax.tree.leaves(tree)), type(tree).__name__
    return name if jax.tree_util.all_leaves([tree]) else f"{name} of {n} array{'s' * (n != 1)}"
