"""The loop on the host: shards of worlds and threads, neither of which changes a bit."""

import threading

import jax
import numpy as np
import pytest
from support.runs import N, end_of, poses_of, shards_of

from iswarm_mj.config.swarm import INTERPRETATIONS
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation import host_loop
from iswarm_mj.simulation.host_loop import MAX_WORLDS, WorldShard, shard_worlds
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario


def run_worlds(config, engine, n_worlds=9, steps=20, record_worlds=(), n_robots=N):
    """Return a run of worlds of seed 0."""
    scenario = Scenario(config, robots=n_robots, engine=engine, worlds=n_worlds, steps=steps)
    return Run(scenario, record_worlds=record_worlds)


def end_and_state(run):
    """Take a run to its end, and return poses, swarm, collisions and contacts of all worlds."""
    poses, _ = end_of(run)
    state = run.arrays()[1]
    return poses, jax.tree.map(np.asarray, (state.swarm, state.collisions, state.touching))


@pytest.fixture
def shards_of_four(monkeypatch):
    """Let shards have four worlds at most."""
    monkeypatch.setattr(host_loop, "MAX_WORLDS", 4)


class TestShards:
    @pytest.mark.parametrize("n_worlds", range(1, 70, 3))
    def test_have_each_world_once_and_hardly_differ_in_size(self, n_worlds):
        shards = shard_worlds(n_worlds)
        worlds = [world for shard in shards for world in range(n_worlds)[shard]]
        assert worlds == list(range(n_worlds))

        sizes = [shard.stop - shard.start for shard in shards]
        assert max(sizes) <= MAX_WORLDS
        assert max(sizes) - min(sizes) <= 1
        assert len(sizes) >= min(n_worlds, 2)

    def test_two_threads_take_as_many_of_eight_worlds(self):
        assert shard_worlds(8) == [slice(0, 4), slice(4, 8)]


def test_threads_do_not_matter(small, shards_of_four):
    """Not in the last bit; nine worlds are three shards."""
    on_one, on_two, on_seven = (run_worlds(small, PlanarSettings(n)) for n in (1, 2, 7))
    poses, measures = end_of(on_one)
    distance_of_worlds = np.abs(np.diff(poses, axis=0)).max(axis=(1, 2))
    assert distance_of_worlds.min() > 1.0

    for run in (on_two, on_seven):
        np.testing.assert_array_equal(end_of(run)[0], poses)
        assert [run.measures(world) for world in range(9)] == measures
        jax.tree.map(np.testing.assert_array_equal, run.arrays()[1], on_one.arrays()[1])


@pytest.mark.parametrize(("n_threads", "shards_a_thread"), [(1, 3), (2, 1.5), (7, 1)])
def test_stage_times_are_those_of_all_shards_of_a_thread(
    small, shards_of_four, n_threads, shards_a_thread
):
    """The median of a stage counts as often as a thread takes a shard.

    Stages without laps have no time.
    """
    run = run_worlds(small, PlanarSettings(n_threads))
    run.watch.laps["sense"] = [1.0, 9.0, 2.0]
    run.watch.laps["policy"] = []
    assert run.stage_times() == {"sense": 2.0 * shards_a_thread}


def test_a_world_is_the_same_in_any_batch(small, shards_of_four):
    """Whole states agree to the last bit, in shards of one to three worlds, on any threads."""
    of_nine = end_and_state(run_worlds(small, MujocoSettings(1), 9, steps=15))
    for n_worlds, threads in ((1, 1), (4, 5), (5, 2)):
        state = end_and_state(run_worlds(small, MujocoSettings(threads), n_worlds, steps=15))
        expected = jax.tree.map(lambda a, n_worlds=n_worlds: a[:n_worlds], of_nine)
        jax.tree.map(np.testing.assert_array_equal, state, expected)


@pytest.mark.slow
@pytest.mark.parametrize("interpretation", INTERPRETATIONS)
def test_a_world_of_many_robots_is_the_same_alone(interpretation):
    """Bit by bit with JAX 0.10.

    XLA of later versions rounds its program otherwise than that of ten worlds.
    """
    rounding = 0.0 if jax.__version_info__ < (0, 11) else 1e-6

    def state_of(n_worlds):
        engine = PlanarSettings(1)
        return end_and_state(
            run_worlds(INTERPRETATIONS[interpretation], engine, n_worlds, steps=30, n_robots=283)
        )

    def check(alone, among_others):
        tolerance = rounding if np.issubdtype(alone.dtype, np.floating) else 0.0
        np.testing.assert_allclose(alone, among_others[:1], rtol=tolerance, atol=tolerance)

    jax.tree.map(check, state_of(1), state_of(20))


def test_records_are_of_the_worlds_asked_for(small):
    """They come in the order asked for, whatever shards the worlds are in."""
    order = (5, 0, 4, 1)
    rows = list(order)
    of_all = run_worlds(small, PlanarSettings(2), 6, steps=5, record_worlds=tuple(range(6)))
    of_some = run_worlds(small, PlanarSettings(2), 6, steps=5, record_worlds=order)
    np.testing.assert_array_equal(of_all.start.poses[:, rows], of_some.start.poses)

    while not of_some.is_over:
        expected = jax.tree.map(lambda a: a[:, rows], of_all.advance())
        record = of_some.advance()
        jax.tree.map(np.testing.assert_array_equal, record, expected)
    np.testing.assert_array_equal(record.poses[-1], poses_of(of_some)[rows])


def test_without_recorded_worlds_there_are_no_records(small):
    assert run_worlds(small, PlanarSettings(2), 6, steps=5, record_worlds=()).advance() is None


def test_an_edit_gives_every_world_its_own_state(small):
    """World w gets w living robots and w balls that were picked up."""
    run = run_worlds(small, PlanarSettings(2), 6)
    assert run.measures(5).picked == 0
    world = np.arange(6)[:, None]
    is_alive = np.arange(N) < world
    was_picked = np.arange(24) < world

    run.edit(
        lambda swarm: swarm._replace(
            is_alive=is_alive, task=swarm.task._replace(was_picked=was_picked)
        )
    )
    np.testing.assert_array_equal(run.arrays()[1].swarm.is_alive, is_alive)
    assert [run.measures(world).picked for world in range(6)] == list(range(6))


class TestThreads:
    """Six worlds in two shards on two threads, after the step that compiles in one thread."""

    @pytest.fixture
    def run(self, small):
        run = run_worlds(small, PlanarSettings(2), 6)
        run.advance()
        return run

    def test_two_threads_work_at_a_time(self, run, monkeypatch):
        """Each of two shards waits for the other one, which would be for ever on one thread."""
        advance = WorldShard.advance
        meeting = threading.Barrier(2, timeout=60)

        def meet_and_advance(*arguments):
            meeting.wait()
            return advance(*arguments)

        monkeypatch.setattr(WorldShard, "advance", meet_and_advance)
        run.advance()
        assert run.step == 2

    def test_an_error_in_a_thread_is_raised_by_the_step(self, run, monkeypatch):
        advance = WorldShard.advance
        _, last_shard = shards_of(run)[-1]

        def fail_in_last_shard(shard, *arguments):
            if shard is last_shard:
                raise OSError("no more")
            return advance(shard, *arguments)

        monkeypatch.setattr(WorldShard, "advance", fail_in_last_shard)
        with pytest.raises(OSError, match="no more"):
            run.advance()
