"""Environments for learning: actions, observations and rewards of each robot, on every engine.

`iswarm_mj.make_env` makes one of pure functions `reset` and `step`, in the style of MuJoCo
Playground; `parallel_env` one for PettingZoo, `vector_env` and `single_env` ones for Gymnasium,
which the extra `marl` installs. The public names are those of `__init__.pyi`, imported when they
are first used.
"""

from typing import Any

import lazy_loader

from iswarm_mj.utils.environment import check_environment
from iswarm_mj.utils.extras import naming_extras

_import_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, after a check of the environment's variables."""
    if name in __all__:
        check_environment()
    with naming_extras():
        return _import_name(name)
