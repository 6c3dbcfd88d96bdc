"""Environments for learning: each robot of a swarm is told what to do, on every engine.

`make_env` makes one of pure functions `reset` and `step`, in the style of MuJoCo Playground; `parallel_env` one for
PettingZoo, `vector_env` and `single_env` ones for Gymnasium, which the extra `marl` installs.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from iswarm_mj.envs.env import Env
    from iswarm_mj.envs.interfaces import parallel_env, single_env, vector_env
    from iswarm_mj.envs.make import make_env
    from iswarm_mj.envs.state import State

__all__ = ["Env", "State", "make_env", "parallel_env", "single_env", "vector_env"]

_ADAPTED = dict.fromkeys(("parallel_env", "single_env", "vector_env"), "interfaces")
_HOMES = {"Env": "env", "State": "state", "make_env": "make", **_ADAPTED}


def __getattr__(name: str) -> Any:
    """Import what is asked for (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
