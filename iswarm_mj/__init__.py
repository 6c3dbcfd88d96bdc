"""A physics-based simulator of the I-SWARM micro-robot swarm on MuJoCo.

The names in `__all__` are imported from their modules when they are first used, so that importing the package, or one
of its laws, loads nothing else.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from iswarm_mj.config import READINGS, SwarmConfig
    from iswarm_mj.engines.mjx.settings import MjxSettings
    from iswarm_mj.engines.mujoco.settings import MujocoSettings
    from iswarm_mj.engines.planar.settings import PlanarSettings
    from iswarm_mj.envs.make import make_env
    from iswarm_mj.output.saved import load
    from iswarm_mj.player.page import play
    from iswarm_mj.simulation.run import Run
    from iswarm_mj.simulation.settings import RunSettings
    from iswarm_mj.strategy.genome import PRESETS
    from iswarm_mj.strategy.teams import Teams
    from iswarm_mj.workflows.grasp import run_grasp
    from iswarm_mj.workflows.grasp_settings import GraspSettings
    from iswarm_mj.workflows.rollout import rollout

__version__ = "0.2.0"

__all__ = [
    "PRESETS",
    "READINGS",
    "GraspSettings",
    "MjxSettings",
    "MujocoSettings",
    "PlanarSettings",
    "Run",
    "RunSettings",
    "SwarmConfig",
    "Teams",
    "load",
    "make_env",
    "play",
    "rollout",
    "run_grasp",
]

_MODULES = {
    "config": ("READINGS", "SwarmConfig"),
    "envs.make": ("make_env",),
    "output.saved": ("load",),
    "player.page": ("play",),
    "workflows.grasp": ("run_grasp",),
    "workflows.grasp_settings": ("GraspSettings",),
    "workflows.rollout": ("rollout",),
    "simulation.run": ("Run",),
    "engines.mjx.settings": ("MjxSettings",),
    "engines.mujoco.settings": ("MujocoSettings",),
    "engines.planar.settings": ("PlanarSettings",),
    "simulation.settings": ("RunSettings",),
    "strategy.genome": ("PRESETS",),
    "strategy.teams": ("Teams",),
}
"""Where the names of `__all__` are defined."""
_HOMES = {name: module for module, names in _MODULES.items() for name in names}

# JAX 0.10 and 0.11 report every program that they load from their compilation cache on a CPU as an error, because the
# features stored with it include two preferences of the compiler that no processor has. XLA reads its log level
# when JAX is imported, so this works only if the package is imported before JAX. The user's own setting takes
# precedence.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def __getattr__(name: str) -> Any:
    """Import what is asked for (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import_module(f"{__name__}.utils.environment").check_environment()
    found = globals()[name] = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
