"""The loop on the host: shares of the worlds, and as many threads as there are."""

import threading

import jax
import numpy as np
import pytest
from support.runs import N, end_of, poses_of

from iswarm_mj.config.swarm import INTERPRETATIONS
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation import host_loop
from iswarm_mj.simulation.host_loop import MAX_WORLDS, WorldShard, shard_worlds
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario


def run_in(config, engine, n_worlds=9, steps=20, record_worlds=(), n_robots=N):
    scenario = Scenario(config, robots=n_robots, engine=engine, worlds=n_worlds, steps=steps)
    return Run(scenario, record_worlds=record_worlds)


class TestShares:
    @pytest.mark.parametrize("n_worlds", range(1, 70, 3))
    def test_have_each_world_once_and_hardly_differ_in_size(self, n_worlds):
        sizes = [part.stop - part.start for part in shard_worlds(n_worlds)]
        assert [w for part in shard_worlds(n_worlds) for w in range(n_worlds)[part]] == list(range(n_worlds))
        assert max(sizes) <= MAX_WORLDS and max(sizes) - min(sizes) <= 1
        assert len(sizes) >= min(n_worlds, 2)

    def test_two_threads_take_as_many_of_eight_worlds(self):
        assert shard_worlds(8) == [slice(0, 4), slice(4, 8)]


def test_threads_do_not_matter(small, monkeypatch):
    """Not in the last bit; nine worlds are three shares here, so one of two threads takes two of them."""
    monkeypatch.setattr(host_loop, "MAX_WORLDS", 4)
    one, *others = (run_in(small, PlanarSettings(threads)) for threads in (1, 2, 7))
    poses, measures = end_of(one)
    assert np.abs(np.diff(poses, axis=0)).max(axis=(1, 2)).min() > 1.0  # worlds differ
    for run, turns in zip((one, *others), (3, 1.5, 1), strict=True):  # in which each thread takes its shares
        run.watch.laps.clear()
        run.watch.laps["sense"], run.watch.laps["policy"] = [1.0, 9.0, 2.0], []
        assert run.stage_times() == {"sense": 2.0 * turns}
    for other in others:
        np.testing.assert_array_equal(end_of(other)[0], poses)
        assert [other.measures(w) for w in range(9)] == measures
        jax.tree.map(np.testing.assert_array_equal, other.arrays()[1], one.arrays()[1])


def test_a_world_is_the_same_in_any_batch(small, monkeypatch):
    """Whole states in the last bit, alone and among others, in shares of one world to three, on any threads."""
    monkeypatch.setattr(host_loop, "MAX_WORLDS", 4)
    most = end_and_state(run_in(small, MujocoSettings(1), 9, 15))
    for n_worlds, threads in ((1, 1), (4, 5), (5, 2)):
        found = end_and_state(run_in(small, MujocoSettings(threads), n_worlds, 15))
        of_most = jax.tree.map(lambda a, n=n_worlds: a[:n], most)
        jax.tree.map(np.testing.assert_array_equal, found, of_most)


@pytest.mark.slow
@pytest.mark.parametrize("reading", INTERPRETATIONS)
def test_a_world_of_many_robots_is_the_same_alone(reading):
    """Bit by bit with JAX 0.10; XLA of later versions rounds its program otherwise than that of ten worlds."""
    config = INTERPRETATIONS[reading]
    one = run_in(config, PlanarSettings(1), 1, 30, n_robots=283)
    many = run_in(config, PlanarSettings(1), 20, 30, n_robots=283)
    of_many = jax.tree.map(lambda a: a[:1], end_and_state(many))
    rounding = 0.0 if jax.__version_info__ < (0, 11) else 1e-6

    def check(alone, among):
        tolerance = rounding if np.issubdtype(alone.dtype, np.floating) else 0.0
        np.testing.assert_allclose(alone, among, rtol=tolerance, atol=tolerance)

    jax.tree.map(check, end_and_state(one), of_many)


def end_and_state(run):
    """Poses of all worlds after the run, and all that their robots remember and that became of the balls."""
    poses, _ = end_of(run)
    state = run.arrays()[1]
    return poses, jax.tree.map(np.asarray, (state.swarm, state.collisions, state.touching))


def test_records_are_of_the_worlds_asked_for(small):
    """In their order, whatever shares they are in."""
    picked = (5, 0, 4, 1)
    everything, some, none = (run_in(small, PlanarSettings(2), 6, 5, rows) for rows in (tuple(range(6)), picked, ()))
    assert none.advance() is None
    np.testing.assert_array_equal(everything.start.poses[:, list(picked)], some.start.poses)
    while not some.is_over:
        every, found = everything.advance(), some.advance()
        jax.tree.map(lambda all_, of: np.testing.assert_array_equal(all_[:, list(picked)], of), every, found)
    np.testing.assert_array_equal(found.poses[-1], poses_of(some)[list(picked)])


def test_every_world_is_given_its_own_state(small):
    run = run_in(small, PlanarSettings(2), 6)
    assert run.measures(5).picked == 0
    alive, picked = np.arange(N) < np.arange(6)[:, None], np.arange(24) < np.arange(6)[:, None]
    run.edit(lambda swarm: swarm._replace(is_alive=alive, task=swarm.task._replace(was_picked=picked)))
    np.testing.assert_array_equal(run.arrays()[1].swarm.is_alive, alive)
    assert [run.measures(world).picked for world in range(6)] == list(range(6))


def test_two_threads_work_at_a_time(small, monkeypatch):
    """Each of two shares waits for the other one, which would be for ever on one thread."""
    run, advance = run_in(small, PlanarSettings(2), 6), WorldShard.advance
    run.advance()  # compiles, one share after the other
    meeting = threading.Barrier(2, timeout=60)

    def meet(*arguments):
        meeting.wait()
        return advance(*arguments)

    monkeypatch.setattr(WorldShard, "advance", meet)
    run.advance()
    assert run.step == 2


def test_what_fails_in_a_thread_fails_the_step(small, monkeypatch):
    run, advance = run_in(small, PlanarSettings(2), 6), WorldShard.advance
    run.advance()
    last = run._loop._shards[-1]

    def fail(own, *arguments):
        if own is last:
            raise OSError("no more")
        return advance(own, *arguments)

    monkeypatch.setattr(WorldShard, "advance", fail)
    with pytest.raises(OSError, match="no more"):
        run.advance()
