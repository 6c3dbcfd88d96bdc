"""Off-screen OpenGL, which pictures need."""

import os
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

from iswarm_mj.output.palette import rgb


@cache
def has_off_screen_opengl():
    """Return whether pictures can be drawn on this machine.

    A process of its own tries it, since a failure may be fatal.
    """
    code = "import mujoco; mujoco.GLContext(8, 8).make_current()"
    environment = dict(os.environ)
    if sys.platform == "linux":
        environment["MUJOCO_GL"] = "egl"
    process = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True)
    return process.returncode == 0


needs_opengl = pytest.mark.skipif(not has_off_screen_opengl(), reason="no off-screen OpenGL")


def of_colour(pixels, colour):
    """Return which pixels (..., 3) have a colour, whatever the light."""
    wanted = np.array(rgb(colour), float)
    lengths = np.linalg.norm(pixels, axis=-1)
    is_parallel = pixels @ wanted > 0.98 * lengths * np.linalg.norm(wanted)
    is_lit = lengths > 90
    return is_parallel & is_lit
