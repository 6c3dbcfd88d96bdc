"""Runs in MJX: the same swarm as in MuJoCo in C, worlds that differ, faults that end their own world alone."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers_mjx import RECORDED, SEED, TINY, WORLDS, N, compilations, mjx, mjx_run, poses, ran, settings
from helpers_worlds import begin_with, centres, start_of

from iswarm_mj.config import GripperConfig, OpticsConfig
from iswarm_mj.engines.mjx.arena import contact_capacity
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.setup import set_up
from iswarm_mj.simulation.start import start_loop
from iswarm_mj.simulation.worlds import World, vector_strategies
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.errors import FaultKind, SimulationFault, UserError
from iswarm_mj.utils.profiling import Stopwatch

TYPE1 = PRESETS["type1"]
WORLD = World(TYPE1, N, SEED)


def in_c(worlds=None, steps=4, **own):
    run = Run(TINY, TYPE1, settings(steps=steps, **own), MujocoSettings(threads=1), worlds=worlds)
    return run, ran(run)


def of_one_kind(*worlds):
    """Three worlds, numbered."""
    return [replace(world, index=index) for index, world in enumerate(worlds)]


def assert_same_bits(one, other):
    def bits(a):
        return jax.random.key_data(a) if jax.dtypes.issubdtype(a.dtype, jax.dtypes.prng_key) else a

    assert jax.tree.structure(one) == jax.tree.structure(other)
    for mine, yours in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(bits(mine), bits(yours))


@pytest.fixture(scope="module")
def batch():
    """Two calls, of 25 and of 15 control steps."""
    return mjx_run(steps=40)


class TestAgainstMujocoInC:
    """The same random numbers, so only rounding parts them."""

    def test_the_first_steps_agree(self, batch):
        ours = batch[1]
        _, theirs = in_c(steps=3)
        assert jax.tree.structure(ours) == jax.tree.structure(theirs)
        ours = jax.tree.map(lambda a: a[:3], ours)
        for name, mine, yours in zip(ours._fields, ours, theirs, strict=True):
            assert [a.shape for a in jax.tree.leaves(mine)] == [a.shape for a in jax.tree.leaves(yours)], name
        np.testing.assert_allclose(ours.poses, theirs.poses, atol=0.02)
        for name in ("valid", "sender", "led"):
            np.testing.assert_array_equal(getattr(ours.links, name), getattr(theirs.links, name))
        np.testing.assert_allclose(ours.links.true_distance, theirs.links.true_distance, atol=0.02)
        for name in ("step", "has_priority", "collisions", "is_running"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
        np.testing.assert_allclose(centres(ours), centres(theirs), atol=0.02)
        np.testing.assert_allclose(ours.speed, theirs.speed, rtol=1e-3)
        assert ours.links.valid.sum() > 100 and ours.collisions.max() > 0

    def test_the_start_is_the_same(self, batch):
        assert_same_bits(batch[0].start, in_c(steps=1)[0].start)

    def test_worlds_of_other_sizes_and_genomes(self):
        """In a run with more robots, each world does what it does alone in C, but for rounding."""
        small, other = replace(WORLD, n_robots=15), replace(WORLD, genome=PRESETS["type2"], index=1)
        mixed = poses(mjx_run([small, other, WORLD], steps=4)[0])
        full, alone = in_c([other, other, WORLD])[0], in_c([small], n_worlds=1, n_robots=15, record_worlds=())[0]
        for place, n, theirs in ((0, 15, poses(alone)[0]), (1, N, poses(full)[1]), (2, N, poses(full)[2])):
            off = np.abs(mixed[place, :n] - theirs)[..., :2].max(axis=-1)
            assert np.median(off) < 1e-3 and off.max() < 0.5
        assert np.abs(mixed[1] - mixed[2]).max() > 1


LOOSE = replace(WORLD, index=1)
"""A world in which robots do not crowd in 20 steps."""


def differing(**parts):
    """The world with other parts of the configuration."""
    return replace(LOOSE, config=replace(TINY, **parts))


def test_worlds_of_other_conditions():
    """At 50 % RH this tool lifts nothing; a world without drops, one that always drops, and one of failed robots."""
    humid = differing(gripper=GripperConfig(relative_humidity=50, grasp_voltage=20, drop_rate=0))
    loose = differing(gripper=GripperConfig(drop_rate=1.0))
    deaf = differing(optics=OpticsConfig(p_communication_break=1.0))
    dead = replace(LOOSE, failed_fraction=1.0)
    grips, hears = mjx_run([LOOSE, humid, loose], steps=20)[0], mjx_run([LOOSE, deaf, dead], steps=20)[0]
    assert not grips.faults and not hears.faults
    picked = [grips.measures(w).picked for w in range(3)]
    carried = grips.arrays()[1].swarm.task.carried_steps.sum(axis=1)
    assert picked[0] > 0 and picked[1] == 0 and picked[2] > 0
    assert carried[0] > 2 * carried[2] > 0
    hops = np.asarray(hears.arrays()[1].swarm.memory.dust.hop)
    assert hops[0].max() > 0 and hops[1].max() == 0
    np.testing.assert_allclose(poses(hears)[2], hears.starts[2].poses, atol=1e-5)


class TestFaults:
    def test_a_heap_ends_its_world_alone(self, batch, monkeypatch):
        """All robots of world 1 begin at one place, where more pairs of them touch than the buffers have room for."""
        start = start_of(TINY, N, SEED, 1)
        heap = start._replace(poses=start.poses * [0.1, 0.1, 1])
        assert contact_capacity(TINY, N).pairs < N * (N - 1) / 2
        begin_with(monkeypatch, {1: heap})
        run, record = mjx_run(of_one_kind(WORLD, WORLD, WORLD), steps=40)
        (fault,) = run.faults
        assert fault.kind & FaultKind.TOO_MANY_PAIRS and (fault.world, fault.step) == (1, 1)
        with pytest.raises(SimulationFault, match=r"step 1, world 1: buffer of robot pairs full.*`contact_capacity`"):
            run.raise_faults()
        np.testing.assert_array_equal(poses(run)[1], heap.poses.astype(np.float32))
        assert run.measures(1).collisions == 0
        assert_same_bits(record, batch[1])
        assert [run.measures(w) for w in (0, 2)] == [batch[0].measures(w) for w in (0, 2)]
        np.testing.assert_array_equal(poses(run)[[0, 2]], poses(batch[0])[[0, 2]])
        assert run.step == 40

    def test_the_run_ends_with_the_last_world(self, monkeypatch):
        """Robot 3 begins nowhere in each."""
        start = start_of(TINY, N, SEED, 0)
        start.poses[3, 0] = np.nan
        begin_with(monkeypatch, dict.fromkeys(range(3), start))
        run, record = mjx_run(of_one_kind(WORLD, WORLD, WORLD), steps=40)
        assert run.is_over and run.step == 1 and record.poses.shape == (1, 2, N, 3)
        assert [(fault.world, fault.kind) for fault in run.faults] == [(w, FaultKind.POSE_NOT_FINITE) for w in range(3)]


def test_what_is_recorded_is_what_happened(batch):
    run, record = batch
    worlds = list(RECORDED)
    np.testing.assert_array_equal(record.poses[-1], poses(run)[worlds])
    assert record.poses.shape == (40, 2, N, 3) and record.is_running.all()
    assert record.step.tolist() == [[step, step] for step in range(1, 41)]
    assert record.collisions[-1].tolist() == [run.measures(w).collisions for w in worlds]
    moved = np.linalg.norm(np.diff(np.concatenate([run.start.poses, record.poses]), axis=0)[..., :2], axis=-1)
    np.testing.assert_allclose(moved.mean(axis=-1), record.speed, rtol=1e-4)
    assert sum(run.measures(w).picked for w in range(WORLDS)) > 3


def test_a_world_stands_still_once_it_is_finished(batch):
    run, record = mjx_run(stop_at=2, steps=40)
    assert run.is_over and not run.faults
    for row, world in enumerate(RECORDED):
        end = run.measures(world).finished_at
        assert end > 0 and run.measures(world).delivered >= 2
        np.testing.assert_array_equal(record.poses[:end, row], batch[1].poses[:end, row])
        assert (record.poses[end:, row] == record.poses[end - 1, row]).all()
        assert record.is_running[:, row].tolist() == [step < end for step in range(len(record.poses))]
    assert run.step == max(run.measures(w).finished_at for w in range(WORLDS)) < 40


def loop_of_one_world(engine):
    setup = set_up(TINY, settings(n_worlds=1, steps=1, record_worlds=()), engine, CLEANING, [WORLD])
    return start_loop(setup, vector_strategies(TINY, setup.robot, [WORLD]), Stopwatch())[0]


def test_stages_are_timed_on_worlds_of_the_run_alone():
    """Of one world on a CPU there are two rows, the second a filler."""
    loop = loop_of_one_world(mjx(chunk=1))
    params, state, engine = loop.on_first_device()
    assert {a.shape[0] for a in jax.tree.leaves((params, state))} == {1}
    assert not np.asarray(state.is_finished).any()
    assert_same_bits((params, state), loop.worlds())
    assert engine.arena.capacity == contact_capacity(TINY, N) and engine.arena.n_robots == N


def test_capacity_of_contacts_is_that_of_the_settings():
    loop = loop_of_one_world(mjx(contact_capacity=2))
    assert loop.on_first_device()[2].arena.capacity == contact_capacity(TINY, N, 2)


def test_settings_that_do_not_fit_are_refused():
    for own, says in (
        ({"impl": "torch"}, r"impl must be jax or warp.*\(got 'torch'\)"),
        ({"solver_iterations": 0}, r"solver_iterations must be .*\(got 0\)"),
        ({"chunk": 0}, r"chunk must be .*\(got 0\)"),
    ):
        with pytest.raises(UserError, match=says):
            MjxSettings(**own)
    with pytest.raises(UserError, match=r"record_worlds must be .*worlds from 0 to 2 \(got \(3,\)\)"):
        settings(record_worlds=(3,))


def test_worlds_that_cannot_share_a_program_are_refused():
    for other in ({"optics": OpticsConfig(mode="power")}, {"gripper": GripperConfig(release_gap=4e-6)}):
        with pytest.raises(UserError, match="which all worlds of one run share; run it separately"):
            mjx_run([WORLD, WORLD, differing(**other)])


def test_genomes_need_no_other_program(batch):
    with compilations() as names:
        mjx_run(genome=Genome(p_vector_forget=0.9))
    assert names == []


CODE = """
import json
import sys; sys.path.insert(0, "tests")
import conftest  # keeps what is compiled
from helpers_mjx import *
run = Run(TINY, PRESETS["type1"], settings(steps=40), MjxSettings(chunk=5))
record = ran(run)
sums = [record.poses[-1].astype(float).sum((1, 2)).tolist(), poses(run).astype(float).sum((1, 2)).tolist()]
print(json.dumps([len(run.devices), [run.measures(w) for w in range(3)], sums]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("devices", "used"), [(2, 2), (4, 3)])
def test_devices_rows_and_chunks_change_no_bit(batch, devices, used):
    """Of three worlds two devices take two each, one of them a filler; of four devices three take one each."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    env = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, env=env, check=True)
    size, measures, sums = json.loads(done.stdout.splitlines()[-1])
    run, record = batch
    assert size == used
    assert measures == [list(run.measures(w)) for w in range(WORLDS)]
    np.testing.assert_array_equal(sums[0], record.poses[-1].astype(float).sum((1, 2)))
    np.testing.assert_array_equal(sums[1], poses(run).astype(float).sum((1, 2)))


@pytest.mark.slow
@pytest.mark.parametrize("impl", ["jax", "warp"])
def test_whole_runs_are_distributed_as_on_the_cpu_engine(impl):
    """Finishing time and deliveries of 24 worlds: two samples of one distribution, by Kolmogorov-Smirnov at 1 %."""
    from scipy.stats import ks_2samp

    pytest.importorskip("warp") if impl == "warp" else None
    steps = 100
    ours, theirs = (
        Run(TINY, TYPE1, RunSettings(N, steps, seed, n_worlds=24, record_worlds=()), engine)
        for seed, engine in ((SEED, mjx(impl=impl, solver_iterations=20)), (99, MujocoSettings()))
    )
    ran(ours), ran(theirs)
    for what in ("delivered", "picked", "collisions"):
        samples = [[getattr(run.measures(w), what) for w in range(24)] for run in (ours, theirs)]
        print(impl, what, *map(np.mean, samples), ks_2samp(*samples).pvalue)
        assert ks_2samp(*samples).pvalue > 0.01
    times = [[run.measures(w).finished_at or steps for w in range(24)] for run in (ours, theirs)]
    assert ks_2samp(*times).pvalue > 0.01
