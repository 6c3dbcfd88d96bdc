"""A small network with one hidden layer, whose weights are one vector, and the file in which weights are kept."""

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

MOST_WEIGHTS = 2**18
"""In a file."""


class Shape(NamedTuple):
    """How many numbers a network takes, has in between, and returns."""

    inputs: int
    hidden: int
    outputs: int

    @property
    def n_weights(self) -> int:
        """Weights in all: of inputs and a constant to the hidden units, and of all of these to the outputs."""
        return (self.inputs + 1) * self.hidden + (self.inputs + 1 + self.hidden) * self.outputs


def forward(shape: Shape, weights: Float[Array, "W"], inputs: Float[Array, "N I"]) -> Float[Array, "N O"]:
    """Outputs of the network: linear in its inputs and in hidden units, which are tanh of linear functions of these.

    Args:
        shape: of the network.
        weights: `shape.n_weights` of them.
        inputs: of each of N robots.
    """
    given = jnp.concatenate([inputs, jnp.ones((len(inputs), 1), inputs.dtype)], axis=1)
    split = (shape.inputs + 1) * shape.hidden
    hidden = jnp.tanh(given @ weights[:split].reshape(shape.inputs + 1, shape.hidden))
    return jnp.concatenate([given, hidden], axis=1) @ weights[split:].reshape(-1, shape.outputs)


def save_weights(path: Path, weights: Float[np.ndarray, "W"]) -> None:
    """Write weights into a file of NumPy (.npz), with 32 bits each.

    Raises:
        UserError: the system refused to write.
    """
    check_name(path, ".npz", setting="path")
    with atomic_write(path) as part, part.open("wb") as file:
        np.savez(file, weights=np.asarray(weights, np.float32))


def load_weights(path: Path | str, like: Any = None) -> Any:
    """Return the weights in a file that `save_weights` wrote: (W,) float32.

    Args:
        path: of the file.
        like: a pytree of arrays, whose shapes and types the weights get; None to leave them.

    Raises:
        UserError: it does not exist, is too large, or holds something else.
    """
    try:
        check_file(Path(path))
        with np.load(path, allow_pickle=False) as content:
            if sum(part.file_size for part in content.zip.infolist()) > 8 * MOST_WEIGHTS:
                raise ValueError("it expands to much more than its size")
            found = content["weights"]
    except OSError as error:
        reason = error.strerror or error
        raise UserError(f"weights {path} cannot be read ({reason}); give a file that `iswarm train` wrote") from None
    except (ValueError, LookupError, EOFError, BadZipFile, TypeError, NotImplementedError):
        raise UserError(f"{path} is no file of weights; give weights.npz of `iswarm train`") from None
    if found.dtype != np.float32 or found.ndim != 1 or not np.isfinite(found).all():
        raise UserError(
            f"{path} has weights {found.dtype}{list(found.shape)}; they must be one axis of finite float32, as "
            "`iswarm train` writes them"
        )
    if like is None:
        return found
    flat, shaped = ravel_pytree(like)
    if len(flat) != len(found):
        raise UserError(f"{path} has {len(found)} weights, but {len(flat)} are wanted; give those of this strategy")
    return shaped(jnp.asarray(found, flat.dtype))
