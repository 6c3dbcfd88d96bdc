"""Environments of Gymnasium in processes: forked, as by default on Linux, or spawned."""

import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import iswarm_mj.envs.gymnasium  # noqa: F401, registers the environment

N_WORLDS = 2
N_STEPS = 2
SEED = 1
SCRIPT = f"""
import sys

import gymnasium
import numpy as np

import iswarm_mj.envs.gymnasium

if __name__ == "__main__":
    context, use, path = sys.argv[1:]
    if use == "used":
        gymnasium.make("iswarm/Cleaning-v0", robots=3).reset(seed=0)
    settings = {{"num_envs": {N_WORLDS}, "vectorization_mode": "async", "robots": 3}}
    if context != "default":
        settings["vector_kwargs"] = {{"context": context}}
    envs = gymnasium.make_vec("iswarm/Cleaning-v0", **settings)
    observations = [envs.reset(seed={SEED})[0]]
    for _ in range({N_STEPS}):
        action = np.ones(envs.action_space.shape, np.float32)
        observations.append(envs.step(action)[0])
    envs.close()
    np.save(path, np.stack(observations))
"""
"""Program that makes asynchronous environments, and saves what they observe."""

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no forks")


def run_script(tmp_path, context, use):
    """Run the script, and return its process, and the file with what its environments observed."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    observations = tmp_path / "observations.npy"
    command = [sys.executable, script, context, use, observations]
    process = subprocess.run(command, capture_output=True, text=True, timeout=300)
    return process, observations


def observations_of_one(seed):
    """Return what an environment in this process observes in the same steps."""
    env = gymnasium.make("iswarm/Cleaning-v0", robots=3)
    observations = [env.reset(seed=seed)[0]]
    for _ in range(N_STEPS):
        action = np.ones(env.action_space.shape, np.float32)
        observations.append(env.step(action)[0])
    return observations


@needs_fork
@pytest.mark.slow
@pytest.mark.parametrize(
    ("context", "use"),
    [("default", "unused"), ("spawn", "used")],
)
def test_asynchronous_environments_do_what_one_does(tmp_path, context, use):
    process, path = run_script(tmp_path, context, use)
    assert process.returncode == 0, process.stderr
    of_worlds = np.load(path).swapaxes(0, 1)
    assert len(of_worlds) == N_WORLDS
    for world, observations in enumerate(of_worlds):
        expected = observations_of_one(SEED + world)
        np.testing.assert_allclose(observations, expected, rtol=1e-6)


@needs_fork
@pytest.mark.slow
def test_a_fork_after_an_episode_says_to_spawn(tmp_path):
    process, _ = run_script(tmp_path, "fork", "used")
    assert process.returncode != 0
    assert 'vector_kwargs={"context": "spawn"}' in process.stderr
