"""MJX as the rest of the package uses it, with the few private parts that are needed, imported in silence.

Where Warp is not installed, MJX prints so on standard output, which belongs to the results.
"""

import contextlib
import io

with contextlib.redirect_stdout(io.StringIO()):
    from mujoco import mjx
    from mujoco.mjx._src import collision_driver, solver  # the table of contact functions; the solver
    from mujoco.mjx._src.support import mul_m  # the product with the inertia matrix

__all__ = ["collision_driver", "mjx", "mul_m", "solver"]
