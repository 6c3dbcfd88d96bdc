"""Importing MJX prints nothing, with Warp or without."""

import os
import subprocess
import sys

import pytest


@pytest.mark.slow
def test_import_prints_nothing_on_standard_output(tmp_path):
    """Without Warp, MJX itself prints on standard output that it is missing."""
    hidden_warp = tmp_path / "warp"
    hidden_warp.mkdir()
    (hidden_warp / "__init__.py").write_text("raise ImportError('hidden')\n")
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}

    def output_of(code: str) -> str:
        command = [sys.executable, "-c", code]
        process = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env=environment,
            check=True,
        )
        return process.stdout

    assert output_of("from mujoco import mjx")
    assert output_of("import iswarm_mj.simulation.compiled_loop") == ""
