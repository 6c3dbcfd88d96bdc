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
    """Whether pictures can be drawn here; asked in a process of its own, since a failure may be
    fatal."""
    code = "import mujoco; mujoco.GLContext(8, 8).make_current()"
    environment = (
        {**os.environ, "MUJOCO_GL": "egl"} if sys.platform == "linux" else dict(os.environ)
    )
    return (
        subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True
        ).returncode
        == 0
    )


needs_opengl = pytest.mark.skipif(not has_off_screen_opengl(), reason="no off-screen OpenGL")


def of_colour(pixels, colour):
    """Which pixels (..., 3) have a colour, whatever the light."""
    wanted = np.array(rgb(colour), float)
    lengths = np.linalg.norm(pixels, axis=-1)
    return (pixels @ wanted > 0.98 * lengths * np.linalg.norm(wanted)) & (lengths > 90)
