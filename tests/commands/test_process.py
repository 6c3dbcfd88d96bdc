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
from helpers_worlds import begin_with, start_of

from iswarm_mj.commands.main import parse
from iswarm_mj.commands.swarm import Swarm
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

    def test_of_one_world_leave_the_others_their_results(self, capfd, monkeypatch):
        flags = (*SMALL, "--worlds=3", "--steps=30", "--no-record")
        assert code_of("clean", *flags, "--out=healthy") == 0
        config = parse(["clean", *SMALL]).config
        start = start_of(config, 30, 0, 1)
        start.poses[3, 0] = 50.0
        begin_with(monkeypatch, {1: start})
        assert code_of("clean", *flags, "--out=out") == 1
        out, error = capfd.readouterr()
        assert out.count("30 in 3 world(s)") == 2
        told = [line for line in error.splitlines() if "compiling" not in line]  # which takes long on busy machines
        assert told[0].startswith("iswarm: step 1, world 1: robot 3 left the arena; increase --drive.walk-substeps")
        healthy, content = result("healthy"), result("out")
        assert healthy["faults"] == [] and len(content["faults"]) == 1
        assert content["faults"][0].startswith("step 1, world 1: robot 3 left the arena; ")
        for name in ("collisions", "picked", "delivered", "fitness"):
            assert [content[name][world] for world in (0, 2)] == [healthy[name][world] for world in (0, 2)]
        assert content["collisions"][1] == 0 < healthy["collisions"][1] and content["steps"] == 30


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
        told = [line for line in done.stderr.splitlines() if not re.match("iswarm: (placing|compiling) ", line)]
        assert (done.returncode, told) == (0, [])
        assert sorted(path.name for path in here.iterdir()) == ["out"]
        names = sorted(path.name for path in (here / "out").iterdir())
        assert names == ["clean.rrd", "result.json", "trajectory.npz"]

    def test_refusal(self, here):
        command = [sys.executable, "-m", "iswarm_mj", "clean", "--density", "7"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == "iswarm: --density must be above 0 and at most 1 (got 7.0)\n"
        assert list(here.iterdir()) == []


def test_bench_prints_one_line(capfd, here):
    assert code_of("bench", *SMALL, "--steps", 5, "--warm-up", 2) == 0
    content = json.loads(capfd.readouterr().out)
    assert (content["n_robots"], content["steps"], content["engine"]) == (30, 5, "mujoco")
    stages = sum(content[f"{stage}_ms"] for stage in ("sense", "policy", "physics"))
    assert 0 < stages < 2 * content["ms_per_step"]
    assert list(here.iterdir()) == []


class TestPlanarInBatches:
    FLAGS = ("--engine", "planar", "--impl", "warp", "--worlds", 2)

    def test_clean(self, capfd):
        assert code_of("clean", *SMALL[1:], *self.FLAGS, "--steps", 20, "--seed", 3) == 0
        content = result()
        assert (content["engine"], content["impl"], content["refinement"]) == ("planar", "warp", 10)
        assert content["steps"] == 20 and min(content["collisions"]) > 0 and content["faults"] == []
        assert "30 in 2 world(s), seed 3" in capfd.readouterr().out
        with np.load("runs/clean/trajectory.npz") as file:
            assert len(file["step"]) == 21 and np.isfinite(file["pose"]).all()

    def test_bench_prints_one_line_alone_while_kernels_are_compiled(self, here):
        flags = [*self.FLAGS, "--refinement=2", "--steps=2", "--warm-up=1"]
        command = [sys.executable, "-m", "iswarm_mj", "bench", *SMALL[1:], *map(str, flags)]
        env = os.environ | {"WARP_CACHE_PATH": str(here / "cache")}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=env)
        content = json.loads(done.stdout)
        assert done.stdout.count("\n") == 1 and any((here / "cache").iterdir())
        assert (content["engine"], content["impl"], content["refinement"]) == ("planar", "warp", 2)
        assert len(content["devices"]) == 1 and content["n_worlds"] == 2

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
        monkeypatch.setattr("iswarm_mj.engines.planar.settings.can_use_warp", lambda: has_gpu)
        assert Swarm(engine="planar").implementation == impl
        assert Swarm(engine="planar", impl="numba").implementation == "numba"
        assert Swarm(engine="mujoco").implementation is None and Swarm(engine="mjx").implementation == "jax"
