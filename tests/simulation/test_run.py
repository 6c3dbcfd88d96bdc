"""Runs: nothing is lost, and all kinds of swarm run."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from support.mjx import compilations
from support.runs import N, check_balls, end_of, first_step, poses_of, records, run_of
from support.worlds import centres

from iswarm_mj.config.swarm import INTERPRETATIONS
from iswarm_mj.engines.base import Motion
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import UserError

TYPE1 = PRESETS["type1"]


class TestBalls:
    def test_nothing_is_lost_or_duplicated(self, small):
        run = run_of(small, steps=500)
        n_held, before = [], first_step(run.start)
        check_balls(run, before)
        was_picked = np.zeros(24, bool)
        carried = np.zeros(24, int)
        for record in records(run):
            check_balls(run, record)
            old, new = before.swarm.task, record.swarm.task
            assert (new.is_delivered >= old.is_delivered).all()
            stays = (old.is_lying & new.is_lying) | old.is_delivered
            np.testing.assert_array_equal(centres(record)[stays], centres(before)[stays])
            was_picked |= new.is_held[0]
            carried += new.is_held[0]
            np.testing.assert_array_equal(new.carried_steps[0], carried)
            n_held.append(new.is_held.sum())
            before = record
        assert max(n_held) >= 5 and run.measures(0).delivered == 24 == run.measures(0).picked
        np.testing.assert_array_equal(was_picked, before.swarm.task.was_picked[0])
        assert run.measures(0).mean_carriage_steps == pytest.approx(carried.mean())


class TestMeasures:
    def test_are_counted_on_the_host(self, small):
        """Measures of many worlds would else be many calls of JAX."""
        run = run_of(small, steps=2)
        run.advance()
        with compilations() as names:
            assert all(type(leaf) is np.ndarray for leaf in jax.tree.leaves(run.task_state))
            run.measures(0)
        assert names == []

    def test_the_most_memory_is_that_of_the_fullest_device(self, small):
        run = run_of(small, steps=1)
        assert run.peak_memory_gb() is None
        stats = None, {"peak_bytes_in_use": 1.234e9}, {"peak_bytes_in_use": 1e9}, {}
        run._loop.devices = [SimpleNamespace(memory_stats=lambda found=found: found) for found in stats]
        assert run.peak_memory_gb() == 1.23

    def test_collisions_are_new_contacts(self, small, monkeypatch):
        """Robots 0 and 5 touch, 0 and 7 join, the first pair parts, touches again, both part, both touch."""
        script = iter([[5], [7, 5], [7], [7, 5], [], [7, 5]])

        def move(self, bodies, phases, is_running):
            partners, touching = next(script), np.zeros((1, self.robot.most_partners, N), np.int32)
            touching[0, : len(partners), 0] = partners
            return Motion(bodies, touching, np.zeros(1, np.int32), np.zeros(1, np.int32))

        monkeypatch.setattr(MujocoEngine, "move", move)
        run = run_of(small, steps=6)
        assert [int(record.collisions[0]) for record in records(run)] == [1, 2, 2, 3, 3, 5]

    def test_a_run_stops_at_its_goal(self, small):
        run = run_of(small, goal=7)
        delivered = [run.measures(0).delivered for _ in records(run)]
        assert delivered[-1] >= 7 > delivered[-2]
        assert run.measures(0).finished_at == run.step == len(delivered) < 200

    def test_a_run_stops_when_its_time_is_up(self, small):
        """Of its three steps the first one is timed apart."""
        run = run_of(small, steps=3)
        assert next(records(run)).step.tolist() == [1] and run.step_s is None
        assert [record.step.tolist() for record in records(run)] == [[2], [3]]
        assert run.measures(0).finished_at is None and len(run.watch.laps["advance"]) == 2
        run.watch.laps["advance"] = [1.0, 4.0]
        assert run.step_s == 2.5

    @pytest.mark.parametrize("settings", [{"steps": 2}, {"goal": 1}])
    def test_a_run_that_is_over_does_not_go_on(self, small, settings):
        run = run_of(small, **settings)
        poses, measures = end_of(run)
        with pytest.raises(RuntimeError, match=rf"the run is over after {run.step} control steps"):
            run.advance()
        np.testing.assert_array_equal(poses_of(run), poses)
        assert [run.measures(0)] == measures


class TestKindsOfSwarm:
    def test_without_light_all_keep_what_they_know_to_themselves(self, small, monkeypatch):
        """Nobody knows of a dump without having stood on it."""
        monkeypatch.setattr("iswarm_mj.engines.mujoco.sight.find_links", lambda poses, *_: _nobody(poses))
        run = run_of(small, steps=25)
        stood = np.zeros(N, bool)
        for record in records(run):
            dump = record.swarm.memory.dump
            stood |= dump.known[0] & (dump.hop[0] == 0)
            assert not dump.hop.any()
        assert 0 < stood.sum() < N


def _nobody(poses):
    shape = (*poses.shape[:2], 4)
    zero, off = np.zeros(shape, np.float32), np.zeros(shape, bool)
    return Links(np.zeros(shape, np.int32), off, np.zeros(shape, np.int32), zero, zero)


def test_the_start_is_recorded_too(small):
    run = run_of(small)
    start = first_step(run.start)
    assert start.step.tolist() == [0] and not start.links.valid.any() and not start.collisions.any()
    np.testing.assert_array_equal(start.poses[0], run.starts[0].poses)
    np.testing.assert_allclose(centres(start)[0, :, :2], run.starts[0].task.position, atol=1e-6)


def test_the_dead_neither_move_nor_send_nor_carry(small):
    run = run_of(small, steps=60, seed=4, failed_fraction=0.5)
    dead = ~run.start.swarm.is_alive[0, 0]
    assert dead.sum() == 15
    errors, before, alone = [], run.start.poses[0, 0], 0
    for record in records(run):
        links, after = record.links, record.poses[0]
        apart = np.linalg.norm(before[:, None, :2] - before[None, :, :2], axis=-1) + 99 * np.eye(N)
        out_of_reach = dead & (apart.min(axis=1) > 6)
        alone += out_of_reach.sum()
        np.testing.assert_allclose(after[out_of_reach], before[out_of_reach], atol=1e-6)
        before = after
        assert not dead[links.sender[0][links.valid[0]]].any()
        assert not record.has_priority[0, dead].any()
        balls = record.swarm.task
        assert not dead[balls.holder[0][balls.is_held[0]]].any()
        errors.extend(record.measured_distance[links.valid] / links.true_distance[links.valid] - 1)
        (message, is_right) = run.payload.unpack(record.message[0][~dead])
        assert is_right.all() and not message.led.any()
    assert alone > 20  # the dead move only when pushed
    assert len(errors) > 500 and np.std(errors) == pytest.approx(0.1, rel=0.15)  # as configured


@pytest.mark.parametrize("world", ["a", True, 0.0, None, 1, -1])
def test_measures_of_no_world_are_refused(small, world):
    with pytest.raises(IndexError, match=r"world must be between 0 and 0 \(got "):
        run_of(small, steps=1).measures(world)


def test_a_share_of_failed_robots_beyond_one_is_refused():
    with pytest.raises(UserError, match=r"failed_fraction must be between 0 and 1 \(got 1\.5\)"):
        RunSettings(n_robots=4, steps=1, failed_fraction=1.5)


def test_a_change_is_of_rules_and_conditions_of_all_worlds(small):
    """As of a run that begins with them."""
    drive, rules = replace(small.drive, error_turn=5.0), INTERPRETATIONS["initial"].strategy
    other, run = replace(small, drive=drive, strategy=rules), run_of(small, worlds=2)
    run.change(other, PRESETS["type2"])
    begun = run_of(other, PRESETS["type2"], worlds=2)
    for mine, its in zip(jax.tree.leaves(run.arrays()[0]), jax.tree.leaves(begun.arrays()[0]), strict=True):
        np.testing.assert_array_equal(mine, its)


ROOMY = 40


class TestSeedsAndWorlds:
    def test_a_seed_determines_all(self, small):
        one, again, other = (end_of(run_of(small, seed=seed, steps=80)) for seed in (4, 4, 5))
        np.testing.assert_array_equal(one[0], again[0])
        assert one[1] == again[1] != other[1]

    def test_worlds_err_by_seed_and_index(self, small):
        """With one start all soon go their own ways."""
        start = run_of(small).starts[0]
        worlds = [World(TYPE1, N, seed, index, start=start) for seed, index in ((0, 0), (1, 0), (0, 1))]
        poses, _ = end_of(run_of(small, steps=3, worlds=worlds))
        assert all(np.abs(poses[one] - poses[other]).max() > 0.1 for one, other in ((0, 1), (0, 2), (1, 2)))

    def test_empty_places_do_not_matter(self, small):
        """Not in the last bit; only the mean of all robots' speeds is a sum in another order."""
        exact, roomy = (run_of(small, worlds=2, steps=30, failed_fraction=0.1, capacity=c) for c in (None, ROOMY))

        def are_equal(values, roomy):
            np.testing.assert_array_equal(values, roomy[:, :N] if roomy.shape[1:2] == (ROOMY,) else roomy)

        for one, other in zip(records(exact), records(roomy), strict=True):
            np.testing.assert_allclose(one.speed, other.speed, rtol=1e-12)
            jax.tree.map(are_equal, one._replace(speed=0 * other.speed), other._replace(speed=0 * other.speed))
        assert [exact.measures(w) for w in range(2)] == [roomy.measures(w) for w in range(2)]
        assert exact.measures(1).picked > 2

    def test_too_little_capacity(self):
        with pytest.raises(UserError, match=r"capacity must be at least the number of robots \(got 29\)"):
            RunSettings(30, 5, capacity=29)
