"""A physics-based simulator of the I-SWARM micro-robot swarm on MuJoCo.

The public names are those of `__init__.pyi`. They are imported from their modules when they are
first used, so that importing the package, or one of its laws, loads nothing else.
"""

import os
from typing import Any

import lazy_loader

from iswarm_mj._version import __version__ as __version__

_import_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# JAX 0.10 and 0.11 report every program that they load from their compilation cache on a CPU as an
# error, because the features stored with it include two preferences of the compiler that no
# processor has. XLA reads its log level when JAX is imported, so this works only if the package is
# imported before JAX. The user's own setting takes precedence.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used.

    Raises:
        UserError: a variable of the environment would break its libraries, or the package of an
            extra is missing.
    """
    packages_that_import_nothing = ("envs", "gripper")
    if name in __all__ and name not in packages_that_import_nothing:
        from iswarm_mj.utils.environment import check_environment

        check_environment()
    from iswarm_mj.utils.extras import naming_extras

    with naming_extras():
        return _import_name(name)
