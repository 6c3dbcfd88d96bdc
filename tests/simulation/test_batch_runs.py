"""Runs and rollouts on the planar engine for batches: the swarm of the engine for CPUs, records, devices, faults."""

import importlib.util
import json
import os
import subprocess
import sys
from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers_mjx import RECORDED, SEED, TINY, WORLDS, N, poses, ran, settings
from helpers_worlds import begin_with, centres, start_of

from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import FaultKind, UserError
from iswarm_mj.workflows.rollout import paper_strategy, rollout

TYPE1 = PRESETS["type1"]
WORLD = World(TYPE1, N, SEED)


def warp(**own):
    return PlanarSettings(**{"impl": "warp", "devices": tuple(jax.devices("cpu")[:1]), **own})


def planar_run(engine, worlds=None, **own):
    """Three worlds to their end, and their records."""
    run = Run(TINY, TYPE1, settings(**own), engine, worlds=worlds)
    return run, ran(run)


@pytest.fixture(scope="module")
def batch():
    """Two calls, of 25 and of 15 control steps."""
    return planar_run(warp(), steps=40)


class TestAgainstTheEngineForCpus:
    """The same random numbers, so only rounding parts them."""

    def test_the_first_steps_agree(self, batch):
        ours, (_, theirs) = batch[1], planar_run(PlanarSettings(1), steps=4)
        assert jax.tree.structure(ours) == jax.tree.structure(theirs)
        ours = jax.tree.map(lambda a: a[:4], ours)
        for name, mine, yours in zip(ours._fields, ours, theirs, strict=True):
            assert [a.shape for a in jax.tree.leaves(mine)] == [a.shape for a in jax.tree.leaves(yours)], name
        np.testing.assert_allclose(ours.poses, theirs.poses, atol=0.02)
        for name in ("valid", "sender", "led"):
            np.testing.assert_array_equal(getattr(ours.links, name), getattr(theirs.links, name))
        for name in ("step", "has_priority", "collisions", "is_running"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
        np.testing.assert_allclose(centres(ours), centres(theirs), atol=0.02)
        assert ours.links.valid.sum() > 100 and ours.collisions.max() > 0

    def test_worlds_of_other_sizes_and_genomes(self):
        worlds = [
            replace(WORLD, n_robots=15),
            replace(WORLD, genome=PRESETS["type2"], index=1),
            replace(WORLD, index=2),
        ]
        ours, theirs = (planar_run(engine, worlds, steps=4) for engine in (warp(), PlanarSettings(1)))
        np.testing.assert_allclose(poses(ours[0])[:, :15], poses(theirs[0])[:, :15], atol=0.02)
        np.testing.assert_allclose(poses(ours[0])[1:], poses(theirs[0])[1:], atol=0.02)
        assert [ours[0].measures(w) for w in range(3)] == [theirs[0].measures(w) for w in range(3)]
        assert np.abs(poses(ours[0])[1] - poses(ours[0])[2]).max() > 1


def test_what_is_recorded_is_what_happened(batch):
    run, record = batch
    np.testing.assert_array_equal(record.poses[-1], poses(run)[list(RECORDED)])
    assert record.poses.shape == (40, 2, N, 3) and record.is_running.all()
    assert record.step.tolist() == [[step, step] for step in range(1, 41)]
    assert record.collisions[-1].tolist() == [run.measures(w).collisions for w in RECORDED]
    moves = np.linalg.norm(np.diff(np.concatenate([run.start.poses, record.poses]), axis=0)[..., :2], axis=-1)
    np.testing.assert_allclose(moves.mean(axis=-1), record.speed, rtol=1e-4)
    assert sum(run.measures(w).picked for w in range(WORLDS)) > 3
    assert run.identity == {"engine": "planar", "refinement": 1, "accuracy": 0.01, "impl": "warp"}


def test_a_fault_ends_its_world_alone(batch, monkeypatch):
    """Robot 3 of world 1 begins nowhere."""
    start = start_of(TINY, N, SEED, 1)
    start.poses[3, 0] = np.nan
    begin_with(monkeypatch, {1: start})
    run, record = planar_run(warp(), steps=40)
    (fault,) = run.faults
    assert (fault.kind, fault.world, fault.step) == (FaultKind.POSE_NOT_FINITE, 1, 1)
    assert "the pose of robot 3 is not finite" in str(fault)
    np.testing.assert_array_equal(poses(run)[1], start.poses.astype(np.float32))
    assert run.measures(1).collisions == 0 and run.step == 40
    np.testing.assert_array_equal(record.poses, batch[1].poses)
    assert [run.measures(w) for w in (0, 2)] == [batch[0].measures(w) for w in (0, 2)]


def test_stages_are_timed(batch):
    times = batch[0].stage_times()
    assert times.keys() == {"sense", "policy", "physics"} and min(times.values()) > 0


CODE = """
import json
import sys; sys.path.insert(0, "tests")
import conftest  # keeps what is compiled
from helpers_mjx import *
from iswarm_mj.engines.planar.settings import PlanarSettings
run = Run(TINY, PRESETS["type1"], settings(steps=40), PlanarSettings(impl="warp", chunk=5))
record = ran(run)
sums = [record.poses[-1].astype(float).sum((1, 2)).tolist(), poses(run).astype(float).sum((1, 2)).tolist()]
print(json.dumps([len(run.devices), [run.measures(w) for w in range(3)], sums]))
"""


@pytest.mark.parametrize(("devices", "used"), [(2, 2), pytest.param(4, 3, marks=pytest.mark.slow)])
def test_devices_and_chunks_change_no_bit(batch, devices, used):
    """Of three worlds two devices take two each, one of them a filler; of four devices three take one each."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    env = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, env=env, check=True)
    size, measures, sums = json.loads(done.stdout)
    run, record = batch
    assert size == used
    assert measures == [list(run.measures(w)) for w in range(WORLDS)]
    np.testing.assert_array_equal(sums[0], record.poses[-1].astype(float).sum((1, 2)))
    np.testing.assert_array_equal(sums[1], poses(run).astype(float).sum((1, 2)))


class TestRollouts:
    KEYS = jax.random.split(jax.random.key(8), 3)

    def cleaned(self, engine, steps):
        strategy = paper_strategy(TINY, TYPE1, N)
        return rollout(TINY, strategy, self.KEYS, n_robots=N, steps=steps, every=10, poses_of=(1,), engine=engine)

    def test_the_first_steps_are_those_of_the_engine_for_cpus(self):
        ours, theirs = (self.cleaned(engine, 4) for engine in (warp(accuracy=2e-5), PlanarSettings(1, accuracy=2e-5)))
        np.testing.assert_allclose(ours.poses, theirs.poses, atol=0.02)
        for name in ("picked", "collisions", "steps", "delivered_after"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))

    def test_deliveries_are_counted_when_asked(self):
        """As at the end of shorter rollouts, which meet the same worlds."""
        whole = self.cleaned(warp(), 60)
        assert whole.steps.tolist() == [10, 20, 30, 40, 50, 60]
        for column in (1, 3):
            shorter = self.cleaned(warp(), 10 * (column + 1))
            np.testing.assert_array_equal(whole.delivered_after[:, column], shorter.delivered)
        assert len(np.unique(whole.delivered_after.sum(axis=0))) > 3


class TestRefusals:
    @pytest.mark.parametrize(
        ("own", "says"),
        [
            ({"impl": "jax"}, r"impl must be numba or warp.*\(got 'jax'\)"),
            ({"chunk": 0}, r"chunk must be .*\(got 0\)"),
            ({"devices": ()}, r"devices must be a tuple of JAX devices, or None \(got \(\)\)"),
        ],
    )
    def test_settings_that_do_not_fit(self, own, says):
        with pytest.raises(UserError, match=says):
            warp(**own)

    def test_without_the_package(self, monkeypatch):
        found = importlib.util.find_spec
        monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "warp" else found(name, *a))
        with pytest.raises(UserError, match=r"`impl` warp needs the package warp-lang; .*iswarm-mj\[warp\]"):
            Run(TINY, TYPE1, settings(), warp())
