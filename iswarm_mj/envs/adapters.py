"""What adapters to other interfaces have in common: worlds as arrays; settings, seeds and actions that are refused."""

import difflib
import inspect
from typing import Any

import jax
import numpy as np

from iswarm_mj.envs.env import Env
from iswarm_mj.envs.make import make_env
from iswarm_mj.envs.observations import bounds
from iswarm_mj.envs.state import State
from iswarm_mj.utils.constraints import check, is_whole
from iswarm_mj.utils.errors import UserError, shown

MOST_SEED = 2**32 - 1
"""Keys of JAX take no more bits of a seed."""


class Worlds:
    """An environment of B worlds as NumPy arrays, on any engine; keys come from a seed, as those of Gymnasium."""

    def __init__(self, n_worlds: int, /, **settings: Any):
        """Make the environment.

        Args:
            n_worlds: B.
            settings: of `make_env`.

        Raises:
            UserError: there is no such setting, or see `make_env`.
        """
        check_names(settings)
        self.env: Env = make_env(n_worlds=n_worlds, **settings)
        self.n_worlds = n_worlds
        is_mapped = self.env.n_worlds is None
        self._reset = jax.jit(jax.vmap(self.env.reset)) if is_mapped else self.env.reset
        self._step = jax.jit(jax.vmap(self.env.step)) if is_mapped else self.env.step
        self._state: State | None = None

    def spaces(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Return the lowest and highest values of a robot's observation (D,) and of its action (A,)."""
        return bounds(self.env.observations), bounds(self.env.actions)

    def reset(self, seed: int) -> State:
        """Begin episodes."""
        self._state = self._reset(jax.random.split(jax.random.key(seed), self.n_worlds))
        return _numbers(self._state)

    def step(self, action: np.ndarray) -> State:
        """Take a step.

        Args:
            action: (B, N, A) from -1 to 1.

        Raises:
            UserError: no episode has begun, or an action is not finite, lies beyond, or does not fit.
        """
        if self._state is None:
            raise UserError("step needs an episode; call reset first")
        check_actions(action)
        self._state = self._step(self._state, action)
        return _numbers(self._state)


def action_array(action: Any) -> np.ndarray:
    """Actions as an array.

    Raises:
        UserError: their lengths differ.
    """
    try:
        return np.asarray(action)
    except ValueError:
        raise UserError("an action must be an array of numbers (got lists of different lengths)") from None


def check_actions(action: Any) -> None:
    """Refuse actions that are not finite or lie beyond -1 and 1.

    Raises:
        UserError: one is or does; it names the first.
    """
    values = action_array(action)
    if values.dtype.kind not in "fiu":
        raise UserError(f"an action must hold numbers from -1 to 1 (got {values.dtype}); convert it to float32")
    is_bad = ~(np.abs(values) <= 1.0 + 1e-6)
    if is_bad.any():
        place = tuple(map(int, np.argwhere(is_bad)[0]))
        raise UserError(f"an action must lie between -1 and 1 (got {values[place]} at {place}); clip it")


def check_names(settings: Any) -> None:
    """Refuse settings that environments do not have.

    Raises:
        UserError: there is one; it names the first.
    """
    known = [name for name in inspect.signature(make_env).parameters if name != "n_worlds"]  # adapters give that
    for name in settings:
        if name not in known:
            similar = difflib.get_close_matches(name, known, n=1)
            remedy = f"perhaps you meant {similar[0]}" if similar else "leave it out"
            if name in ("n_worlds", "num_envs"):
                remedy = "for many worlds call vector_env with num_envs"
            raise UserError(f"settings must be among {', '.join(known)} (got {shown(name)}); {remedy}")


def checked_seed(seed: Any) -> int | None:
    """Return a seed as a plain number, or None where none is given.

    Raises:
        ConfigError: it is no whole number, or lies beyond what keys take.
    """
    if seed is None:
        return None
    is_seed = is_whole(seed) and 0 <= int(seed) <= MOST_SEED
    check("seed", seed, f"a whole number from 0 to {MOST_SEED}, or None for one by chance", is_seed)
    return int(seed)


def fresh_seed(seed: int | None, rng: np.random.Generator) -> int:
    """Return a seed, drawn where none is given."""
    return int(rng.integers(2**31)) if seed is None else seed


def _numbers(state: State) -> State:
    """What adapters hand on, as NumPy arrays."""
    return jax.tree.map(np.asarray, state._replace(data=None))
