"""Trees of arrays in few arrays, since each that a program takes or returns costs it a microsecond or two."""

from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np

from iswarm_mj.utils.arrays import Array, array_module


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Packed:
    """A tree of arrays of B worlds, itself a pytree of one array for each type of their values.

    Attributes:
        arrays: (B, n) the values of all leaves of a type, side by side.
        treedef: structure of the tree.
        places: of each leaf, the name of its array, its first column there and that after its last, and its shape
            (B, ...) without B.
        kinds: types of the tree's nodes; JAX takes structures for equal where dataclasses have the same fields.
    """

    arrays: dict[str, Array]
    treedef: Any = field(metadata={"static": True})
    places: tuple[tuple[str, int, int, tuple[int, ...]], ...] = field(metadata={"static": True})
    kinds: tuple[type | None, ...] = field(metadata={"static": True})

    @property
    def tree(self) -> Any:
        """The tree; of NumPy arrays its leaves are views."""
        return jax.tree.unflatten(self.treedef, [self._leaf(*place) for place in self.places])

    def _leaf(self, name: str, first: int, end: int, shape: tuple[int, ...]) -> Array:
        values = self.arrays[name][:, first:end]
        return values if len(shape) == 1 else values.reshape(len(values), *shape)


def pack(tree: Any) -> Packed:
    """Pack a tree of arrays (B, ...), all NumPy's or all JAX's."""
    leaves, treedef = jax.tree.flatten(tree)
    parts: dict[str, list[Array]] = {}
    places = []
    for leaf in leaves:
        name, part = str(leaf.dtype), leaf.reshape(len(leaf), -1)
        first = sum(before.shape[1] for before in parts.setdefault(name, []))
        places.append((name, first, first + part.size // len(part), leaf.shape[1:]))
        parts[name].append(part)
    arrays = {
        name: each[0] if len(each) == 1 else array_module(*each).concatenate(each, axis=1)
        for name, each in parts.items()
    }
    return Packed(arrays, treedef, tuple(places), kinds_of(treedef))


def kinds_of(treedef: Any) -> tuple[type | None, ...]:
    """Types of a structure's nodes, None of leaves, which a program of JAX has to be called with."""
    node = treedef.node_data()
    return (None if node is None else node[0], *(kind for child in treedef.children() for kind in kinds_of(child)))


def unpacked(tree: Any) -> Any:
    """Return a tree with all that is packed in it as views of NumPy arrays."""

    def of(part: Any) -> Any:
        return jax.tree.map(np.asarray, part).tree if isinstance(part, Packed) else part

    return jax.tree.map(of, tree, is_leaf=lambda part: isinstance(part, Packed))
