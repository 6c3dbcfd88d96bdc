"""Off-screen OpenGL, which pictures need."""

import os
import subprocess
import sys
from functools import cache

import pytest


@cache
def has_off_screen_opengl():
    """Whether pictures can be drawn here; asked in a process of its own, since a failure may be fatal."""
    code = "import mujoco; mujoco.GLContext(8, 8).make_current()"
    environment = {**os.environ, "MUJOCO_GL": "egl"} if sys.platform == "linux" else dict(os.environ)
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True).returncode == 0


needs_opengl = pytest.mark.skipif(not has_off_screen_opengl(), reason="no off-screen OpenGL")
