"""An engine from outside the package: runs, environments and commands take it."""

from pathlib import Path

import jax
import numpy as np
import pytest
from support.cli import SMALL, code_of, result
from support.mjx import ran

from iswarm_mj import make_env
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario

N_ROBOTS = 30
N_STEPS = 3
NAME = f"{Path(__file__).parents[1]}/data/teleport.py:TeleportSettings"
TeleportSettings = find_engine(NAME)
"""Settings of an engine whose robots are at once where they would go, times a factor `far`."""


def poses_after(poses, turn, forward):
    """Return the poses of robots that turn, then walk."""
    yaw = poses[..., 2] + turn
    motion = np.stack([forward * np.cos(yaw), forward * np.sin(yaw), turn], axis=-1)
    return poses + motion


class TestRuns:
    def test_a_run_takes_it(self, small):
        """Nobody leaves the arena at this factor."""
        factor = 0.1
        engine = TeleportSettings(factor)
        scenario = Scenario(small, robots=N_ROBOTS, engine=engine, seed=1, worlds=2, steps=N_STEPS)
        run = Run(scenario, record_worlds=(0, 1))
        record = ran(run)
        assert run.identity == {"engine": "teleport", "far": factor}
        assert run.step == N_STEPS
        assert not run.faults

        before = np.concatenate([run.start.poses, record.poses[:-1]])
        turn, forward = record.command
        expected = poses_after(before, factor * turn, factor * forward)
        np.testing.assert_allclose(record.poses, expected, atol=1e-5)
        assert np.abs(np.diff(record.poses, axis=0)).max() > 0.1

    def test_its_faults_end_worlds(self, small):
        """Robots that go 100 times as far leave the arena; they are left where they were."""
        engine = TeleportSettings(100.0)
        run = Run(Scenario(small, robots=N_ROBOTS, engine=engine, worlds=2, steps=N_STEPS))
        ran(run)
        assert [(fault.world, fault.step) for fault in run.faults] == [(0, 1), (1, 1)]
        poses = run.arrays()[1].bodies.poses
        np.testing.assert_array_equal(poses, [start.poses for start in run.starts])


@pytest.mark.slow
def test_an_environment_takes_it(small):
    env = make_env(config=small, robots=N_ROBOTS, engine=TeleportSettings(), worlds=2, n_starts=3)
    state = env.reset(jax.random.split(jax.random.key(0), 2))
    poses = np.asarray(env.poses(state))
    half_of_all = np.full((2, N_ROBOTS, 2), 0.5, np.float32)
    state = env.step(state, half_of_all)

    turn = np.full((2, N_ROBOTS), np.radians(45))
    forward = np.full((2, N_ROBOTS), np.sqrt(2) / 2)
    expected = poses_after(poses, turn, forward)
    np.testing.assert_allclose(env.poses(state), expected, atol=1e-5)
    assert not state.done.any()


class TestCommands:
    @pytest.fixture(autouse=True)
    def here(self, tmp_path, monkeypatch):
        """An empty working directory."""
        monkeypatch.chdir(tmp_path)
        return tmp_path

    def positions_with(self, flag, factor):
        """Return positions (2, N, 2) before and after one step of a command with a flag [m]."""
        flags = [usual for usual in SMALL if "threads" not in usual]
        assert code_of("run", *flags, "--engine", NAME, "--steps=1", flag) == 0
        assert result("runs/task")["engine"] == "teleport"
        assert result("runs/task")["far"] == factor
        return np.load("runs/task/trajectory.npz")["pose"][..., :2]

    def test_its_fields_are_flags(self, here):
        """Also keys of a file; robots of half the factor go half as far."""
        (here / "far.toml").write_text("far = 0.5")
        quarter = self.positions_with("--far=0.25", 0.25)
        half = self.positions_with("--config=far.toml", 0.5)
        whole = self.positions_with("--far=1", 1.0)
        np.testing.assert_array_equal(quarter[0], whole[0])

        distance = np.linalg.norm(half[1] - half[0], axis=-1)
        distance_of_quarter = np.linalg.norm(quarter[1] - quarter[0], axis=-1)
        assert distance.max() > 1e-4
        np.testing.assert_allclose(distance, 2 * distance_of_quarter, atol=1e-7)
