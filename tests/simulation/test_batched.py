"""Batched runs in MJX: the same swarm as on the CPU engine, worlds that differ, faults that are named."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import jax
import numpy as np
import pytest
from iswarm_mj.simulation.run_mjx import BatchRun, BatchSettings, _chunk, worlds_of_seed
from iswarm_mj.simulation.run_mujoco import Run, RunSettings
from iswarm_mj.workflows.benchmark_mjx import on_first_device

from iswarm_mj.config import ArenaConfig, GripperConfig, OpticsConfig, SwarmConfig
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.utils.errors import SimulationFault, UserError

TINY = SwarmConfig(arena=ArenaConfig(size=12, dump_size=3, dust_area_size=2, dust_area_offset=4, n_dust=12))
N, STEPS = 24, 20
WORLD = World(PRESETS["type1"], N, seed=5)


def ran(worlds, steps=STEPS, config=TINY, **settings):
    run = BatchRun(config, worlds, BatchSettings(steps, **{"chunk": 10, **settings}), devices=jax.devices("cpu")[:1])
    while not run.is_over:
        run.advance()
    return run


def poses(run):
    """Poses (B, N, 3) of the worlds."""
    return np.asarray(run.arrays()[1].bodies.poses)[: len(run.worlds)]


@pytest.fixture(scope="module")
def batch():
    """Three worlds of one seed."""
    return ran(worlds_of_seed(WORLD, 3))


def test_the_first_steps_are_those_of_the_cpu_engine():
    """The same random numbers, so only rounding parts them."""
    ours = ran(worlds_of_seed(WORLD, 3), steps=4)
    theirs = Run(TINY, WORLD.genome, RunSettings(N, 4, seed=5, n_worlds=3, n_threads=1))
    while not theirs.is_over:
        theirs.advance()
    off = np.abs(poses(ours) - theirs.engine.poses())[..., :2].max(axis=-1)
    assert np.median(off) < 1e-3 and off.max() < 0.5  # one robot's other choice after a rounding of its message
    for world in range(3):
        assert ours.measures(world) == theirs.measures(world)


def test_a_world_is_the_same_bits_in_any_batch_and_any_chunks(batch):
    alone = ran([replace(WORLD, index=1)], chunk=5)
    np.testing.assert_array_equal(poses(batch)[1], poses(alone)[0])
    assert batch.measures(1) == alone.measures(0)
    assert sum(batch.measures(w).picked for w in range(3)) > 3


def test_stages_are_timed_on_worlds_of_the_run_alone():
    """Of one world on a CPU there are two rows, the second a filler."""
    run = BatchRun(TINY, [WORLD], BatchSettings(1, chunk=1), devices=jax.devices("cpu")[:1])
    given, state, arena = on_first_device(run)
    assert {a.shape[0] for a in jax.tree.leaves((given, state))} == {1}
    assert not np.asarray(state.is_finished).any()
    np.testing.assert_array_equal(state.bodies.poses, poses(run))
    assert [a.shape for a in jax.tree.leaves(arena)] == [a.shape for a in jax.tree.leaves(run.arena)]


def test_worlds_of_other_sizes_and_genomes(batch):
    """In a batch for more robots, each world does what it does alone, but for rounding."""
    small, other = replace(WORLD, n_robots=15), replace(WORLD, genome=PRESETS["type2"], index=1)
    mixed = ran([small, other, WORLD], steps=4)
    for world, place, n in ((small, 0, 15), (other, 1, N), (WORLD, 2, N)):
        alone = ran([world], steps=4, chunk=5)
        off = np.abs(poses(mixed)[place, :n] - poses(alone)[0])[..., :2].max(axis=-1)
        assert np.median(off) < 1e-3 and off.max() < 0.5
    assert np.abs(poses(mixed)[1] - poses(mixed)[2]).max() > 1


def test_worlds_of_other_conditions():
    """At 50 % RH this tool lifts nothing; a world without drops, one that always drops, and one of failed robots."""
    humid = replace(WORLD, gripper=GripperConfig(relative_humidity=50, grasp_voltage=20, drop_rate=0))
    loose = replace(WORLD, gripper=GripperConfig(drop_rate=1.0))
    deaf = replace(WORLD, optics=OpticsConfig(p_communication_break=1.0))
    dead = replace(WORLD, failed_fraction=1.0)
    run = ran([WORLD, humid, loose, deaf, dead], contact_room=4)  # the deaf do not avoid each other
    picked = [run.measures(w).picked for w in range(4)]
    carried = np.asarray(run.swarm_state().balls.carried_steps).sum(axis=1)
    assert picked[0] > 0 and picked[1] == 0 and picked[2] > 0
    assert carried[0] > 2 * carried[2] > 0
    hops = np.asarray(run.swarm_state().memory.dust.hop)
    assert hops[0].max() > 0 and hops[3].max() == 0
    np.testing.assert_allclose(poses(run)[4], run.starts[4].poses, atol=1e-5)


def test_a_fault_names_world_and_step():
    with pytest.raises(SimulationFault, match=r"step \d+, world [012]: more than 2 pairs .* give more --contact-room"):
        ran(worlds_of_seed(WORLD, 3), contact_room=0.05)


def test_what_is_recorded_is_what_happened(batch):
    run = BatchRun(TINY, worlds_of_seed(WORLD, 3), BatchSettings(STEPS, chunk=10, record_worlds=(2, 0)))
    chunks = [run.advance() for _ in range(2)]
    last = chunks[-1]
    np.testing.assert_array_equal(last.poses[-1], poses(batch)[[2, 0]])
    assert last.poses.shape == (10, 2, N, 3) and last.is_running.all()
    assert last.collisions[-1].tolist() == [batch.measures(w).collisions for w in (2, 0)]
    moved = np.linalg.norm(np.diff(np.concatenate([c.poses for c in chunks]), axis=0)[..., :2], axis=-1)
    np.testing.assert_allclose(moved.mean(axis=-1)[9:], last.speed, rtol=1e-4)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"impl": "torch"}, r"impl must be jax or warp.*\(got 'torch'\)"),
        ({"record_worlds": (3,)}, r"record_worlds must be .*numbers of worlds, 0 to 2 \(got"),
        ({"solver_iterations": 0}, r"solver_iterations must be .*\(got 0\)"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings, says):
    with pytest.raises(UserError, match=says):
        BatchRun(TINY, worlds_of_seed(WORLD, 3), BatchSettings(5, **settings))


def test_worlds_that_cannot_share_a_program_are_refused():
    for other in ({"optics": OpticsConfig(mode="power")}, {"gripper": GripperConfig(release_gap=4e-6)}):
        with pytest.raises(UserError, match="give such worlds a batch of their own"):
            BatchRun(TINY, [WORLD, replace(WORLD, **other)], BatchSettings(5))


CODE = """
import json, jax, numpy as np
from dataclasses import replace
import sys; sys.path.insert(0, "tests")
import conftest  # keeps what is compiled
from test_batched import TINY, WORLD, worlds_of_seed, BatchRun, BatchSettings
run = BatchRun(TINY, worlds_of_seed(WORLD, 3), BatchSettings(20, chunk=10, record_worlds=(0, 2)))
while not run.is_over:
    chunk = run.advance()
