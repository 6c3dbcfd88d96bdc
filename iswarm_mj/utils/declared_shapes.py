"""Declared shapes and types of arrays, and checks of what methods of users' classes return.

Named tuples declare the arrays that robots sense, command and record, by the annotations of their
fields.
"""

from collections.abc import Collection
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.utils.errors import UserError, shown

_TYPES = {Bool: jnp.bool_, Float: jnp.float32, Int: jnp.int32, UInt32: jnp.uint32}
"""Types of arrays by the classes of jaxtyping that annotate them."""

_KEPT = ("memory", "bodies")
"""Roles of results that must have the structure, shapes and types of an argument of the method."""


def shapes_of(cls: Any, **sizes: int | tuple[int, ...]) -> dict[str, Any]:
    """Return the shapes and types of the arrays of a named tuple by the names of its fields.

    Fields are annotated as `Float[Array, "*B N 2"]`; others are left out. jaxtyping gives such an
    annotation the attributes `dtype`, here Float, and `dim_str`, here "*B N 2".

    Args:
        cls: named tuple.
        sizes: size of each axis by its name; for a name with a star, a tuple of sizes.
    """
    return {
        name: jax.ShapeDtypeStruct(_shape_of(kind.dim_str, sizes), _TYPES[kind.dtype])
        for name, kind in cls.__annotations__.items()
        if hasattr(kind, "dim_str")
    }


def zeros_of(cls: Any, **sizes: int | tuple[int, ...]) -> dict[str, np.ndarray]:
    """Return NumPy arrays of zeros with the shapes and types that `shapes_of` returns."""
    shapes = shapes_of(cls, **sizes)
    return {name: np.zeros(array.shape, array.dtype) for name, array in shapes.items()}


def check_result(method: str, returned: Any, expected: Any, role: str = "result") -> None:
    """Check structure, shapes and types of what a method of a user returned.

    Args:
        method: name of the method, as `Walk.act`.
        returned: arrays, or their shapes and types.
        expected: shapes and types, or arrays.
        role: what the result is, in a word; the error says of those in `_KEPT` that they must be
            returned as they were given.

    Raises:
        UserError: the result has another structure, or an array another shape or type.
    """
    kept = " as it was given" if role in _KEPT else ""
    if jax.tree.structure(returned) != jax.tree.structure(expected):
        raise UserError(
            f"{method} must return {_describe(expected)} as its {role}{kept} "
            f"(got {_describe(returned)}){_differing_parts(returned, expected)}; "
            "return the same type with the same parts"
        )

    leaves = jax.tree_util.tree_leaves_with_path(returned)
    for (path, leaf), expected_leaf in zip(leaves, jax.tree.leaves(expected), strict=True):
        shape = getattr(leaf, "shape", None)
        dtype = getattr(leaf, "dtype", None)
        if shape == expected_leaf.shape and dtype == expected_leaf.dtype:
            continue

        part = f"{jax.tree_util.keystr(path)} of " if path else ""
        got = shown(repr(leaf))
        if shape is not None and dtype is not None:
            got = f"{dtype}{list(shape)}"
        cure = "return one of that shape"
        if shape == expected_leaf.shape:
            cure = "convert it, for instance with astype"
        raise UserError(
            f"{method} must return {expected_leaf.dtype}{list(expected_leaf.shape)} as {part}its "
            f"{role}{kept} (got {got}); {cure}"
        )


def check_keys(method: str, returned: Any, names: Collection[str], attribute: str) -> None:
    """Check that a method of a user returned a dictionary with the names that are declared.

    Args:
        method: name of the method, as `Walk.say`.
        returned: its result.
        names: declared names.
        attribute: attribute of the class that declares them.

    Raises:
        UserError: it is no dictionary, or has other names.
    """
    if isinstance(returned, dict) and set(returned) == set(names):
        return
    got = f"a {type(returned).__name__}"
    if isinstance(returned, dict):
        got = ", ".join(map(str, returned)) or "nothing"
    declared = ", ".join(names) or "nothing"
    raise UserError(
        f"{method} must return by name what {attribute} declares, {declared} (got {got})"
    )


def _differing_parts(returned: Any, expected: Any) -> str:
    """Return which parts of a tree are missing and which are too many, as ", without ['home']".

    The text, which continues a sentence, is empty where the names do not differ.
    """
    paths = _paths_of(returned)
    expected_paths = _paths_of(expected)
    missing = [f", without {path}" for path in sorted(expected_paths - paths) if path]
    unknown = [f", with {path}" for path in sorted(paths - expected_paths) if path]
    return "".join(missing + unknown)


def _paths_of(tree: Any) -> set[str]:
    """Return the paths to the leaves of a tree, as Python writes them."""
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return {jax.tree_util.keystr(path) for path, _ in leaves}


def _describe(tree: Any) -> str:
    """Return type and number of arrays of a tree, as "dict of 2 arrays"."""
    if hasattr(tree, "shape") and hasattr(tree, "dtype"):
        return "an array"
    name = type(tree).__name__
    if jax.tree_util.all_leaves([tree]):  # a single value, and no tree
        return name
    n_arrays = len(jax.tree.leaves(tree))
    return f"{name} of {n_arrays} array{'' if n_arrays == 1 else 's'}"


def _shape_of(axes: str, sizes: dict[str, int | tuple[int, ...]]) -> list[int]:
    """Return the shape that the axes of an annotation stand for, as "*B N 2"."""
    shape: list[int] = []
    for axis in axes.split():
        name = axis.lstrip("*")
        size = sizes[name] if name in sizes else int(name)
        shape += size if isinstance(size, tuple) else [size]
    return shape
