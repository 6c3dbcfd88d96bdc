"""Settings of JAX: where it keeps compiled programs, unless the user has set that."""

import os
import platform
import subprocess
import sys

import pytest

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.jax_setup import devices

CONFIGURE = """
import os, iswarm_mj
from iswarm_mj.utils.jax_setup import configure_jax
import jax
{before}
configure_jax()
configure_jax()
{after}
print(jax.config.jax_compilation_cache_dir, os.environ["TF_CPP_MIN_LOG_LEVEL"])
"""
COMPILE = "jax.jit(lambda x: x @ x.T)(jax.numpy.ones((9, 9))).block_until_ready()"
UNSET = ("JAX_COMPILATION_CACHE_DIR", "XDG_CACHE_HOME", "TF_CPP_MIN_LOG_LEVEL")


def cache_and_log_level(before="", after="", **variables):
    """Return the directory of the cache and the level of XLA's log, in a process of its own.

    Args:
        before: statements before JAX is configured.
        after: statements after that.
        variables: of the environment.
    """
    inherited = {name: value for name, value in os.environ.items() if name not in UNSET}
    process = subprocess.run(
        [sys.executable, "-c", CONFIGURE.format(before=before, after=after)],
        env=inherited | variables,
        capture_output=True,
        text=True,
        check=True,
    )
    assert process.stderr == ""
    return process.stdout.split()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="directories of Linux")
def test_programs_are_kept_in_the_users_cache_and_loading_them_prints_nothing(tmp_path):
    variables = {"XDG_CACHE_HOME": str(tmp_path), "JAX_PLATFORMS": "cpu"}
    cache = tmp_path / "iswarm_mj" / f"jax-{platform.node()}"
    for _ in range(2):
        assert cache_and_log_level(after=COMPILE, **variables) == [str(cache), "3"]
    assert any(cache.iterdir())


def test_settings_made_in_python_or_the_environment_are_left_alone():
    before = 'jax.config.update("jax_compilation_cache_dir", "/mine")'
    assert cache_and_log_level(before, TF_CPP_MIN_LOG_LEVEL="0") == ["/mine", "0"]


@pytest.mark.parametrize("count", ["٣", "0", "1.0", "", "1000"])
def test_devices_that_are_not_there_are_refused(count):
    sentence = r"^devices must be all, or between 1 and \d+, .*JAX sees \(cpu\) \(got "
    with pytest.raises(UserError, match=sentence):
        devices(count)


def test_the_first_devices_are_used(monkeypatch):
    monkeypatch.setattr("jax.local_devices", lambda: ["a", "b", "c"])
    assert devices("1") == ["a"]
    assert devices("2") == ["a", "b"]
    assert devices("all") == ["a", "b", "c"]
