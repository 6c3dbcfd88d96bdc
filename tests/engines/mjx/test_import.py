"""MJX is imported in silence, with Warp or without."""

import os
import subprocess
import sys


def test_import_prints_nothing_on_standard_output(tmp_path):
    """Without Warp, MJX prints on standard output that it is missing."""
    (tmp_path / "warp").mkdir()
    (tmp_path / "warp" / "__init__.py").write_text("raise ImportError('hidden')\n")
    env = os.environ | {"PYTHONPATH": str(tmp_path)}

    def said(code: str) -> str:
        return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=True).stdout

    assert said("from mujoco import mjx")
    assert said("import iswarm_mj.simulation.compiled_loop") == ""
