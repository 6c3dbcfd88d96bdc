"""Environment variables and settings of the libraries beneath, with which runs would fail or
differ: one sentence."""

import multiprocessing
import os
import resource
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
REFUSED = [
    ("JAX_ENABLE_X64", "1"),
    ("JAX_ENABLE_X64", "nonsense"),
    ("JAX_PLATFORMS", "cuda"),
    ("JAX_PLATFORMS", "nonsense,cpu"),
    ("JAX_PLATFORM_NAME", "nonsense"),
    ("JAX_DEFAULT_DEVICE", "gpu"),
    ("JAX_NUM_CPU_DEVICES", "0"),
    ("MUJOCO_GL", "nonsense"),
    ("NUMBA_DISABLE_JIT", "1"),
    ("NUMBA_NUM_THREADS", "0"),
    ("XLA_FLAGS", "nonsense"),
    ("XLA_FLAGS", "--xla_nonsense=1"),
]
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


def run(here, **variables):
    """The process of a short run in a directory."""
    env = os.environ | variables
    return subprocess.run([*ISWARM, *CLEAN], capture_output=True, text=True, env=env, cwd=here)


@pytest.mark.parametrize(("name", "value"), REFUSED)
def test_variables_are_refused_by_name(tmp_path, name, value):
    done = run(tmp_path, **{name: value})
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("iswarm: ") and name in line and (value in line or value == "1")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("megabytes", [300, 1000, 2000])
def test_too_little_address_space_is_refused(tmp_path, megabytes):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (megabytes * 10**6, megabytes * 10**6))

    done = subprocess.run(
        [*ISWARM, *CLEAN], capture_output=True, text=True, cwd=tmp_path, preexec_fn=limit
    )
    assert done.returncode == 2, done.stderr
    (line,) = done.stderr.splitlines()
    assert (
        line.startswith("iswarm: the memory of this process ")
        and f"(got {megabytes / 1000:g} GB)" in line
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value"), HARMLESS)
def test_other_variables_change_nothing(tmp_path, name, value):
    arrays = []
    for number, variables in enumerate(({}, {name: value})):
        here = tmp_path / str(number)
        here.mkdir()
        done = run(here, **variables)
        assert done.returncode == 0, done.stderr
        arrays.append(load(here / "run").arrays)
    assert arrays[0].keys() == arrays[1].keys()
    for key, values in arrays[0].items():
        np.testing.assert_array_equal(values, arrays[1][key])


def test_python_is_told_before_a_library_fails():
    code = "import iswarm_mj; iswarm_mj.Run"
    env = os.environ | {"MUJOCO_GL": "nonsense"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert (
        "UserError: mujoco cannot be imported with MUJOCO_GL=nonsense"
        in done.stderr.splitlines()[-1]
    )


FATAL = """
import sys
sys.exit("W1126 15:25:16.05 25 env.cc:23] Old processor\\nF1126 15:25:16.05 25 env.cc:23] Unknown flag\\nabort ] trap")
"""


def test_the_reason_is_what_ended_xla_and_no_warning(monkeypatch):
    monkeypatch.setattr(environment, "_PARSE_XLA_FLAGS", FATAL)
    with pytest.raises(UserError, match="got --xla_of_a_warning=1: Unknown flag\\)"):
        environment._check_xla_flags("--xla_of_a_warning=1")


def test_flags_that_cannot_be_checked_are_taken(monkeypatch):
    monkeypatch.setattr(environment, "_PARSE_XLA_FLAGS", "import time; time.sleep(600)")
    monkeypatch.setattr(environment, "_PATIENCE_S", 0.1)
    environment._check_xla_flags("--xla_that_takes_long=1")
    monkeypatch.setattr(sys, "executable", "/none")
    environment._check_xla_flags("--xla_without_a_process=1")


@pytest.fixture
def restored():
    """JAX's settings are as before after the test."""
    before = {name: getattr(jax.config, name) for name, _ in IN_PYTHON}
    yield
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.mark.usefixtures("restored")
@pytest.mark.parametrize(("name", "value"), IN_PYTHON)
def test_settings_in_python_are_refused_by_name(name, value):
    check_jax()
    jax.config.update(name, value)
    with pytest.raises(
        UserError, match=rf"^{name.upper()} must be .* \(got .*{value}.*\); leave it unset$"
    ):
        check_jax()


@pytest.mark.usefixtures("restored")
def test_runs_and_environments_refuse_64_bit_floats():
    """Those that begin, and those that go on."""
    engine = PlanarSettings(threads=1)
    scenario = Scenario(SMALL, robots=3, engine=engine, steps=5)
    begun, env = Run(scenario), make_env(scenario)
    state = env.reset(jax.random.split(jax.random.key(0), 1))
    jax.config.update("jax_enable_x64", True)
    for act in (
        begun.advance,
        lambda: env.reset(jax.random.split(jax.random.key(0), 1)),
        lambda: env.step(state, np.zeros((1, 3, env.action_size), np.float32)),
        lambda: Run(scenario),
        lambda: make_env(scenario),
    ):
        with pytest.raises(UserError, match="JAX_ENABLE_X64 must be False"):
            act()


def test_platforms_without_the_cpu_are_refused(monkeypatch):
    """Engines of the host need it, also where a GPU is there."""
    monkeypatch.setattr(jax_setup, "_ALLOWED", {})
    before = jax.config.jax_platforms
    jax.config.update("jax_platforms", "cuda")
    try:
        with pytest.raises(
            UserError, match=r"JAX_PLATFORMS must name cpu, too, as cuda,cpu \(got cuda\)"
        ):
            check_jax()
    finally:
        jax.config.update("jax_platforms", before)


def _say_what_is_raised(pipe):
    try:
        Run(Scenario(SMALL, robots=3, engine=PlanarSettings(threads=1), steps=5))
    except UserError as error:
        pipe.send(str(error))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no forks")
@pytest.mark.filterwarnings("ignore:os.fork")
def test_runs_after_a_fork_say_to_spawn():
    check_devices()
    here, there = multiprocessing.Pipe()
    child = multiprocessing.get_context("fork").Process(target=_say_what_is_raised, args=[there])
    child.start()
    assert here.poll(60), "it hangs"
    assert 'multiprocessing.get_context("spawn")' in here.recv()
    child.join()
