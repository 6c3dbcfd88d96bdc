"""An engine from outside the package: runs, environments and commands take it."""

from pathlib import Path

import jax
import numpy as np
import pytest
from support.cli import SMALL, code_of, refused, result
from support.mjx import ran

from iswarm_mj import make_env
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario

N, STEPS = 30, 3
NAME = f"{Path(__file__).parents[1]}/data/teleport.py:TeleportSettings"
TeleportSettings = find_engine(NAME)


def after(poses, turn, forward):
    """Where robots end that turn, then walk."""
    yaw = poses[..., 2] + turn
    ahead = np.stack([forward * np.cos(yaw), forward * np.sin(yaw), turn], axis=-1)
    return poses + ahead


def test_a_run_takes_it(small):
    engine = TeleportSettings(0.1)  # so that nobody leaves the arena
    scenario = Scenario(small, robots=N, engine=engine, seed=1, worlds=2, steps=STEPS)
    run = Run(scenario, record_worlds=(0, 1))
    record = ran(run)
    before = np.concatenate([run.start.poses, record.poses[:-1]])
    np.testing.assert_allclose(record.poses, after(before, *(0.1 * part for part in record.command)), atol=1e-5)
    assert run.identity == {"engine": "teleport", "far": 0.1} and not run.faults and run.step == STEPS
    assert np.abs(np.diff(record.poses, axis=0)).max() > 0.1


def test_its_faults_end_worlds(small):
    """Robots that go 100 times as far leave the arena."""
    run = Run(Scenario(small, robots=N, engine=TeleportSettings(100.0), worlds=2, steps=STEPS))
    ran(run)
    assert [(fault.world, fault.step) for fault in run.faults] == [(0, 1), (1, 1)]
    np.testing.assert_array_equal(run.arrays()[1].bodies.poses, [start.poses for start in run.starts])


def test_an_environment_takes_it(small):
    env = make_env(config=small, robots=N, engine=TeleportSettings(), worlds=2, n_starts=3)
    state = env.reset(jax.random.split(jax.random.key(0), 2))
    before = np.asarray(state.data.world.bodies.poses)
    state = env.step(state, np.full((2, N, 2), 0.5, np.float32))
    expected = after(before, *(np.full((2, N), value) for value in (np.radians(45), np.sqrt(2) / 2)))
    np.testing.assert_allclose(state.data.world.bodies.poses, expected, atol=1e-5)
    assert not state.done.any()


class TestCommands:
    @pytest.fixture(autouse=True)
    def here(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        return tmp_path

    def test_its_fields_are_flags(self, here):
        (here / "far.toml").write_text("far = 0.5")
        found = {}
        for far in ("--far=0.25", "--config=far.toml", "--far=1"):
            flags = [flag for flag in SMALL if "threads" not in flag]
            assert code_of("run", *flags, "--engine", NAME, "--steps=1", far) == 0
            found[result("runs/task")["far"]] = np.load("runs/task/trajectory.npz")["pose"][..., :2]
        assert result("runs/task")["engine"] == "teleport" and list(found) == [0.25, 0.5, 1.0]
        start = {far: poses[0] for far, poses in found.items()}
        np.testing.assert_array_equal(start[0.25], start[1.0])
        far, near = (np.linalg.norm(found[factor][1] - found[factor][0], axis=-1) for factor in (0.5, 0.25))
        assert far.max() > 1e-4
        np.testing.assert_allclose(far, 2 * near, atol=1e-7)

    @pytest.mark.parametrize(
        ("flags", "message"),
        [
            (["--engine", NAME, "--refinement=2"], f"--refinement has no effect with --engine {NAME}; leave it out"),
            (["--engine", NAME.replace("TeleportSettings", "Teleport")], "must be a subclass of EngineSettings"),
            (["--engine", NAME.replace("TeleportSettings", "Beam")], "has no Beam; its engines are TeleportSettings"),
            (
                ["--engine", "teleport"],
                "--engine must be FILE.py:CLASS, as glide.py:Glide, or installed (mjx, ",
            ),
        ],
    )
    def test_mistakes(self, capfd, here, flags, message):
        assert message in refused(capfd, here, "run", *flags)
