"""Settings of the libraries beneath, and limits of the system, with which runs would fail or
differ.

Environment variables that commands refuse stand in commands/refusals.txt.
"""

import multiprocessing
import os
import subprocess
import sys

import jax
import numpy as np
import pytest
from support.small import SMALL

from iswarm_mj import PlanarSettings, Run, make_env
from iswarm_mj.output.loading import load
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils import environment, jax_setup
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.jax_setup import check_devices, check_jax

CLEAN = ["clean", "--engine=planar", "--threads=1", "--robots=3", "--steps=3", "--out=run"]
ISWARM = [sys.executable, "-m", "iswarm_mj"]
HARMLESS = [
    ("JAX_DEBUG_NANS", "1"),
    ("JAX_DEFAULT_MATMUL_PRECISION", "bfloat16"),
    ("JAX_DEFAULT_PRNG_IMPL", "rbg"),
    ("JAX_ENABLE_COMPILATION_CACHE", "0"),
    ("JAX_NUM_CPU_DEVICES", "3"),
    ("JAX_PLATFORMS", "cpu"),
    ("MUJOCO_GL", "egl"),
    ("NUMBA_NUM_THREADS", "1000"),
    ("NUMBA_NUM_THREADS", "x"),
    ("NUMBA_OPT", "0"),
    ("OMP_NUM_THREADS", "0"),
    ("XLA_FLAGS", "--xla_force_host_platform_device_count=4"),
]
IN_PYTHON = [
    ("jax_enable_x64", True),
    ("jax_disable_jit", True),
    ("jax_random_seed_offset", 1),
    ("jax_numpy_dtype_promotion", "strict"),
    ("jax_numpy_rank_promotion", "raise"),
    ("jax_transfer_guard", "disallow"),
    ("jax_no_execution", True),
]
"""Settings of JAX that are refused, which a program in Python can make."""


def run_process(command, **options):
    """Return a process that has ended, with what it printed."""
    return subprocess.run(command, capture_output=True, text=True, **options)


def short_scenario():
    """Return a scenario of three robots."""
    return Scenario(SMALL, robots=3, engine=PlanarSettings(threads=1), steps=5)


class TestSystem:
    @pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits the memory of a process")
    @pytest.mark.parametrize("megabytes", [300, 1000, 2000])
    def test_too_little_address_space_is_refused(self, tmp_path, megabytes):
        import resource

        def limit_memory():
            n_bytes = megabytes * 10**6
            resource.setrlimit(resource.RLIMIT_AS, (n_bytes, n_bytes))

        process = run_process([*ISWARM, *CLEAN], cwd=tmp_path, preexec_fn=limit_memory)
        assert process.returncode == 2, process.stderr
        (line,) = process.stderr.splitlines()
        assert line.startswith("iswarm: the memory of this process ")
        assert f"(got {megabytes / 1000:g} GB)" in line

    @pytest.mark.slow
    @pytest.mark.parametrize(("name", "value"), HARMLESS)
    def test_other_variables_change_nothing(self, tmp_path, name, value):
        def arrays_with(folder, **variables):
            here = tmp_path / folder
            here.mkdir()
            process = run_process([*ISWARM, *CLEAN], cwd=here, env=os.environ | variables)
            assert process.returncode == 0, process.stderr
            return load(here / "run").arrays

        without = arrays_with("without")
        arrays = arrays_with("with", **{name: value})
        assert arrays.keys() == without.keys()
        for key, values in without.items():
            np.testing.assert_array_equal(arrays[key], values)

    def test_an_import_in_python_names_the_variable(self):
        """Before a library fails in its own words."""
        variables = {"MUJOCO_GL": "nonsense"}
        command = [sys.executable, "-c", "import iswarm_mj; iswarm_mj.Run"]
        process = run_process(command, env=os.environ | variables)
        sentence = "UserError: mujoco cannot be imported with MUJOCO_GL=nonsense"
        assert sentence in process.stderr.splitlines()[-1]


WARNING_AND_ERROR = """
import sys
sys.exit('''W1126 15:25:16.05 25 env.cc:23] Old processor
F1126 15:25:16.05 25 env.cc:23] Unknown flag
abort ] trap''')
"""


class TestXlaFlags:
    def test_the_reason_is_the_error_that_ended_xla_and_no_warning(self, monkeypatch):
        monkeypatch.setattr(environment, "_PARSE_XLA_FLAGS", WARNING_AND_ERROR)
        with pytest.raises(UserError, match=r"got --xla_of_a_warning=1: Unknown flag\)"):
            environment._check_xla_flags("--xla_of_a_warning=1")

    def test_flags_that_cannot_be_checked_are_taken(self, monkeypatch):
        monkeypatch.setattr(environment, "_PARSE_XLA_FLAGS", "import time; time.sleep(600)")
        monkeypatch.setattr(environment, "_PATIENCE_S", 0.1)
        environment._check_xla_flags("--xla_that_takes_long=1")

        monkeypatch.setattr(sys, "executable", "/none")
        environment._check_xla_flags("--xla_without_a_process=1")


class TestSettingsOfJax:
    @pytest.fixture
    def restored(self):
        """Restore JAX's settings after the test."""
        before = {name: getattr(jax.config, name) for name, _ in IN_PYTHON}
        yield
        for name, value in before.items():
            jax.config.update(name, value)

    @pytest.mark.usefixtures("restored")
    @pytest.mark.parametrize(("name", "value"), IN_PYTHON)
    def test_they_are_refused_by_name(self, name, value):
        check_jax()
        jax.config.update(name, value)
        sentence = rf"^{name.upper()} must be .* \(got .*{value}.*\); leave it unset$"
        with pytest.raises(UserError, match=sentence):
            check_jax()

    @pytest.mark.usefixtures("restored")
    def test_runs_and_environments_refuse_64_bit_floats(self):
        """Those that begin, and those that go on."""
        scenario = short_scenario()
        run = Run(scenario)
        env = make_env(scenario)
        keys = jax.random.split(jax.random.key(0), 1)
        state = env.reset(keys)
        action = np.zeros((1, 3, env.action_size), np.float32)
        jax.config.update("jax_enable_x64", True)
        for call in (
            run.advance,
            lambda: env.reset(keys),
            lambda: env.step(state, action),
            lambda: Run(scenario),
            lambda: make_env(scenario),
        ):
            with pytest.raises(UserError, match="JAX_ENABLE_X64 must be False"):
                call()

    def test_platforms_without_the_cpu_are_refused(self, monkeypatch):
        """Engines of the host need it, also where a GPU is there."""
        monkeypatch.setattr(jax_setup, "_ALLOWED", {})
        before = jax.config.jax_platforms
        jax.config.update("jax_platforms", "cuda")
        sentence = r"JAX_PLATFORMS must name cpu, too, as cuda,cpu \(got cuda\)"
        try:
            with pytest.raises(UserError, match=sentence):
                check_jax()
        finally:
            jax.config.update("jax_platforms", before)


def send_refusal(pipe):
    """Send the sentence with which a run is refused."""
    try:
        Run(short_scenario())
    except UserError as error:
        pipe.send(str(error))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no forks")
@pytest.mark.filterwarnings("ignore:os.fork")
def test_runs_after_a_fork_are_refused():
    """They would hang; the sentence says to spawn processes."""
    check_devices()
    receiver, sender = multiprocessing.Pipe()
    child = multiprocessing.get_context("fork").Process(target=send_refusal, args=[sender])
    child.start()
    assert receiver.poll(60), "it hangs"
    assert 'multiprocessing.get_context("spawn")' in receiver.recv()
    child.join()
