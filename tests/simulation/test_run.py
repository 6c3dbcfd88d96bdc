"""Runs: balls are conserved, measures are counted, ends are found, and seeds determine all."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from support.mjx import compilations
from support.runs import N, check_balls, end_of, first_step, loop_of, poses_of, records, run_of
from support.worlds import centres

from iswarm_mj.config.swarm import INTERPRETATIONS
from iswarm_mj.engines.base import Motion
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import mm_from_rd

TYPE1 = PRESETS["type1"]
N_BALLS = 24
"""Balls of the small arena."""


def test_balls_are_neither_lost_nor_duplicated(small):
    run = run_of(small, steps=500)
    previous = first_step(run.start)
    check_balls(run, previous)
    was_picked = np.zeros(N_BALLS, bool)
    carried_steps = np.zeros(N_BALLS, int)
    n_held = []
    for record in records(run):
        check_balls(run, record)
        balls_before = previous.swarm.task
        balls = record.swarm.task

        # Delivered balls stay at the dump, and lying ones where they are.
        assert (balls.is_delivered >= balls_before.is_delivered).all()
        stays = (balls_before.is_lying & balls.is_lying) | balls_before.is_delivered
        np.testing.assert_array_equal(centres(record)[stays], centres(previous)[stays])

        was_picked |= balls.is_held[0]
        carried_steps += balls.is_held[0]
        np.testing.assert_array_equal(balls.carried_steps[0], carried_steps)
        n_held.append(balls.is_held.sum())
        previous = record

    measures = run.measures(0)
    assert max(n_held) >= 5
    assert measures.delivered == N_BALLS == measures.picked
    np.testing.assert_array_equal(was_picked, previous.swarm.task.was_picked[0])
    assert measures.mean_carriage_steps == pytest.approx(carried_steps.mean())


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

        key = "peak_bytes_in_use"
        stats_of_devices = [None, {key: 1.234e9}, {key: 1e9}, {}]
        loop_of(run).devices = [
            SimpleNamespace(memory_stats=lambda stats=stats: stats) for stats in stats_of_devices
        ]
        assert run.peak_memory_gb() == 1.23

    def test_collisions_are_new_contacts(self, small, monkeypatch):
        """Robots 0 and 5 touch, then 0 and 7, too; then one pair and both part and touch again."""
        partners_of_robot_0 = iter([[5], [7, 5], [7], [7, 5], [], [7, 5]])

        def move(engine, bodies, phases, is_running):
            partners = next(partners_of_robot_0)
            touching = np.zeros((1, engine.robot.most_partners, N), np.int32)
            touching[0, : len(partners), 0] = partners
            no_fault = np.zeros(1, np.int32)
            return Motion(bodies, touching, fault=no_fault, robot=no_fault)

        monkeypatch.setattr(MujocoEngine, "move", move)
        run = run_of(small, steps=6)
        collisions = [int(record.collisions[0]) for record in records(run)]
        assert collisions == [1, 2, 2, 3, 3, 5]

    @pytest.mark.parametrize("world", ["a", True, 0.0, None, 1, -1])
    def test_of_no_world_are_refused(self, small, world):
        run = run_of(small, steps=1)
        with pytest.raises(IndexError, match=r"world must be between 0 and 0 \(got "):
            run.measures(world)


class TestEnds:
    def test_a_run_stops_at_its_goal(self, small):
        goal = 7
        run = run_of(small, goal=goal)
        delivered = [run.measures(0).delivered for _ in records(run)]
        assert delivered[-1] >= goal > delivered[-2]
        assert run.measures(0).finished_at == run.step == len(delivered) < 200

    def test_a_run_stops_when_its_time_is_up(self, small):
        run = run_of(small, steps=3)
        steps = [record.step.tolist() for record in records(run)]
        assert steps == [[1], [2], [3]]
        assert run.measures(0).finished_at is None

    def test_the_first_step_is_timed_apart(self, small):
        """It compiles."""
        run = run_of(small, steps=3)
        run.advance()
        assert run.step_s is None
        end_of(run)
        assert len(run.watch.laps["advance"]) == 2
        run.watch.laps["advance"] = [1.0, 4.0]
        assert run.step_s == 2.5

    @pytest.mark.parametrize("fields", [{"steps": 2}, {"goal": 1}], ids=str)
    def test_a_run_that_is_over_does_not_go_on(self, small, fields):
        run = run_of(small, **fields)
        poses, measures = end_of(run)
        with pytest.raises(RuntimeError, match=rf"the run is over after {run.step} control steps"):
            run.advance()
        np.testing.assert_array_equal(poses_of(run), poses)
        assert [run.measures(0)] == measures


def no_links(poses, **_):
    """Return links in which nobody hears anybody."""
    shape = (*poses.shape[:2], 4)
    return Links(
        sender=np.zeros(shape, np.int32),
        valid=np.zeros(shape, bool),
        led=np.zeros(shape, np.int32),
        measured_bearing=np.zeros(shape, np.float32),
        true_distance=np.zeros(shape, np.float32),
    )


def test_without_light_all_keep_what_they_know_to_themselves(small, monkeypatch):
    """Nobody knows of a dump without having stood on it."""
    monkeypatch.setattr("iswarm_mj.engines.mujoco.sight.find_links", no_links)
    run = run_of(small, steps=25)
    stood_on_dump = np.zeros(N, bool)
    for record in records(run):
        dump = record.swarm.memory.dump
        stood_on_dump |= dump.known[0] & (dump.hop[0] == 0)
        assert not dump.hop.any()
    assert 0 < stood_on_dump.sum() < N


def test_the_start_is_recorded_too(small):
    run = run_of(small)
    record = first_step(run.start)
    start = run.starts[0]
    assert record.step.tolist() == [0]
    assert not record.links.valid.any()
    assert not record.collisions.any()
    np.testing.assert_array_equal(record.poses[0], start.poses)
    np.testing.assert_allclose(centres(record)[0, :, :2], start.task.position, atol=1e-6)


def test_the_dead_neither_move_nor_send_nor_carry(small):
    """They move only when pushed; measured distances of the others err as configured."""
    run = run_of(small, steps=60, seed=4, failed_fraction=0.5)
    is_dead = ~run.start.swarm.is_alive[0, 0]
    assert is_dead.sum() == 15

    reach_of_a_push = 6
    errors = []
    n_alone = 0
    before = run.start.poses[0, 0]
    for record in records(run):
        # Dead robots without a neighbour, and clear of the walls, do not move.
        after = record.poses[0]
        of_pairs = before[:, None, :2] - before[None, :, :2]
        distance = np.linalg.norm(of_pairs, axis=-1) + 99 * np.eye(N)
        is_clear = np.abs(before[:, :2]).max(axis=1) < mm_from_rd(small.arena.size) / 2 - 2.0
        is_alone = is_dead & is_clear & (distance.min(axis=1) > reach_of_a_push)
        n_alone += is_alone.sum()
        np.testing.assert_allclose(after[is_alone], before[is_alone], atol=1e-6)
        before = after

        # None sends, claims priority, or holds a ball.
        links = record.links
        valid = links.valid[0]
        assert not is_dead[links.sender[0][valid]].any()
        assert not record.has_priority[0, is_dead].any()
        balls = record.swarm.task
        assert not is_dead[balls.holder[0][balls.is_held[0]]].any()

        measured = record.measured_distance[links.valid]
        errors.extend(measured / links.true_distance[links.valid] - 1)
        message, is_right = run.payload.unpack(record.message[0][~is_dead])
        assert is_right.all()
        assert not message.led.any()

    assert n_alone > 20
    assert len(errors) > 500
    assert np.std(errors) == pytest.approx(0.1, rel=0.15)


def test_a_change_is_of_rules_and_conditions_of_all_worlds(small):
    """The parameters are then those of a run that begins with them."""
    changed_config = replace(
        small,
        drive=replace(small.drive, error_turn=5.0),
        strategy=INTERPRETATIONS["initial"].strategy,
    )
    run = run_of(small, worlds=2)
    run.change(changed_config, PRESETS["type2"])
    params, _ = run.arrays()
    expected, _ = run_of(changed_config, PRESETS["type2"], worlds=2).arrays()
    for leaf, expected_leaf in zip(jax.tree.leaves(params), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(leaf, expected_leaf)


class TestSeedsAndWorlds:
    def test_a_seed_determines_all(self, small):
        poses, measures = end_of(run_of(small, seed=4, steps=80))
        same_poses, same_measures = end_of(run_of(small, seed=4, steps=80))
        _, other_measures = end_of(run_of(small, seed=5, steps=80))
        np.testing.assert_array_equal(poses, same_poses)
        assert measures == same_measures != other_measures

    def test_worlds_err_by_seed_and_index(self, small):
        """Worlds with the same start soon differ."""
        start = run_of(small).starts[0]
        seeds_and_indices = ((0, 0), (1, 0), (0, 1))
        worlds = [World(TYPE1, N, seed, index, start=start) for seed, index in seeds_and_indices]
        poses, _ = end_of(run_of(small, steps=3, worlds=worlds))
        for first, second in ((0, 1), (0, 2), (1, 2)):
            assert np.abs(poses[first] - poses[second]).max() > 0.1


class TestCapacity:
    """Places for more robots than there are."""

    N_PLACES = 40

    def test_empty_places_do_not_matter(self, small):
        """Not in the last bit; only the mean of all robots' speeds is a sum in another order."""
        fields = {"worlds": 2, "steps": 30, "failed_fraction": 0.1}
        exact = run_of(small, **fields)
        roomy = run_of(small, **fields, capacity=self.N_PLACES)

        def of_robots(values):
            return values[:, :N] if values.shape[1:2] == (self.N_PLACES,) else values

        for record, roomy_record in zip(records(exact), records(roomy), strict=True):
            np.testing.assert_allclose(record.speed, roomy_record.speed, rtol=1e-12)
            roomy_record = jax.tree.map(of_robots, roomy_record._replace(speed=record.speed))
            jax.tree.map(np.testing.assert_array_equal, record, roomy_record)
        measures = [exact.measures(world) for world in range(2)]
        assert measures == [roomy.measures(world) for world in range(2)]
        assert measures[1].picked > 2

    def test_too_little_is_refused(self):
        says = r"capacity must be at least the number of robots \(got 29\)"
        with pytest.raises(UserError, match=says):
            RunSettings(30, 5, capacity=29)


def test_a_share_of_failed_robots_beyond_one_is_refused():
    with pytest.raises(UserError, match=r"failed_fraction must be between 0 and 1 \(got 1\.5\)"):
        RunSettings(n_robots=4, steps=1, failed_fraction=1.5)
