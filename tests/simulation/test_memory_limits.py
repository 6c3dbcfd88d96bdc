"""Memory: runs that need more than is free are refused before any of it is taken."""

from dataclasses import replace
from types import SimpleNamespace

import jax.numpy as jnp
import pytest

from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.envs import PolicyStrategy
from iswarm_mj.simulation import memory_limits
from iswarm_mj.simulation.memory_limits import check_memory, max_worlds, needed_memory
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.utils.errors import ConfigError

HOST = MujocoSettings()
GB = 10**9
BYTES_PER_ROBOT = 1000
"""Memory of a robot on the host, as the estimate has it."""


@pytest.fixture
def four_gigabytes(monkeypatch):
    """A host with 4 GB of free memory."""
    monkeypatch.setattr(memory_limits, "available_memory", lambda: 4 * GB)


class TestHost:
    def test_worlds_that_fit_are_allowed(self, four_gigabytes):
        most = 4 * GB // (283 * BYTES_PER_ROBOT)
        check_memory(HOST, most, 283)
        says = (
            rf"n_worlds must be at most {most} with 283 robots in each, so that the run fits into "
            r"the 4 GB .* needs 4 GB"
        )
        with pytest.raises(ConfigError, match=says):
            check_memory(HOST, most + 1, 283)

    def test_batches_take_half_of_the_free_memory_and_at_least_one_world(self, four_gigabytes):
        assert max_worlds(HOST, 283) == 2 * GB // (283 * BYTES_PER_ROBOT)
        assert max_worlds(HOST, 10**7) == 1

    def test_a_run_is_refused_before_anything_is_taken(self, four_gigabytes, small, monkeypatch):
        """All places for robots count, also empty ones."""
        monkeypatch.setattr(World, "__post_init__", lambda world: pytest.fail("made a world"))
        scenario = Scenario(small, robots=1, worlds=1_000_000, steps=3)
        says = r"needs 10 GB \(got 1000000\); use fewer worlds or robots"
        with pytest.raises(ConfigError, match=says):
            Run(scenario, capacity=10, record_worlds=())

    def test_what_robots_remember_counts(self, four_gigabytes, small):
        def policy(n_numbers):
            """Return a policy whose robots stand, and remember so many numbers each."""

            def stand(params, obs, memory):
                return jnp.zeros((len(obs), 2)), memory

            def remember(n_robots):
                return jnp.zeros((n_robots, n_numbers))

            return PolicyStrategy(stand, (), memory=remember)

        scenario = Scenario(
            small,
            strategy=policy(10),
            robots=10,
            engine=PlanarSettings(),
            worlds=100,
            steps=3,
        )
        Run(scenario)

        says = r"n_worlds must be at most 99 .*; use fewer .*, or let robots remember less"
        with pytest.raises(ConfigError, match=says):
            Run(replace(scenario, strategy=policy(1_000_000)))


@pytest.mark.parametrize(("impl", "times_host"), [("jax", 25), ("warp", 4)])
def test_a_gpu_has_memory_of_its_own(four_gigabytes, impl, times_host):
    """Two GPUs of 4 and 5 GB have 7 GB, and one of 4 GB has 3 GB: 1 GB of each is in use."""

    def gpu_of(limit):
        stats = {"bytes_limit": limit, "bytes_in_use": GB}
        return SimpleNamespace(platform="gpu", memory_stats=lambda: stats)

    def settings_with(*limits):
        return MjxSettings(impl, devices=tuple(map(gpu_of, limits)))

    n_robots = 10
    of_six_gigabytes = int(6 * GB / (n_robots * BYTES_PER_ROBOT * times_host))
    check_memory(settings_with(4 * GB, 5 * GB), of_six_gigabytes, n_robots)
    with pytest.raises(ConfigError, match="the 3 GB of memory that are free"):
        check_memory(settings_with(4 * GB), of_six_gigabytes, n_robots)


class TestUnknownMemory:
    def test_a_host_refuses_nothing(self, monkeypatch):
        monkeypatch.setattr(memory_limits, "available_memory", lambda: None)
        check_memory(HOST, 10**9, 1000)
        assert max_worlds(HOST, 1000) == float("inf")

    def test_a_device_refuses_nothing(self):
        silent = SimpleNamespace(platform="gpu", memory_stats=lambda: None)
        check_memory(MjxSettings(devices=(silent,)), 10**9, 1000)


@pytest.mark.parametrize("impl", ["numba", "warp"])
def test_memory_is_linear_in_robots(impl):
    engine = PlanarSettings(impl=impl)
    assert needed_memory(engine, 1, 10_000) == needed_memory(engine, 10, 1000)
