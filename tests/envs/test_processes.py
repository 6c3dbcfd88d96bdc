"""Environments of Gymnasium in processes of their own: forked, as by default on Linux, or spawned."""

import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import iswarm_mj.envs.gymnasium  # noqa: F401, registers the environment

SCRIPT = """
import sys

import gymnasium
import numpy as np

import iswarm_mj.envs.gymnasium

if __name__ == "__main__":
    context, is_used = sys.argv[1], sys.argv[2] == "used"
    if is_used:
        gymnasium.make("iswarm/Cleaning-v0", robots=3).reset(seed=0)
    settings = {} if context == "default" else {"vector_kwargs": {"context": context}}
    envs = gymnasium.make_vec("iswarm/Cleaning-v0", num_envs=2, vectorization_mode="async", robots=3, **settings)
    seen = [envs.reset(seed=1)[0]]
    for _ in range(2):
        seen.append(envs.step(np.ones(envs.action_space.shape, np.float32))[0])
    envs.close()
    np.save(sys.argv[3], np.stack(seen))
"""


def run(tmp_path, context, use):
    """The process of the script, and the file for what its environments observe."""
    script, out = tmp_path / "script.py", tmp_path / "seen.npy"
    script.write_text(SCRIPT)
    command = [sys.executable, script, context, use, out]
    return subprocess.run(command, capture_output=True, text=True, timeout=300), out


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no forks")
@pytest.mark.parametrize(
    ("context", "use"), [("default", "unused"), pytest.param("spawn", "used", marks=pytest.mark.slow)]
)
def test_asynchronous_environments_do_what_one_does(tmp_path, context, use):
    done, out = run(tmp_path, context, use)
    assert done.returncode == 0, done.stderr
    for world, seen in enumerate(np.load(out).swapaxes(0, 1)):
        env = gymnasium.make("iswarm/Cleaning-v0", robots=3)
        expected = [env.reset(seed=1 + world)[0]]
        for _ in range(2):
            expected.append(env.step(np.ones(env.action_space.shape, np.float32))[0])
        np.testing.assert_allclose(seen, expected, rtol=1e-6)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no forks")
def test_a_fork_after_an_episode_says_to_spawn(tmp_path):
    done, _ = run(tmp_path, "fork", "used")
    assert done.returncode != 0
    assert 'vector_kwargs={"context": "spawn"}' in done.stderr
