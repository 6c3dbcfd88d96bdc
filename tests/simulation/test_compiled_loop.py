"""Runs of compiled engines: the swarm of the engines for CPUs, worlds that differ, faults, devices."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import jax
import numpy as np
import pytest
from support.mjx import ENGINES, RECORDED, SEED, TINY, WORLDS, N, compilations, mjx, poses, ran, tiny_run, warp
from support.worlds import begin_with, centres, start_of

from iswarm_mj.engines.mjx.arena import contact_capacity
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.utils.errors import FaultKind, SimulationFault, UserError

TYPE1 = PRESETS["type1"]
WORLD = World(TYPE1, N, SEED)
ON_THE_HOST = {"mjx": MujocoSettings(1), "warp": PlanarSettings(1)}


def run_in(engine, worlds=None, genome=TYPE1, **own):
    """Three worlds to their end, and their records."""
    if worlds is not None:
        own["worlds"] = worlds
    run = tiny_run(engine, strategy=genome, **own)
    return run, ran(run)


class Batch(NamedTuple):
    name: str
    run: Run
    record: StepRecord


@pytest.fixture(scope="module", params=list(ENGINES))
def batch(request):
    """Two calls, of ten control steps each."""
    return Batch(request.param, *run_in(ENGINES[request.param]))


def assert_same_bits(one, other):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for mine, yours in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(mine, yours)


def test_the_first_steps_are_those_on_the_host(batch):
    """The same random numbers, so only rounding parts them."""
    run, theirs = run_in(ON_THE_HOST[batch.name], steps=3)
    assert_same_bits(batch.run.start, run.start)
    assert jax.tree.structure(batch.record) == jax.tree.structure(theirs)
    ours = jax.tree.map(lambda a: a[:3], batch.record)
    for name, mine, yours in zip(ours._fields, ours, theirs, strict=True):
        assert [a.shape for a in jax.tree.leaves(mine)] == [a.shape for a in jax.tree.leaves(yours)], name
    for name in ("valid", "sender", "led"):
        np.testing.assert_array_equal(getattr(ours.links, name), getattr(theirs.links, name))
    for name in ("step", "has_priority", "collisions", "is_running"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    for mine, yours in (
        (ours.poses, theirs.poses),
        (ours.links.true_distance, theirs.links.true_distance),
        (centres(ours), centres(theirs)),
    ):
        np.testing.assert_allclose(mine, yours, atol=0.02)
    np.testing.assert_allclose(ours.speed, theirs.speed, rtol=1e-3)
    assert ours.links.valid.sum() > 100 and ours.collisions.max() > 0


def test_what_is_recorded_is_what_happened(batch):
    _, run, record = batch
    np.testing.assert_array_equal(record.poses[-1], poses(run)[list(RECORDED)])
    assert record.poses.shape == (20, 2, N, 3) and record.is_running.all()
    assert record.step.tolist() == [[step, step] for step in range(1, 21)]
    assert record.collisions[-1].tolist() == [run.measures(w).collisions for w in RECORDED]
    moves = np.linalg.norm(np.diff(np.concatenate([run.start.poses, record.poses]), axis=0)[..., :2], axis=-1)
    np.testing.assert_allclose(moves.mean(axis=-1), record.speed, rtol=1e-4)
    assert sum(run.measures(w).picked for w in range(WORLDS)) > 3


def test_a_fault_ends_its_world_alone(batch, monkeypatch):
    """World 1 begins as a heap with more pairs in contact than MJX has room for; with Warp, robot 3 is nowhere."""
    start = start_of(TINY, N, SEED, 1)
    if batch.name == "mjx":
        assert contact_capacity(TINY, N).pairs < N * (N - 1) / 2
        start, kind = start._replace(poses=start.poses * [0.1, 0.1, 1]), FaultKind.TOO_MANY_PAIRS
        says = r"step 1, world 1: buffer of robot pairs full.*`contact_capacity`"
    else:
        start.poses[3, 0], kind, says = np.nan, FaultKind.POSE_NOT_FINITE, "the pose of robot 3 is not finite"
    begin_with(monkeypatch, {1: start})
    run, record = run_in(ENGINES[batch.name], [replace(WORLD, index=index) for index in range(3)])
    (fault,) = run.faults
    assert fault.kind & kind and (fault.world, fault.step) == (1, 1)
    with pytest.raises(SimulationFault, match=says):
        run.raise_faults()
    np.testing.assert_array_equal(poses(run)[1], start.poses.astype(np.float32))
    assert run.measures(1).collisions == 0 and run.step == 20
    assert_same_bits(record, batch.record)
    assert [run.measures(w) for w in (0, 2)] == [batch.run.measures(w) for w in (0, 2)]
    np.testing.assert_array_equal(poses(run)[[0, 2]], poses(batch.run)[[0, 2]])


def test_a_run_may_end_within_a_call(batch):
    run, record = run_in(ENGINES[batch.name], steps=13)
    assert run.step == 13 and run.is_over
    assert_same_bits(record, jax.tree.map(lambda a: a[:13], batch.record))
    np.testing.assert_array_equal(poses(run)[list(RECORDED)], batch.record.poses[12])


def test_the_run_ends_with_the_last_world(monkeypatch):
    """Robot 3 begins nowhere in each; faults name worlds by their own numbers."""
    start = start_of(TINY, N, SEED, 0)
    start.poses[3, 0] = np.nan
    begin_with(monkeypatch, dict.fromkeys(range(4, 7), start))
    run, record = run_in(warp(), [replace(WORLD, index=index) for index in range(4, 7)])
    assert run.is_over and run.step == 1 and record.poses.shape == (1, 2, N, 3)
    assert [(fault.world, fault.kind) for fault in run.faults] == [(w, FaultKind.POSE_NOT_FINITE) for w in range(4, 7)]


def test_a_world_stands_still_once_it_is_finished():
    """Also when other settings and another swarm are put in place of what there was."""
    plain, record = run_in(warp(), goal=2, steps=30)
    assert plain.is_over and not plain.faults
    ends = [plain.measures(world).finished_at for world in range(WORLDS)]
    assert max(ends) == plain.step and sorted(ends)[1] <= 20 < ends[0]
    for row, world in enumerate(RECORDED):
        assert (record.poses[ends[world] :, row] == record.poses[ends[world] - 1, row]).all()
        assert record.is_running[:, row].tolist() == [step < ends[world] for step in range(len(record.poses))]
        assert (np.diff(record.poses[: ends[world], row], axis=0) != 0).any(axis=(1, 2)).all()
    run = tiny_run(warp(), goal=2, steps=30)
    run.advance(), run.advance()
    run.change(TINY, PRESETS["type2"])
    run.edit(lambda swarm: swarm._replace(is_alive=~swarm.is_alive))
    ran(run)
    np.testing.assert_array_equal(poses(run)[1:], poses(plain)[1:])
    assert [run.measures(world).finished_at for world in (1, 2)] == ends[1:] and not run.measures(0).finished_at


def test_worlds_of_other_sizes_and_genomes():
    worlds = [replace(WORLD, n_robots=15), replace(WORLD, genome=PRESETS["type2"], index=1), replace(WORLD, index=2)]
    ours, theirs = (run_in(engine, worlds, steps=4)[0] for engine in (warp(), ON_THE_HOST["warp"]))
    np.testing.assert_allclose(poses(ours)[:, :15], poses(theirs)[:, :15], atol=0.02)
    np.testing.assert_allclose(poses(ours)[1:], poses(theirs)[1:], atol=0.02)
    assert [ours.measures(w) for w in range(3)] == [theirs.measures(w) for w in range(3)]
    assert np.abs(poses(ours)[1] - poses(ours)[2]).max() > 1


def test_stages_are_timed_on_worlds_of_the_run_alone(batch):
    params, state, _ = batch.run._loop.on_first_device()
    assert {a.shape[0] for a in jax.tree.leaves((params, state))} == {WORLDS}
    assert_same_bits((params, state), batch.run.arrays())
    if batch.name == "warp":
        times = batch.run.stage_times()
        assert times.keys() == {"sense", "policy", "physics"} and min(times.values()) > 0


@pytest.mark.parametrize(
    ("make", "own", "says"),
    [
        (mjx, {"impl": "torch"}, r"impl must be jax or warp.*\(got 'torch'\)"),
        (mjx, {"solver_iterations": 0}, r"solver_iterations must be .*\(got 0\)"),
        (warp, {"impl": "jax"}, r"impl must be numba or warp.*\(got 'jax'\)"),
        (warp, {"chunk": 0}, r"chunk must be .*\(got 0\)"),
        (warp, {"devices": ()}, r"devices must be a tuple of JAX devices, or None \(got \(\)\)"),
        (partial(tiny_run, warp()), {"record_worlds": (3,)}, r"record_worlds must be .* 0 to 2 \(got \(3,\)\)"),
    ],
)
def test_settings_that_do_not_fit_are_refused(make, own, says):
    with pytest.raises(UserError, match=says):
        make(**own)


def test_genomes_need_no_other_program(batch):
    with compilations() as names:
        tiny_run(ENGINES[batch.name], strategy=Genome(p_vector_forget=0.9)).advance()
    assert names == []


CODE = """
import json
import sys; sys.path.insert(0, "tests")
import conftest  # keeps what is compiled
from dataclasses import replace
from functools import partial
from support.mjx import ENGINES, poses, ran, tiny_run
run = tiny_run(replace(ENGINES[sys.argv[1]], devices=None, chunk=5))
record = ran(run)
sums = [record.poses[-1].astype(float).sum((1, 2)).tolist(), poses(run).astype(float).sum((1, 2)).tolist()]
print(json.dumps([len(run.devices), [run.measures(w) for w in range(3)], sums]))
"""


@pytest.mark.parametrize(
    ("batch", "devices", "used"),
    [
        ("warp", 2, 2),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in (("warp", 4, 3), ("mjx", 2, 2), ("mjx", 4, 3))),
    ],
    indirect=["batch"],
)
def test_devices_and_chunks_change_no_bit(batch, devices, used):
    """Of three worlds two devices take two each, one of them a filler; of four devices three take one each."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    env = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    given = [sys.executable, "-c", CODE, batch.name]
    done = subprocess.run(given, capture_output=True, text=True, env=env, check=True)
    size, measures, sums = json.loads(done.stdout.splitlines()[-1])
    _, run, record = batch
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
        Run(
            Scenario(TINY, strategy=TYPE1, robots=N, engine=engine, seed=seed, worlds=24, steps=steps), record_worlds=()
        )
        for seed, engine in ((SEED, mjx(impl=impl, solver_iterations=20)), (99, MujocoSettings()))
    )
    ran(ours), ran(theirs)
    for what in ("delivered", "picked", "collisions"):
        samples = [[getattr(run.measures(w), what) for w in range(24)] for run in (ours, theirs)]
        print(impl, what, *map(np.mean, samples), ks_2samp(*samples).pvalue)
        assert ks_2samp(*samples).pvalue > 0.01
    times = [[run.measures(w).finished_at or steps for w in range(24)] for run in (ours, theirs)]
    assert ks_2samp(*times).pvalue > 0.01
