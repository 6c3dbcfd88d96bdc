"""The compiled loop: agreement with the host, worlds that differ, faults, ends, and devices."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from typing import NamedTuple

import jax
import numpy as np
import pytest
from support.mjx import (
    ENGINES,
    RECORDED,
    SEED,
    TINY,
    WORLDS,
    N,
    compilations,
    mjx,
    poses,
    ran,
    tiny_run,
    warp,
)
from support.runs import loop_of
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
TYPE2 = PRESETS["type2"]
WORLD = World(TYPE1, N, SEED)
ON_THE_HOST = {"mjx": MujocoSettings(1), "warp": PlanarSettings(1)}
"""Engine of the host that simulates what a compiled one does."""


def run_to_end(engine, genome=TYPE1, **fields):
    """Return a run of three tiny worlds after its end, and its records.

    Args:
        engine: settings of the engine.
        genome: genome of all worlds.
        fields: further fields of the scenario.
    """
    run = tiny_run(engine, strategy=genome, **fields)
    return run, ran(run)


class Batch(NamedTuple):
    """A run of three tiny worlds after its end."""

    name: str
    """Name of the engine in `ENGINES`."""
    run: Run
    record: StepRecord


@pytest.fixture(scope="module", params=["warp", pytest.param("mjx", marks=pytest.mark.slow)])
def batch(request):
    """A run of 20 control steps, in two calls of ten."""
    return Batch(request.param, *run_to_end(ENGINES[request.param]))


def assert_same_bits(tree, expected):
    """Check that two trees have the same structure and values."""
    assert jax.tree.structure(tree) == jax.tree.structure(expected)
    leaves = zip(jax.tree.leaves(tree), jax.tree.leaves(expected), strict=True)
    for leaf, expected_leaf in leaves:
        np.testing.assert_array_equal(leaf, expected_leaf)


def measures_of(run, worlds=range(WORLDS)):
    """Return the measures of worlds."""
    return [run.measures(world) for world in worlds]


def test_the_first_steps_are_those_on_the_host(batch):
    """Both draw the same random numbers, so only rounding parts them."""
    host_run, expected = run_to_end(ON_THE_HOST[batch.name], steps=3)
    assert_same_bits(batch.run.start, host_run.start)

    record = jax.tree.map(lambda a: a[:3], batch.record)
    assert jax.tree.structure(record) == jax.tree.structure(expected)
    assert jax.tree.map(np.shape, record) == jax.tree.map(np.shape, expected)
    for name in ("valid", "sender", "led"):
        np.testing.assert_array_equal(getattr(record.links, name), getattr(expected.links, name))
    for name in ("step", "has_priority", "collisions", "is_running"):
        np.testing.assert_array_equal(getattr(record, name), getattr(expected, name))

    np.testing.assert_allclose(record.poses, expected.poses, atol=0.02)
    expected_distance = expected.links.true_distance
    np.testing.assert_allclose(record.links.true_distance, expected_distance, atol=0.02)
    np.testing.assert_allclose(centres(record), centres(expected), atol=0.02)
    np.testing.assert_allclose(record.speed, expected.speed, rtol=1e-3)

    assert record.links.valid.sum() > 100
    assert record.collisions.max() > 0


def test_what_is_recorded_is_what_happened(batch):
    _, run, record = batch
    assert record.poses.shape == (20, 2, N, 3)
    assert record.is_running.all()
    assert record.step.tolist() == [[step, step] for step in range(1, 21)]
    np.testing.assert_array_equal(record.poses[-1], poses(run)[list(RECORDED)])

    collisions = [measures.collisions for measures in measures_of(run, RECORDED)]
    assert record.collisions[-1].tolist() == collisions
    assert sum(measures.picked for measures in measures_of(run)) > 3

    positions = np.concatenate([run.start.poses, record.poses])[..., :2]
    distance = np.linalg.norm(np.diff(positions, axis=0), axis=-1)
    np.testing.assert_allclose(distance.mean(axis=-1), record.speed, rtol=1e-4)


def test_a_fault_ends_its_world_alone(batch, monkeypatch):
    """World 1 begins as a heap with more pairs in contact than MJX has room for.

    With Warp, robot 3 is nowhere.
    """
    start = start_of(TINY, N, SEED, 1)
    if batch.name == "mjx":
        assert contact_capacity(TINY, N).pairs < N * (N - 1) / 2
        start = start._replace(poses=start.poses * [0.1, 0.1, 1])
        kind = FaultKind.TOO_MANY_PAIRS
        says = r"step 1, world 1: buffer of robot pairs full.*`contact_capacity`"
    else:
        start.poses[3, 0] = np.nan
        kind = FaultKind.POSE_NOT_FINITE
        says = "the pose of robot 3 is not finite"
    begin_with(monkeypatch, {1: start})
    worlds = [replace(WORLD, index=index) for index in range(3)]
    run, record = run_to_end(ENGINES[batch.name], worlds=worlds)

    (fault,) = run.faults
    assert fault.kind & kind
    assert (fault.world, fault.step) == (1, 1)
    with pytest.raises(SimulationFault, match=says):
        run.raise_faults()
    np.testing.assert_array_equal(poses(run)[1], start.poses.astype(np.float32))
    assert run.measures(1).collisions == 0

    # The other worlds are as in a run without the fault.
    sound = [0, 2]
    assert run.step == 20
    assert_same_bits(record, batch.record)
    assert measures_of(run, sound) == measures_of(batch.run, sound)
    np.testing.assert_array_equal(poses(run)[sound], poses(batch.run)[sound])


def test_a_run_may_end_within_a_call(batch):
    run, record = run_to_end(ENGINES[batch.name], steps=13)
    assert run.step == 13
    assert run.is_over
    assert_same_bits(record, jax.tree.map(lambda a: a[:13], batch.record))
    np.testing.assert_array_equal(poses(run)[list(RECORDED)], batch.record.poses[12])


def test_the_run_ends_with_the_last_world(monkeypatch):
    """Robot 3 begins nowhere in each; faults name worlds by their own numbers."""
    indices = range(4, 7)
    start = start_of(TINY, N, SEED, 0)
    start.poses[3, 0] = np.nan
    begin_with(monkeypatch, dict.fromkeys(indices, start))
    run, record = run_to_end(warp(), worlds=[replace(WORLD, index=index) for index in indices])

    assert run.is_over
    assert run.step == 1
    assert record.poses.shape == (1, 2, N, 3)
    faults = [(fault.world, fault.kind) for fault in run.faults]
    assert faults == [(index, FaultKind.POSE_NOT_FINITE) for index in indices]


class TestFinishedWorlds:
    """Three worlds that finish at the second delivery, the first of them in the third call."""

    FIELDS = {"goal": 2, "steps": 30, "seed": 33}  # noqa: RUF012

    @pytest.fixture(scope="class")
    @classmethod
    def finished(cls):
        return run_to_end(warp(), **cls.FIELDS)

    @staticmethod
    def ends_of(run):
        """Return the step after which each world finished."""
        return [measures.finished_at for measures in measures_of(run)]

    def test_they_stand_still(self, finished):
        run, record = finished
        assert run.is_over
        assert not run.faults
        ends = self.ends_of(run)
        assert max(ends) == run.step
        assert sorted(ends)[1] <= 20 < ends[0]

        for row, world in enumerate(RECORDED):
            end = ends[world]
            of_world = record.poses[:, row]
            assert (of_world[end:] == of_world[end - 1]).all()
            moves = (np.diff(of_world[:end], axis=0) != 0).any(axis=(1, 2))
            assert moves.all()
            is_running = [step < end for step in range(len(of_world))]
            assert record.is_running[:, row].tolist() == is_running

    def test_they_stay_finished_when_settings_and_swarm_are_replaced(self, finished):
        expected, _ = finished
        run = tiny_run(warp(), **self.FIELDS)
        run.advance()
        run.advance()
        run.change(TINY, TYPE2)
        run.edit(lambda swarm: swarm._replace(is_alive=~swarm.is_alive))
        ran(run)

        np.testing.assert_array_equal(poses(run)[1:], poses(expected)[1:])
        assert self.ends_of(run)[1:] == self.ends_of(expected)[1:]
        assert not run.measures(0).finished_at


def test_worlds_of_other_sizes_and_genomes():
    n_fewer = 15
    worlds = [
        replace(WORLD, n_robots=n_fewer),
        replace(WORLD, genome=TYPE2, index=1),
        replace(WORLD, index=2),
    ]
    run, _ = run_to_end(warp(), worlds=worlds, steps=4)
    expected, _ = run_to_end(ON_THE_HOST["warp"], worlds=worlds, steps=4)

    np.testing.assert_allclose(poses(run)[:, :n_fewer], poses(expected)[:, :n_fewer], atol=0.02)
    np.testing.assert_allclose(poses(run)[1:], poses(expected)[1:], atol=0.02)
    assert measures_of(run) == measures_of(expected)
    assert np.abs(poses(run)[1] - poses(run)[2]).max() > 1


def test_stages_are_timed_on_worlds_of_the_run_alone(batch):
    params, state, _ = loop_of(batch.run).on_first_device()
    assert {leaf.shape[0] for leaf in jax.tree.leaves((params, state))} == {WORLDS}
    assert_same_bits((params, state), batch.run.arrays())
    if batch.name == "warp":
        times = batch.run.stage_times()
        assert times.keys() == {"sense", "policy", "physics"}
        assert min(times.values()) > 0


@pytest.mark.parametrize(
    ("make", "fields", "says"),
    [
        (mjx, {"impl": "torch"}, r"impl must be jax or warp.*\(got 'torch'\)"),
        (mjx, {"solver_iterations": 0}, r"solver_iterations must be .*\(got 0\)"),
        (warp, {"impl": "jax"}, r"impl must be numba or warp.*\(got 'jax'\)"),
        (warp, {"chunk": 0}, r"chunk must be .*\(got 0\)"),
        (warp, {"devices": ()}, r"devices must be a tuple of JAX devices, or None \(got \(\)\)"),
    ],
)
def test_settings_that_do_not_fit_are_refused(make, fields, says):
    with pytest.raises(UserError, match=says):
        make(**fields)


def test_worlds_to_record_must_be_in_the_run():
    says = r"record_worlds must be .*worlds from 0 to 2 \(got \(3,\)\)"
    with pytest.raises(UserError, match=says):
        tiny_run(warp(), record_worlds=(3,))


def test_genomes_need_no_other_program(batch):
    with compilations() as names:
        tiny_run(ENGINES[batch.name], strategy=Genome(p_vector_forget=0.9)).advance()
    assert names == []


SUMS_ON_DEVICES = """
import json
import sys; sys.path.insert(0, "tests")
import conftest  # keeps what is compiled
from dataclasses import replace
from support.mjx import ENGINES, poses, ran, tiny_run
run = tiny_run(replace(ENGINES[sys.argv[1]], devices=None, chunk=5))
record = ran(run)
measures = [run.measures(world) for world in range(3)]
sums = [values.astype(float).sum((1, 2)).tolist() for values in (record.poses[-1], poses(run))]
print(json.dumps([len(run.devices), measures, sums]))
"""
"""Program that runs three tiny worlds on all devices, and prints their number and sums."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("batch", "n_devices", "n_used"),
    [("warp", 2, 2), ("warp", 4, 3), ("mjx", 2, 2), ("mjx", 4, 3)],
    indirect=["batch"],
)
def test_devices_and_chunks_change_no_bit(batch, n_devices, n_used):
    """Two devices take two of three worlds each, one of them padding; three of four take one."""
    flags = os.environ.get("XLA_FLAGS", "")
    flags = f"{flags} --xla_force_host_platform_device_count={n_devices}"
    finished = subprocess.run(
        [sys.executable, "-c", SUMS_ON_DEVICES, batch.name],
        capture_output=True,
        text=True,
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        check=True,
    )

    devices, measures, (sums_recorded, sums) = json.loads(finished.stdout.splitlines()[-1])
    assert devices == n_used
    assert measures == [list(of_world) for of_world in measures_of(batch.run)]
    recorded = batch.record.poses[-1].astype(float)
    np.testing.assert_array_equal(sums_recorded, recorded.sum((1, 2)))
    np.testing.assert_array_equal(sums, poses(batch.run).astype(float).sum((1, 2)))


