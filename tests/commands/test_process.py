"""`iswarm clean` in this process and as one of its own: results, faults, interruptions, output,
programs on GPUs."""

import json
import os
import re
import subprocess
import sys

import pytest
from support.cli import ARENA_FLAGS, SMALL, code_of

from iswarm_mj import load
from iswarm_mj._version import __version__ as version
from iswarm_mj.commands.main import parse
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.utils.errors import FaultKind, SimulationFault, UserError


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (
            SimulationFault(step=8, world=0, robots=[5], kind=FaultKind.OUTSIDE),
            1,
            "step 8, world 0: robot 5 left the ",
        ),
        (UserError("`robots` is odd"), 2, "`robots` is odd\n"),
        (
            MemoryError(),
            2,
            "there is not enough memory (none is left); use fewer worlds or robots.\n",
        ),
        (
            OSError(28, "No space left on device"),
            2,
            "the output, or the cache of compiled programs, cannot be read or",
        ),
        (
            PermissionError(13, "Permission denied", "runs/x"),
            2,
            "runs/x cannot be read or written (Permission denied)",
        ),
        (BrokenPipeError(), 141, ""),  # the reader has ended, as in `iswarm inspect ... | head -1`
    ],
)
def test_errors_of_a_command_are_exit_codes_and_sentences(monkeypatch, capfd, error, code, says):
    def broken(self):
        raise error

    monkeypatch.setattr("iswarm_mj.commands.recorded.Inspect.run", broken)
    monkeypatch.setattr("iswarm_mj.commands.main._discard_output", lambda: None)
    assert code_of("inspect") == code
    out, told = capfd.readouterr()
    assert (
        out == ""
        and told.count("\n") == bool(says)
        and told.startswith(f"iswarm: {says}" if says else "")
    )


def test_an_interruption_leaves_at_once():
    """Else programs of Warp would call Python from their own threads while it shuts down, and crash
    or hang."""
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
        command = [
            sys.executable,
            "-m",
            "iswarm_mj",
            "clean",
            *SMALL,
            "--steps",
            "2",
            "--out",
            "out",
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        told = [
            line
            for line in done.stderr.splitlines()
            if not re.match("iswarm: (placing|preparing) ", line)
        ]
        assert (done.returncode, told) == (0, [])
        assert sorted(path.name for path in here.iterdir()) == ["out"]
        names = sorted(path.name for path in (here / "out").iterdir())
        assert names == ["clean.rrd", "result.json", "trajectory.npz"]

    @pytest.mark.parametrize(
        "closed",
        [
            *(pytest.param(one, marks=pytest.mark.slow) for one in ("<&-", ">&-", "2>&-")),
            "<&- >&- 2>&-",
        ],
    )
    def test_closed_streams_are_no_fault(self, here, closed):
        """A file that is opened must not get the number of such a stream, into which libraries
        print."""
        command = [sys.executable, "-m", "iswarm_mj", "clean", *SMALL, "--steps=1", "--out=out"]
        shell = ["sh", "-c", f'"$@" {closed}', "sh", *command]
        done = subprocess.run(shell, capture_output=True, text=True, check=False)
        assert (
            done.returncode == 0
            and "Traceback" not in done.stderr
            and "NoneType" not in done.stderr
        )
        assert ("results" in done.stdout) == (">&-" not in closed.replace("2>&-", ""))
        assert load("out").arrays["step"].tolist() == [0, 1]

    @pytest.mark.parametrize("columns", ["1", "5"])
    def test_help_on_narrow_terminals(self, columns):
        """Tyro alone does not end there."""
        command = [sys.executable, "-m", "iswarm_mj", "clean", "--help"]
        environment = os.environ | {"COLUMNS": columns}
        done = subprocess.run(
            command, capture_output=True, text=True, check=True, env=environment, timeout=300
        )
        assert "--robots" in done.stdout

    @pytest.mark.parametrize(
        ("name", "remedy"),
        [("ä".encode(), "set PYTHONUTF8=1"), (b"\xe4", "rename what is named so")],
    )
    def test_names_that_the_environment_cannot_read_as_text(self, name, remedy):
        command = [sys.executable, "-m", "iswarm_mj", "clean", b"--out=" + name]
        environment = os.environ | {"PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONIOENCODING": "utf-8"}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 2 and done.stderr.count("\n") == 1
        assert remedy in done.stderr


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
        done = subprocess.run(
            [sys.executable, str(script)], capture_output=True, text=True, check=False, env=env
        )
        assert done.stdout == "[3.0] True\n", done.stderr
        assert sorted(path.name for path in here.iterdir()) == ["file", "kernel.py"]

    @pytest.mark.parametrize(("has_gpu", "impl"), [(True, "warp"), (False, "numba")])
    def test_is_the_default_where_there_is_a_gpu(self, monkeypatch, has_gpu, impl):
        monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: has_gpu)
        assert parse(["bench", "--engine", "planar"]).engine_settings.impl == impl
        assert (
            parse(["bench", "--engine", "planar", "--impl", "numba"]).engine_settings.impl
            == "numba"
        )
        assert parse(["bench", "--engine", "mjx"]).engine_settings.impl == (
            "warp" if has_gpu else "jax"
        )


def test_the_genome_is_a_file_with_single_parameters_and_tells_the_density(here):
    (here / "mine.json").write_text('{"p_vector_forget": 0.5, "fraction_scouts": 0.2}')
    parameters = ["--genome=mine.json", "--fraction-scouts=0.4", "--no-use-hop-count"]
    genome = parse(["clean", *parameters]).rules
    assert genome == Genome(p_vector_forget=0.5, fraction_scouts=0.4, use_hop_count=False)
    for flags, n_robots in (([], 25), (["--genome", "type2"], 29), (["--density", "0.05"], 11)):
        assert parse(["clean", *ARENA_FLAGS, *flags]).number_of_robots() == n_robots
        assert parse(["play", *ARENA_FLAGS, *flags]).session().run.settings.n_robots == n_robots


def test_quick_experiments_have_directories_of_their_own(monkeypatch):
    given = []
    monkeypatch.setattr(
        "iswarm_mj.paper.studies.experiment.run_experiment",
        lambda *args, again: given.append((*args, again)),
    )
    for flags in (
        [],
        ["--quick", "--again"],
        ["--quick", "--out=here", "--seed=3", "--genome=type2"],
    ):
        parse(["experiment", "density", *flags]).run()
    assert [str(out) for _, _, out, *_ in given] == [
        *map("runs/experiments/density{}".format, ("", "-quick")),
        "here",
    ]
    assert [(plan.quick, plan.seed, again) for _, plan, *_, again in given] == [
        (False, 0, False),
        (True, 0, True),
        (True, 3, False),
    ]
    assert given[2][1].genome == PRESETS["type2"]


def test_version(capfd):
    assert code_of("--version") == 0
    assert capfd.readouterr() == (f"iswarm {version}\n", "")
