"""Trees of arrays packed into few arrays, which programs take and return faster.

Each array that a compiled program takes or returns costs its call some microseconds on the host,
and parameters and state of a world are about a hundred small arrays. Measured as the median of five
runs of `iswarm bench --robots 283 --threads 1` on a shared core: with one array a leaf the
decisions of a step take 1.62 ms instead of 1.14 ms with `--engine planar`, and 1.76 ms instead of
1.60 ms with `--engine mujoco`; the whole step of planar takes 4.5 ms instead of 3.5 ms.

This module alone knows the packed form: `HostLoop` packs, `decide.decide_packed` unpacks.
"""

from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import numpy as np

from iswarm_mj.utils.arrays import Array, array_module

_STATIC = {"static": True}


class _Place(NamedTuple):
    """Columns of a packed array that hold a leaf of the tree."""

    dtype: str
    """Type of the leaf's values, which names the packed array."""
    start: int
    """First column."""
    stop: int
    """Column after the last."""
    shape: tuple[int, ...]
    """Shape of the leaf (B, ...) without B."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Packed:
    """A tree of arrays of B worlds, itself a pytree of one array for each type of their values.

    Attributes:
        arrays: values of all leaves of a type, side by side (B, n), by the name of the type.
        treedef: structure of the tree.
        places: place of each leaf.
        node_types: types of the tree's nodes (`node_types_of`).
    """

    arrays: dict[str, Array]
    treedef: Any = field(metadata=_STATIC)
    places: tuple[_Place, ...] = field(metadata=_STATIC)
    node_types: tuple[type | None, ...] = field(metadata=_STATIC)

    @property
    def tree(self) -> Any:
        """The tree; leaves of NumPy arrays are views."""
        leaves = [self._leaf(place) for place in self.places]
        return jax.tree.unflatten(self.treedef, leaves)

    def _leaf(self, place: _Place) -> Array:
        """Return a leaf of the tree."""
        columns = self.arrays[place.dtype][:, place.start : place.stop]
        if len(place.shape) == 1:
            return columns
        return columns.reshape(len(columns), *place.shape)


def pack(tree: Any) -> Packed:
    """Pack a tree of arrays (B, ...), all NumPy's or all JAX's."""
    leaves, treedef = jax.tree.flatten(tree)
    columns: dict[str, list[Array]] = defaultdict(list)
    n_columns: dict[str, int] = defaultdict(int)
    places = []
    for leaf in leaves:
        dtype = str(leaf.dtype)
        flat = leaf.reshape(len(leaf), -1)
        start = n_columns[dtype]
        stop = start + flat.shape[1]
        places.append(_Place(dtype, start, stop, leaf.shape[1:]))
        columns[dtype].append(flat)
        n_columns[dtype] = stop
    arrays = {dtype: _side_by_side(parts) for dtype, parts in columns.items()}
    return Packed(arrays, treedef, tuple(places), node_types_of(treedef))


def _side_by_side(parts: list[Array]) -> Array:
    """Return arrays (B, n) as one; a single array is not copied."""
    if len(parts) == 1:
        return parts[0]
    return array_module(*parts).concatenate(parts, axis=1)


def node_types_of(treedef: Any) -> tuple[type | None, ...]:
    """Return the types of a structure's nodes, None for leaves.

    Programs that JAX compiles need them as a static argument: it takes two structures for equal
    whose dataclasses differ but have the same fields, and would run the program of one strategy for
    another.
    """
    node = treedef.node_data()
    node_type = None if node is None else node[0]
    types = [node_type]
    for child in treedef.children():
        types += node_types_of(child)
    return tuple(types)


def unpacked(tree: Any) -> Any:
    """Return a tree with all that is packed in it as views of NumPy arrays."""

    def unpack(part: Any) -> Any:
        if not isinstance(part, Packed):
            return part
        return jax.tree.map(np.asarray, part).tree

    return jax.tree.map(unpack, tree, is_leaf=lambda part: isinstance(part, Packed))