@pytest.mark.slow
@pytest.mark.parametrize("impl", ["jax", "warp"])
def test_whole_runs_are_distributed_as_on_the_cpu_engine(impl):
    """Measures of 24 worlds are samples of one distribution, by Kolmogorov-Smirnov at 1 %."""
    from scipy.stats import ks_2samp

    if impl == "warp":
        pytest.importorskip("warp")
    n_worlds = 24
    n_steps = 100

    def samples_of(engine, seed):
        """Return the measures of all worlds by their names."""
        scenario = Scenario(
            TINY,
            strategy=TYPE1,
            robots=N,
            engine=engine,
            seed=seed,
            worlds=n_worlds,
            steps=n_steps,
        )
        run = Run(scenario, record_worlds=())
        ran(run)
        measures = measures_of(run, range(n_worlds))
        return {
            "delivered": [of_world.delivered for of_world in measures],
            "picked": [of_world.picked for of_world in measures],
            "collisions": [of_world.collisions for of_world in measures],
            "time": [of_world.finished_at or n_steps for of_world in measures],
        }

    compiled = samples_of(mjx(impl=impl, solver_iterations=20), SEED)
    on_the_host = samples_of(MujocoSettings(), 99)
    for name, sample in compiled.items():
        p_value = ks_2samp(sample, on_the_host[name]).pvalue
        print(impl, name, np.mean(sample), np.mean(on_the_host[name]), p_value)
        assert p_value > 0.01
