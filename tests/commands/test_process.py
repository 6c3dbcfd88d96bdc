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

ISWARM = [sys.executable, "-m", "iswarm_mj"]


def run_process(command, **options):
    """Return a process that has ended, with what it printed."""
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


class TestErrors:
    @pytest.fixture(autouse=True)
    def stdout_stays(self, monkeypatch):
        """Keep the output of the tests where the command discards its own."""
        monkeypatch.setattr("iswarm_mj.commands.main._discard_output", lambda: None)

    def end_with(self, error, monkeypatch, capfd):
        """Return the exit code of a command that raises an error, and what it prints on stderr."""

        def run(command):
            raise error

        monkeypatch.setattr("iswarm_mj.commands.recorded.Inspect.run", run)
        code = code_of("inspect")
        output, printed = capfd.readouterr()
        assert output == ""
        return code, printed

    @pytest.mark.parametrize(
        ("error", "code", "beginning"),
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
                "there is not enough memory (none is left); use fewer worlds or robots\n",
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
        ],
    )
    def test_they_are_exit_codes_and_sentences(self, monkeypatch, capfd, error, code, beginning):
        actual_code, printed = self.end_with(error, monkeypatch, capfd)
        assert actual_code == code
        assert printed.startswith(f"iswarm: {beginning}")
        assert printed.count("\n") == 1

    def test_a_reader_that_ends_is_none(self, monkeypatch, capfd):
        """`iswarm inspect ... | head -1` does so."""
        assert self.end_with(BrokenPipeError(), monkeypatch, capfd) == (141, "")


INTERRUPTED = """
import atexit, types
from iswarm_mj.commands import main as cli

def interrupted():
    raise KeyboardInterrupt

atexit.register(print, "Python has ended")
cli.parse = lambda _: types.SimpleNamespace(run=interrupted)
cli.main()
"""


def test_an_interruption_leaves_at_once():
    """Without Python's own end: programs of Warp would call Python from their own threads while it
    shuts down, and crash or hang."""
    process = run_process([sys.executable, "-c", INTERRUPTED])
    assert (process.returncode, process.stdout) == (130, "")
    assert process.stderr.splitlines()[-1].startswith("iswarm: interrupted")


class TestProcess:
    def test_clean_prints_progress_and_writes_its_directory_alone(self, here):
        process = run_process([*ISWARM, "clean", *SMALL, "--steps=2", "--out=out"])
        assert process.returncode == 0
        for line in process.stderr.splitlines():
            assert re.match("iswarm: (placing|preparing) ", line)
        assert [path.name for path in here.iterdir()] == ["out"]
        names = {path.name for path in (here / "out").iterdir()}
        assert names == {"clean.rrd", "result.json", "trajectory.npz"}

    @pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
    @pytest.mark.slow
    def test_closed_streams_are_no_fault(self, here, closed):
        """A file that is opened must not get the number of such a stream, into which libraries
        print."""
        command = [*ISWARM, "clean", *SMALL, "--steps=1", "--out=out"]
        process = run_process(["sh", "-c", f'"$@" {closed}', "sh", *command])
        assert process.returncode == 0
        assert "Traceback" not in process.stderr
        assert "NoneType" not in process.stderr
        is_output_closed = ">&-" in closed.split()
        assert ("results" in process.stdout) == (not is_output_closed)
        assert load("out").arrays["step"].tolist() == [0, 1]

    @pytest.mark.parametrize("columns", ["1", "5"])
    def test_help_on_narrow_terminals(self, columns):
        """Tyro alone does not end there."""
        environment = os.environ | {"COLUMNS": columns}
        process = run_process([*ISWARM, "clean", "--help"], env=environment, timeout=300)
        assert process.returncode == 0
        assert "--robots" in process.stdout

    @pytest.mark.parametrize(
        ("name", "remedy"),
        [("ä".encode(), "set PYTHONUTF8=1"), (b"\xe4", "rename what is named so")],
    )
    def test_names_that_the_environment_cannot_read_as_text(self, name, remedy):
        environment = os.environ | {"PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONIOENCODING": "utf-8"}
        process = run_process([*ISWARM, "clean", b"--out=" + name], env=environment)
        assert process.returncode == 2
        assert process.stderr.count("\n") == 1
        assert remedy in process.stderr


