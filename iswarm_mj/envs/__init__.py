"""Environments for learning: each robot of a swarm is told what to do, on every engine.

`make_env` makes one of pure functions `reset` and `step`, in the style of MuJoCo Playground; `parallel_env` one for
PettingZoo, `vector_env` and `single_env` ones for Gymnasium, which the extra `marl` installs.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from iswarm_mj.envs.env import Env
    from iswarm_mj.envs.gymnasium import SwarmEnv, SwarmVectorEnv
    from iswarm_mj.envs.make import make_env
    from iswarm_mj.envs.pettingzoo import SwarmParallelEnv
    from iswarm_mj.envs.state import State

__all__ = ["Env", "State", "make_env", "parallel_env", "single_env", "vector_env"]

_HOMES = {"Env": "env", "State": "state", "make_env": "make"}


def parallel_env(task: Any = "cleaning", n_robots: int = 20, **settings: Any) -> "SwarmParallelEnv":
    """Make a PettingZoo `ParallelEnv` of one world; for `settings` see `make_env`.

    Raises:
        UserError: see `make_env`; or a package is missing.
    """
    return _adapter("pettingzoo", "SwarmParallelEnv")(task=task, n_robots=n_robots, **settings)


def vector_env(task: Any = "cleaning", n_robots: int = 20, num_envs: int = 1, **settings: Any) -> "SwarmVectorEnv":
    """Make a Gymnasium `VectorEnv` of many worlds; for `settings` see `make_env`.

    Raises:
        UserError: see `make_env`; or a package is missing.
    """
    return _adapter("gymnasium", "SwarmVectorEnv")(task=task, n_robots=n_robots, num_envs=num_envs, **settings)


def single_env(task: Any = "cleaning", n_robots: int = 20, **settings: Any) -> "SwarmEnv":
    """Make a Gymnasium `Env` of one world; for `settings` see `make_env`.

    Raises:
        UserError: see `make_env`; or a package is missing.
    """
    return _adapter("gymnasium", "SwarmEnv")(task=task, n_robots=n_robots, **settings)


def _adapter(module: str, name: str) -> Any:
    try:
        return getattr(import_module(f"{__name__}.{module}"), name)
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in ("pettingzoo", "gymnasium"):
            raise
        from iswarm_mj.utils.errors import UserError

        raise UserError(f"this environment needs the package {package}; run pip install 'iswarm-mj[marl]'") from None


def __getattr__(name: str) -> Any:
    """Import what is asked for (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