sums = np.asarray(chunk.poses[-1], float).sum((1, 2)).tolist()
print(json.dumps([run.mesh.size, [run.measures(w) for w in range(3)], sums]))
"""


@pytest.mark.parametrize(("devices", "used"), [(2, 2), pytest.param(4, 3, marks=pytest.mark.slow)])
def test_the_number_of_devices_changes_nothing(batch, devices, used):
    """Of three worlds two devices take two each, one of them a filler; of four devices three take one each."""
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    env = os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, env=env, check=True)
    size, measures, sums = json.loads(done.stdout.splitlines()[-1])
    assert size == used
    assert measures == [list(batch.measures(w)) for w in range(3)]
    np.testing.assert_array_equal(sums, np.asarray(poses(batch)[[0, 2]], float).sum((1, 2)))


@pytest.mark.slow
@pytest.mark.parametrize("impl", ["jax", "warp"])
def test_whole_runs_are_distributed_as_on_the_cpu_engine(impl):
    """Finishing time and deliveries of 24 worlds: two samples of one distribution, by Kolmogorov-Smirnov at 1 %."""
    from scipy.stats import ks_2samp

    pytest.importorskip("warp") if impl == "warp" else None
    steps = 100
    ours = ran(worlds_of_seed(WORLD, 24), steps, impl=impl, solver_iterations=20)
    theirs = Run(TINY, WORLD.genome, RunSettings(N, steps, seed=99, n_worlds=24))
    while not theirs.is_over:
        theirs.advance()
    for what in ("delivered", "picked", "collisions"):
        samples = [[getattr(run.measures(w), what) for w in range(24)] for run in (ours, theirs)]
        print(impl, what, *map(np.mean, samples), ks_2samp(*samples).pvalue)
        assert ks_2samp(*samples).pvalue > 0.01
    times = [[run.measures(w).finished_at or steps for w in range(24)] for run in (ours, theirs)]
    assert ks_2samp(*times).pvalue > 0.01


def test_genomes_need_no_other_program(batch):
    before = _chunk._cache_size()
    ran(worlds_of_seed(replace(WORLD, genome=Genome(p_vector_forget=0.9)), 3))
    assert _chunk._cache_size() == before
