"""The electrostatic gripper: force laws, MuJoCo plugins, the bench of one ball, balls in the swarm.

The public names are those of `__init__.pyi`, imported when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