KERNEL = """
import warp as wp
from iswarm_mj.engines.planar.gpu import functions

@wp.kernel
def double(values: wp.array(dtype=float)):
    values[wp.tid()] = 2.0 * values[wp.tid()]

values = wp.array([1.5], dtype=float, device="cpu")
wp.launch(double, 1, [values], device="cpu")
print(values.numpy().tolist(), functions.os.listdir(wp.config.kernel_cache_dir) != [])
"""


class TestPlanarInBatches:
    @pytest.mark.slow
    def test_bench_prints_one_line_alone_while_kernels_are_compiled(self, here):
        flags = ["--engine=planar", "--impl=warp", "--worlds=2", "--refinement=2"]
        flags += ["--steps=2", "--warm-up=1"]
        environment = os.environ | {"WARP_CACHE_PATH": str(here / "cache")}
        arena = [flag for flag in SMALL if "threads" not in flag]
        process = run_process([*ISWARM, "bench", *arena, *flags], env=environment)
        assert process.returncode == 0
        assert process.stdout.count("\n") == 1
        assert any((here / "cache").iterdir())

        times = json.loads(process.stdout)
        assert (times["engine"], times["impl"], times["refinement"]) == ("planar", "warp", 2)
        assert (len(times["devices"]), times["n_worlds"]) == (1, 2)

    @pytest.mark.slow
    def test_kernels_need_no_cache(self, here):
        """They are compiled below TMPDIR, and removed in the end."""
        (here / "file").touch()
        no_cache = {"WARP_CACHE_PATH": str(here / "file" / "cache"), "TMPDIR": str(here)}
        # A file, since Warp reads the source of kernels.
        script = here / "kernel.py"
        script.write_text(KERNEL)
        process = run_process([sys.executable, str(script)], env=os.environ | no_cache)
        assert process.stdout == "[3.0] True\n", process.stderr
        assert sorted(path.name for path in here.iterdir()) == ["file", "kernel.py"]

    @pytest.mark.parametrize(("has_gpu", "impl"), [(True, "warp"), (False, "numba")])
    def test_is_the_default_where_there_is_a_gpu(self, monkeypatch, has_gpu, impl):
        monkeypatch.setattr("iswarm_mj.engines.settings.can_use_warp", lambda: has_gpu)

        def impl_of(*flags):
            return parse(["bench", *flags]).engine_settings.impl

        assert impl_of("--engine=planar") == impl
        assert impl_of("--engine=planar", "--impl=numba") == "numba"
        assert impl_of("--engine=mjx") == ("warp" if has_gpu else "jax")


class TestGenome:
    @pytest.fixture(autouse=True)
    def mine_json(self, here):
        (here / "mine.json").write_text('{"p_vector_forget": 0.5, "fraction_scouts": 0.2}')

    def test_flags_override_the_file(self):
        flags = ["--genome=mine.json", "--fraction-scouts=0.4", "--no-use-hop-count"]
        genome = parse(["clean", *flags]).rules
        assert genome == Genome(p_vector_forget=0.5, fraction_scouts=0.4, use_hop_count=False)

    @pytest.mark.parametrize(
        ("flags", "n_robots"),
        [([], 25), (["--genome", "type2"], 29), (["--density", "0.05"], 11)],
    )
    def test_it_sets_the_density(self, flags, n_robots):
        assert parse(["clean", *ARENA_FLAGS, *flags]).number_of_robots() == n_robots
        session = parse(["play", *ARENA_FLAGS, *flags]).session()
        assert session.run.settings.n_robots == n_robots


@pytest.mark.parametrize(
    ("flags", "out", "is_quick", "seed", "again"),
    [
        ([], "runs/experiments/density", False, 0, False),
        (["--quick", "--again"], "runs/experiments/density-quick", True, 0, True),
        (["--quick", "--out=here", "--seed=3"], "here", True, 3, False),
    ],
)
def test_quick_experiments_have_directories_of_their_own(
    monkeypatch, flags, out, is_quick, seed, again
):
    calls = []
    monkeypatch.setattr(
        "iswarm_mj.paper.studies.experiment.run_experiment",
        lambda *values, again: calls.append((*values, again)),
    )
    parse(["experiment", "density", "--genome=type2", *flags]).run()
    ((_, plan, directory, _, is_repeated),) = calls
    assert str(directory) == out
    assert (plan.quick, plan.seed, is_repeated) == (is_quick, seed, again)
    assert plan.genome == PRESETS["type2"]


def test_version(capfd):
    assert code_of("--version") == 0
    assert capfd.readouterr() == (f"iswarm {version}\n", "")
