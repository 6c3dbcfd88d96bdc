"""Environments for the interfaces of PettingZoo and Gymnasium, which the extra `marl` installs."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from iswarm_mj.utils.errors import UserError

if TYPE_CHECKING:
    from iswarm_mj.envs.gymnasium import SwarmEnv, SwarmVectorEnv
    from iswarm_mj.envs.pettingzoo import SwarmParallelEnv


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
        return getattr(import_module(f"iswarm_mj.envs.{module}"), name)
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in ("pettingzoo", "gymnasium"):
            raise
        raise UserError(f"this environment needs the package {package}; run pip install 'iswarm-mj[marl]'") from None
