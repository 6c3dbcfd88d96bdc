"""`iswarm clean` in this process and as one of its own: results, faults, interruptions, output, programs on GPUs."""

import json
import os
import re
import subprocess
import sys
from dataclasses import asdict

import numpy as np
import pytest
from helpers_cli import ARENA_FLAGS, SMALL, code_of, result
from helpers_rrd import read

from iswarm_mj import __version__ as version
from iswarm_mj.commands.main import parse
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.strategy.genome import PRESETS, Genome


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


class TestClean:
    def test_writes_results_and_prints_a_summary(self, small, capfd):
        assert code_of("clean", *SMALL, "--steps", 30, "--seed", 3) == 0
        out, _ = capfd.readouterr()
        content = result()
        assert content["config"] == json.loads(json.dumps(asdict(small)))
        assert (content["seed"], content["n_robots"], content["steps"], content["stop_at"]) == (3, 30, 30, 24)
        assert content["genome"] == asdict(PRESETS["type1"]) and content["engine"] == "mujoco"
        for line in (
            "robots  30 in 1 world(s), seed 3",
            f"delivered  {content['delivered']} of 24 balls; picked up {content['picked']}",
            f"collisions  {content['collisions']}",
            f"fitness  {content['fitness']:.1f}",
        ):
            assert line in out
        with np.load("runs/clean/trajectory.npz") as file:
            assert file["delivered"][-1] == content["delivered"] and len(file["step"]) == 31

    def test_stop_at(self):
        assert code_of("clean", *SMALL, "--no-record", "--stop-at", 2, "--seed", 1) == 0
        content = result()
        assert 2 <= content["delivered"] < 24 and content["steps"] == content["finished_at"] < 800

    def test_a_genome_file_and_single_parameters(self, here):
        (here / "mine.json").write_text('{"p_vector_forget": 0.5, "fraction_scouts": 0.2}')
        parameters = ["--genome=mine.json", "--fraction-scouts=0.4", "--use-hop-count=False"]
        assert code_of("clean", *SMALL, *parameters, "--steps=2", "--no-record") == 0
        expected = asdict(Genome(p_vector_forget=0.5, fraction_scouts=0.4, use_hop_count=False))
        assert result()["genome"] == expected

    def test_the_genome_tells_the_density(self):
        for flags, n_robots in (([], 25), (["--genome", "type2"], 29), (["--density", "0.05"], 11)):
            assert number_of_robots(*ARENA_FLAGS, *flags) == n_robots


def number_of_robots(*flags):
    """Number of robots that a run would have, without the run."""
    seen = []

    def clean(run, *_):
        seen.append(run.settings.n_robots)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("iswarm_mj.workflows.clean.clean", clean)
        assert code_of("clean", *flags) == 0
    return seen[0]


def test_version(capfd):
    assert code_of("--version") == 0
    assert capfd.readouterr() == (f"iswarm {version}\n", "")
