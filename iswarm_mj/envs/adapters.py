"""What adapters to other interfaces have in common: worlds as arrays; seeds and actions that are refused."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, UInt8

from iswarm_mj.envs.actions import checked
from iswarm_mj.envs.make import make_env
from iswarm_mj.envs.observations import Row, bounds
from iswarm_mj.envs.state import State
from iswarm_mj.envs.watch import EnvRecording, Pictures
from iswarm_mj.envs.window import Window
from iswarm_mj.utils.constraints import check, is_whole
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

MODES = ("human", "rgb_array")
"""Of rendering."""
FPS = 10
"""Control steps a second of what is rendered."""
MOST_SEED = 2**32 - 1
"""Keys of JAX take no more bits of a seed."""


@contextmanager
def installed() -> Iterator[None]:
    """Raise a UserError where a package that is imported inside is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        raise UserError(f"this environment needs {package}; run pip install 'iswarm-mj[marl]'") from None


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
    """An environment of B worlds as NumPy arrays, on any engine; keys come from a seed, as those of Gymnasium.

    Copies and pickles are made anew from the same settings: their first episode begins with `reset`.
    """

    def __init__(
        self, n_worlds: int, render_mode: str | None = None, record: Path | str | None = None, **settings: Any
    ):
        """Make the environment.

        Args:
            n_worlds: B.
            render_mode: `rgb_array`, which `render` returns, or `human`, a window that shows world 0.
            record: file for Rerun, `*.rrd`, to which world 0 is recorded; copies of the environment record nothing.
            settings: of `make_env`.

        Raises:
            UserError: there is no such mode; or see `make_env`.
        """
        check("render_mode", render_mode, f"one of {', '.join(MODES)}, or None", render_mode in (None, *MODES))
        self._settings, self._mode = {"render_mode": render_mode, **settings}, render_mode
        self._pictures: Pictures | None = None
        self._window = Window() if render_mode == "human" else None
        self.env = env = make_env(n_worlds=n_worlds, **settings)
        self.n_worlds, self._rng = n_worlds, np.random.default_rng()
        self.shape = env.n_robots, env.action_size
        mapped = (jax.jit(jax.vmap(env.reset)), jax.jit(jax.vmap(env.step)))
        self._reset, self._step = mapped if env.n_worlds is None else (env.reset, env.step)
        self._state: State | None = None
        self._recording = None if record is None else EnvRecording(self.env, record)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes another one."""
        return partial(Worlds, **self._settings), (self.n_worlds,)

    def spaces(self, space: Any, n_robots: int = 0) -> tuple[Any, Any]:
        """Return boxes of what robots observe and do.

        Args:
            space: class of the boxes.
            n_robots: of arrays (N, D) and (N, A); of one robot, (D,) and (A,), if not given.
        """

        def box(table: list[Row]) -> Any:
            ends = (np.tile(end, (n_robots, 1)) if n_robots else end for end in bounds(table))
            return space(*ends, dtype=np.float32)

        return box(self.env.observations), box(self.env.actions)

    def reset(self, seed: Any) -> Float[np.ndarray, "B N D"]:
        """Begin episodes, which the seed determines; None draws one.

        Raises:
            ConfigError: the seed is no whole number, or lies beyond what keys take.
        """
        is_seed = seed is None or (is_whole(seed) and 0 <= int(seed) <= MOST_SEED)
        check("seed", seed, f"a whole number from 0 to {MOST_SEED}, or None for one by chance", is_seed)
        if seed is not None:  # from which later episodes follow, too
            self._rng = np.random.default_rng(int(seed))
        number = int(self._rng.integers(2**31)) if seed is None else int(seed)
        self._state = self._reset(jax.random.split(jax.random.key(number), self.n_worlds))
        self._watch(self._state)
        return np.array(self._state.obs)

    def render(self, world: int = 0) -> UInt8[np.ndarray, "height width 3"] | None:
        """Return a picture of a world, or show it in the window, by the mode.

        Raises:
            UserError: no episode has begun, or there is no off-screen OpenGL.
        """
        if self._mode is None:
            return None
        state = self._begun("render")
        self._pictures = self._pictures or Pictures(self.env, state)
        pixels = self._pictures.show(state, world)
        if self._window is None:
            return pixels
        self._window.show(pixels)
        return None

    def close(self) -> None:
        """Complete the recording, close the window, and release OpenGL."""
        for part in (self._recording, self._window, self._pictures):
            if part is not None:
                part.close()
        self._recording = self._pictures = None

    def _watch(self, state: State) -> None:
        """Record and show what has just happened, where somebody asked for it."""
        if self._recording is not None:
            self._recording.add(state)
        if self._window is not None:
            self.render()

    def everything(self) -> Float[np.ndarray, "B E"]:
        """Return all observations of a world, then x, y [rd] and yaw [rad] of all robots.

        Raises:
            UserError: no episode has begun.
        """
        state = self._begun("state")
        poses = np.array(self.env.poses(state), np.float32) / (RD, RD, 1)
        parts = (np.asarray(part).reshape(self.n_worlds, -1) for part in (state.obs, poses))
        return np.concatenate([*parts], axis=1, dtype=np.float32)

    def _begun(self, method: str) -> State:
        if self._state is None:
            raise UserError(f"{method} needs an episode; call reset first")
        return self._state

    def step(self, action: Any) -> Outcome:
        """Take a step.

        Args:
            action: (B, N, A) from -1 to 1.

        Raises:
            UserError: no episode has begun, or an action is not finite, lies beyond, or does not fit.
        """
        state = self._begun("step")
        values = np.asarray(checked(action, (self.n_worlds, *self.shape)))
        is_bad = ~(np.abs(values) <= 1.0 + 1e-6)
        if is_bad.any():
            place = tuple(map(int, np.argwhere(is_bad)[0]))
            raise UserError(f"an action must lie between -1 and 1 (got {values[place]} at {place}); clip it")
        self._state = self._step(state, values)
        self._watch(self._state)
        # Copies: clients change observations in place.
        found: State = jax.tree.map(np.array, self._state._replace(data=None))
        is_finished, fault = found.info["is_finished"], found.info["fault"]
        info = {**found.metrics, "is_finished": is_finished, "fault": fault}
        return Outcome(np.asarray(found.obs), np.asarray(found.reward), is_finished, found.done & ~is_finished, info)
