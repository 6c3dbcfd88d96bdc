"""Runs that do not fit into memory are refused before it is taken, with both numbers."""

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


@pytest.fixture
def four_gigabytes(monkeypatch):
    monkeypatch.setattr(memory_limits, "available_memory", lambda: 4_000_000_000)


def test_worlds_that_fit_are_allowed(four_gigabytes):
    most = 4_000_000_000 // (283 * 1000)
    check_memory(HOST, most, 283)
    said = rf"n_worlds must be at most {most} with 283 robots in each, so that the run fits into the 4 GB .* needs 4 GB"
    with pytest.raises(ConfigError, match=said):
        check_memory(HOST, most + 1, 283)
    assert max_worlds(HOST, 283) == 2_000_000_000 // (283 * 1000) and max_worlds(HOST, 10**7) == 1


def test_a_run_is_refused_before_anything_is_taken(four_gigabytes, small, monkeypatch):
    monkeypatch.setattr(World, "__post_init__", lambda world: pytest.fail("a world was made"))
    """All places for robots count."""
    with pytest.raises(ConfigError, match=r"needs 10 GB \(got 1000000\); use fewer worlds or robots"):
        Run(Scenario(small, robots=1, worlds=1_000_000, steps=3), capacity=10, record_worlds=())


def test_what_robots_remember_counts(four_gigabytes, small):
    def policy(n_numbers):
        def apply(params, obs, memory):
            return jnp.zeros((len(obs), 2)), memory

        return PolicyStrategy(apply, (), memory=lambda n_robots: jnp.zeros((n_robots, n_numbers)))

    scenario = Scenario(small, strategy=policy(10), robots=10, engine=PlanarSettings(), worlds=100, steps=3)
    Run(scenario)
    with pytest.raises(ConfigError, match=r"n_worlds must be at most 99 .*; use fewer .*, or let robots remember less"):
        Run(replace(scenario, strategy=policy(1_000_000)))


@pytest.mark.parametrize(("impl", "times"), [("jax", 25), ("warp", 4)])
def test_a_gpu_has_memory_of_its_own(four_gigabytes, impl, times):
    def settings(*limits):
        stats = [{"bytes_limit": limit, "bytes_in_use": 10**9} for limit in limits]
        devices = [SimpleNamespace(platform="gpu", memory_stats=lambda found=found: found) for found in stats]
        return MjxSettings(impl, devices=tuple(devices))

    n_worlds = int(6e9 / (10 * 1000 * times))
    check_memory(settings(4 * 10**9, 5 * 10**9), n_worlds, 10)
    with pytest.raises(ConfigError, match="the 3 GB of memory that are free"):
        check_memory(settings(4 * 10**9), n_worlds, 10)


def test_nothing_is_refused_where_nothing_is_known(monkeypatch):
    monkeypatch.setattr(memory_limits, "available_memory", lambda: None)
    check_memory(HOST, 10**9, 1000)
    assert max_worlds(HOST, 1000) == float("inf")
    unknown = SimpleNamespace(platform="gpu", memory_stats=lambda: None)
    check_memory(MjxSettings(devices=(unknown,)), 10**9, 1000)


@pytest.mark.parametrize("impl", ["numba", "warp"])
def test_memory_is_linear_in_robots(impl):
    assert needed_memory(PlanarSettings(impl=impl), 1, 10_000) == needed_memory(PlanarSettings(impl=impl), 10, 1000)
