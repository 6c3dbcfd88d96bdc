"""A small network with one hidden layer whose weights are one vector, and files of weights."""

from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float

from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, check_file, check_name

MAX_WEIGHTS = 2**18
"""Largest number of weights in a file."""


class Shape(NamedTuple):
    """Numbers of units of a network."""

    inputs: int
    hidden: int
    outputs: int

    @property
    def n_weights(self) -> int:
        """Number of weights.

        Hidden units read the inputs and a constant; outputs read these and the hidden units.
        """
        n_to_hidden = (self.inputs + 1) * self.hidden
        n_to_outputs = (self.inputs + 1 + self.hidden) * self.outputs
        return n_to_hidden + n_to_outputs

    def layers(self, weights: Float[Array, "W"]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """Return the weights of the hidden units and those of the outputs as matrices.

        Args:
            weights: `n_weights` weights, those of the hidden units first.

        Returns:
            Matrices (I + 1, H) and (I + 1 + H, O): a row for each input, one for the constant, then
            one for each hidden unit. With NumPy's arrays they are views.
        """
        n_to_hidden = (self.inputs + 1) * self.hidden
        to_hidden = weights[:n_to_hidden].reshape(self.inputs + 1, self.hidden)
        to_outputs = weights[n_to_hidden:].reshape(-1, self.outputs)
        return to_hidden, to_outputs


def forward(
    shape: Shape,
    weights: Float[Array, "W"],
    inputs: Float[Array, "N I"],
) -> Float[Array, "N O"]:
    """Return the outputs: linear in the inputs and in tanh units, which are linear in the inputs.

    Args:
        shape: numbers of units.
        weights: weights in the order of `Shape.layers`.
        inputs: inputs of each of N robots.
    """
    constant = jnp.ones((len(inputs), 1), inputs.dtype)
    inputs = jnp.concatenate([inputs, constant], axis=1)

    to_hidden, to_outputs = shape.layers(weights)
    hidden = jnp.tanh(inputs @ to_hidden)
    return jnp.concatenate([inputs, hidden], axis=1) @ to_outputs


def save_weights(path: Path, weights: Float[np.ndarray, "W"]) -> None:
    """Write weights to a NumPy file (.npz) as float32.

    Raises:
        UserError: the system refused to write.
    """
    check_name(path, ".npz", setting="path")
    with atomic_write(path) as part, part.open("wb") as file:
        np.savez(file, weights=np.asarray(weights, np.float32))


def load_weights(path: Path | str, like: Any = None) -> Any:
    """Return the weights in a file that `save_weights` wrote: (W,) float32.

    Args:
        path: path of the file.
        like: pytree of arrays whose shapes and types the weights get; None for one flat array.

    Raises:
        UserError: the file does not exist, is too large, or holds something else.
    """
    weights = _read_weights(path)
    if weights.dtype != np.float32 or weights.ndim != 1 or not np.isfinite(weights).all():
        raise UserError(
            f"{path} has weights {weights.dtype}{list(weights.shape)}; they must be one axis of "
            "finite float32, as `iswarm train` writes them"
        )
    if like is None:
        return weights

    flat, to_tree = ravel_pytree(like)
    if len(flat) != len(weights):
        remedy = "give those of this strategy"
        raise UserError(
            f"{path} has {len(weights)} weights, but {len(flat)} are wanted; {remedy}",
        )
    return to_tree(jnp.asarray(weights, flat.dtype))


def _read_weights(path: Path | str) -> np.ndarray:
    """Return the array of weights in a file, whatever its type and shape.

    Raises:
        UserError: the file cannot be read, or has no such array.
    """
    try:
        check_file(Path(path))
        with np.load(path, allow_pickle=False) as content:
            # A small compressed file may expand to more than the memory holds.
            size = sum(part.file_size for part in content.zip.infolist())
            if size > 8 * MAX_WEIGHTS:
                raise ValueError("it expands to much more than its size")
            return content["weights"]
    except OSError as error:
        reason = error.strerror or error
        raise UserError(
            f"weights {path} cannot be read ({reason}); give a file that `iswarm train` wrote",
        ) from None
    except (ValueError, LookupError, EOFError, BadZipFile, TypeError, NotImplementedError):
        raise UserError(
            f"{path} is no file of weights; give weights.npz of `iswarm train`",
        ) from None
