"""The program as a process: faults, interruptions, help, output, and programs on GPUs."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from helpers_cli import SMALL, code_of, result
from helpers_rrd import read

from iswarm_mj.commands.main import parse
from iswarm_mj.engines.mujoco.engine import MujocoEngine


class TestFaults:
    def test_ends_with_code_1_and_readable_files(self, capfd, here, monkeypatch):
        move, steps = MujocoEngine.move, iter(range(1, 99))

        def faulty(self, bodies, phases, is_running):
            if next(steps) == 8:
                self._qpos[0, self._arena.qpos[[5, 6], 2]] = np.nan
            return move(self, bodies, phases, is_running)

        monkeypatch.setattr(MujocoEngine, "move", faulty)
        assert code_of("clean", *SMALL, "--steps", 20, "--out", "out") == 1
        error = capfd.readouterr().err.splitlines()[-1]  # after MuJoCo's own warnings
        assert re.fullmatch(r"iswarm: step 8, world 0: the pose of robot 5 is not finite; [^\n]*", error)
        assert sorted(path.name for path in (here / "out").iterdir()) == ["clean.rrd", "result.json", "trajectory.npz"]
        with np.load("out/trajectory.npz") as file:
            assert file["step"].tolist() == list(range(9)) and np.isfinite(file["pose"]).all()
        assert read("out/clean.rrd")["/world/robots/body"]["step"] == list(range(9))
        (fault,) = result("out")["faults"]
        assert fault.startswith("step 8, world 0: the pose of robot 5 is not finite; ")


def test_interruption_ends_quietly(capfd, here, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(MujocoEngine, "sense", interrupted)
    assert code_of("clean", *SMALL, "--steps", 20, "--out", "out") == 130
    assert "Traceback" not in capfd.readouterr().err
    assert result("out")["interrupted"] and result("out")["steps"] == 0


def test_an_interruption_leaves_at_once():
    """Else programs of Warp would call Python from their own threads while it shuts down, and crash or hang."""
    code = """
import atexit, types
from iswarm_mj.commands import main as cli
def interrupted():
    raise KeyboardInterrupt
atexit.register(print, "Python has ended")
cli.parse = lambda _: types.SimpleNamespace(run=interrupted)
cli.main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr.splitlines()[-1].startswith("iswarm: interrupted")


class TestProcess:
    def test_clean_from_another_directory(self, here):
        command = [sys.executable, "-m", "iswarm_mj", "clean", *SMALL, "--steps", "2", "--out", "out"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        told = [line for line in done.stderr.splitlines() if not re.match("iswarm: (placing|preparing) ", line)]
        assert (done.returncode, told) == (0, [])
        assert sorted(path.name for path in here.iterdir()) == ["out"]
        names = sorted(path.name for path in (here / "out").iterdir())
        assert names == ["clean.rrd", "result.json", "trajectory.npz"]


def test_a_reader_that_has_ended_is_no_error(monkeypatch, capfd):
    """As `iswarm inspect ... | head -1`."""

    def broken(self):
        raise BrokenPipeError

    monkeypatch.setattr("iswarm_mj.commands.recorded.Inspect.run", broken)
    monkeypatch.setattr("iswarm_mj.commands.main._discard_output", lambda: None)
    assert code_of("inspect") == 141 and capfd.readouterr() == ("", "")


class TestPlanarInBatches:
    FLAGS = ("--engine", "planar", "--impl", "warp", "--worlds", 2)

    @pytest.mark.slow
    def test_bench_prints_one_line_alone_while_kernels_are_compiled(self, here):
        flags = [*self.FLAGS, "--refinement=2", "--steps=2", "--warm-up=1"]
        command = [sys.executable, "-m", "iswarm_mj", "bench", *SMALL[1:], *map(str, flags)]
        env = os.environ | {"WARP_CACHE_PATH": str(here / "cache")}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
        content = json.loads(done.stdout)
        assert done.stdout.count("\n") == 1 and any((here / "cache").iterdir())
        assert (content["engine"], content["impl"], content["refinement"]) == ("planar", "warp", 2)
        assert len(content["devices"]) == 1 and content["n_worlds"] == 2

    @pytest.mark.slow
    def test_kernels_need_no_cache(self, here):
        (here / "file").touch()
        env = os.environ | {"WARP_CACHE_PATH": str(here / "file" / "cache"), "TMPDIR": str(here)}
        script = here / "kernel.py"  # since Warp reads its kernels' source
        script.write_text("""
import warp as wp
from iswarm_mj.engines.planar.gpu import functions
@wp.kernel
def double(values: wp.array(dtype=float)):
    values[wp.tid()] = 2.0 * values[wp.tid()]
values = wp.array([1.5], dtype=float, device="cpu")
wp.launch(double, 1, [values], device="cpu")
print(values.numpy().tolist(), functions.os.listdir(wp.config.kernel_cache_dir) != [])
""")
        done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False, env=env)
        assert done.stdout == "[3.0] True\n", done.stderr
        assert sorted(path.name for path in here.iterdir()) == ["file", "kernel.py"]

    @pytest.mark.parametrize(("has_gpu", "impl"), [(True, "warp"), (False, "numba")])
    def test_is_the_default_where_there_is_a_gpu(self, monkeypatch, has_gpu, impl):
        monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: has_gpu)
        assert parse(["bench", "--engine", "planar"]).engine_settings.impl == impl
        assert parse(["bench", "--engine", "planar", "--impl", "numba"]).engine_settings.impl == "numba"
        assert parse(["bench", "--engine", "mjx"]).engine_settings.impl == ("warp" if has_gpu else "jax")
