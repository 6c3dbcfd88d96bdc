"""Environments for learning: actions, observations and rewards of each robot, on every engine.

`iswarm_mj.make_env` makes one of pure functions `reset` and `step`, in the style of MuJoCo Playground; `parallel_env`
one for PettingZoo, `vector_env` and `single_env` ones for Gymnasium, which the extra `marl` installs. The public names
are those of `__init__.pyi`, imported when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
