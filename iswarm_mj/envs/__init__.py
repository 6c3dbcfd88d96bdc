"""Environments for learning: actions, observations and rewards of each robot, on every engine.

`make_env` makes one of pure functions `reset` and `step`, in the style of MuJoCo Playground; `parallel_env` one for
PettingZoo, `vector_env` and `single_env` ones for Gymnasium, which the extra `marl` installs.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from iswarm_mj.utils.environment import check_environment

if TYPE_CHECKING:
    from iswarm_mj.envs.core import State
    from iswarm_mj.envs.env import Env
    from iswarm_mj.envs.gymnasium import SwarmEnv as single_env
    from iswarm_mj.envs.gymnasium import SwarmVectorEnv as vector_env
    from iswarm_mj.envs.make import make_env
    from iswarm_mj.envs.pettingzoo import SwarmParallelEnv as parallel_env
    from iswarm_mj.envs.policy import PolicyStrategy
    from iswarm_mj.envs.watch import EnvRecording, Pictures

__all__ = [
    "Env",
    "EnvRecording",
    "Pictures",
    "PolicyStrategy",
    "State",
    "make_env",
    "parallel_env",
    "single_env",
    "vector_env",
]

_HOMES = {
    "Env": "env.Env",
    "EnvRecording": "watch.EnvRecording",
    "Pictures": "watch.Pictures",
    "PolicyStrategy": "policy.PolicyStrategy",
    "State": "core.State",
    "make_env": "make.make_env",
    "parallel_env": "pettingzoo.SwarmParallelEnv",
    "single_env": "gymnasium.SwarmEnv",
    "vector_env": "gymnasium.SwarmVectorEnv",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    check_environment()
    module, own = _HOMES[name].split(".")
    return getattr(import_module(f"{__name__}.{module}"), own)
