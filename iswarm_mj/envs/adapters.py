"""What adapters to other interfaces have in common: worlds as arrays; settings, seeds and actions that are refused."""

import difflib
import inspect
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.envs.actions import checked
from iswarm_mj.envs.env import Env
from iswarm_mj.envs.make import make_env
from iswarm_mj.envs.observations import bounds
from iswarm_mj.envs.state import State
from iswarm_mj.utils.constraints import check, is_whole
from iswarm_mj.utils.errors import UserError, shown

MOST_SEED = 2**32 - 1
"""Keys of JAX take no more bits of a seed."""


class Outcome(NamedTuple):
    """Result of a step of B worlds, as NumPy arrays."""

    obs: Float[np.ndarray, "B N D"]
    reward: Float[np.ndarray, "B N"]
    terminated: Bool[np.ndarray, "B"]
    """The goal is reached."""
    truncated: Bool[np.ndarray, "B"]
    """The time is up, or something went wrong."""
    info: dict[str, np.ndarray]
    """Metrics of the task, `is_finished`, and `fault`: bits of `FaultKind`, 0 if nothing went wrong; (B,) each."""


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
        known = [name for name in inspect.signature(make_env).parameters if name != "n_worlds"]  # adapters give that
        for name in settings:
            if name not in known:
                similar = difflib.get_close_matches(name, known, n=1)
                remedy = f"perhaps you meant {similar[0]}" if similar else "leave it out"
                if name in ("n_worlds", "num_envs"):
                    remedy = "for many worlds call vector_env with num_envs"
                raise UserError(f"settings must be among {', '.join(known)} (got {shown(name)}); {remedy}")
        self.env: Env = make_env(n_worlds=n_worlds, **settings)
        self.n_worlds, self._rng = n_worlds, np.random.default_rng()
        is_mapped = self.env.n_worlds is None
        self._reset = jax.jit(jax.vmap(self.env.reset)) if is_mapped else self.env.reset
        self._step = jax.jit(jax.vmap(self.env.step)) if is_mapped else self.env.step
        self._state: State | None = None

    def spaces(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Return the lowest and highest values of a robot's observation (D,) and of its action (A,)."""
        return bounds(self.env.observations), bounds(self.env.actions)

    def reset(self, seed: Any) -> Float[np.ndarray, "B N D"]:
        """Begin episodes, which the seed determines; None draws one.

        Raises:
            ConfigError: the seed is no whole number, or lies beyond what keys take.
        """
        is_seed = seed is None or (is_whole(seed) and 0 <= int(seed) <= MOST_SEED)
        check("seed", seed, f"a whole number from 0 to {MOST_SEED}, or None for one by chance", is_seed)
        number = int(self._rng.integers(2**31)) if seed is None else int(seed)
        self._state = self._reset(jax.random.split(jax.random.key(number), self.n_worlds))
        return np.asarray(self._state.obs)

    def step(self, action: Any) -> Outcome:
        """Take a step.

        Args:
            action: (B, N, A) from -1 to 1.

        Raises:
            UserError: no episode has begun, or an action is not finite, lies beyond, or does not fit.
        """
        if self._state is None:
            raise UserError("step needs an episode; call reset first")
        values = np.asarray(checked(action, (self.n_worlds, self.env.n_robots, self.env.action_size)))
        is_bad = ~(np.abs(values) <= 1.0 + 1e-6)
        if is_bad.any():
            place = tuple(map(int, np.argwhere(is_bad)[0]))
            raise UserError(f"an action must lie between -1 and 1 (got {values[place]} at {place}); clip it")
        self._state = self._step(self._state, values)
        # Copies: clients change observations in place.
        found: State = jax.tree.map(np.array, self._state._replace(data=None))
        is_finished, fault = found.info["is_finished"], found.info["fault"]
        info = {**found.metrics, "is_finished": is_finished, "fault": fault}
        return Outcome(found.obs, found.reward, is_finished, found.done & ~is_finished, info)


def stacked(actions: Any) -> np.ndarray:
    """Return actions as one array.

    Raises:
        UserError: their lengths differ.
    """
    try:
        return np.asarray(actions)
    except ValueError:
        raise UserError("an action must be an array of numbers (got lists of different lengths)") from None
