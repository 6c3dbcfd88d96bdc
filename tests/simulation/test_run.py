"""Runs: nothing is lost, worlds and seeds are what they should be, drives have limits, faults end their world alone."""

from dataclasses import replace
from itertools import combinations

import jax
import numpy as np
import platformdirs
import pytest
from helpers_runs import N, check_balls, end_of, engine_of, first_step, poses_of, records, run_of, scripted

from iswarm_mj.config import ArenaConfig, OpticsConfig, StrategyConfig, SwarmConfig
from iswarm_mj.engines.base import Motion, find_lost
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.decide import Situation
from iswarm_mj.simulation.initial import draw_start
from iswarm_mj.simulation.loop import decide_worlds
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import MujocoSettings, RunSettings
from iswarm_mj.simulation.worlds import World, vector_strategies
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.utils.errors import ConfigError, FaultKind, SimulationFault, UserError
from iswarm_mj.utils.units import RD

TYPE1 = PRESETS["type1"]
CROWD = 100
"""Robots in the densest swarm, and the capacity of another one, which shares its program."""


class TestBalls:
    @pytest.mark.parametrize("seed", range(2))
    def test_nothing_is_lost_or_duplicated(self, small, seed):
        run = run_of(small, seed=seed, steps=500)
        n_held, before = [], first_step(run.start)
        check_balls(run, before)
        was_picked = np.zeros(24, bool)
        carried = np.zeros(24, int)
        for record in records(run):
            check_balls(run, record)
            old, new = before.swarm.balls, record.swarm.balls
            assert (new.is_delivered >= old.is_delivered).all()
            stays = (old.is_lying & new.is_lying) | old.is_delivered
            np.testing.assert_array_equal(record.balls[stays], before.balls[stays])
            was_picked |= new.is_held[0]
            carried += new.is_held[0]
            np.testing.assert_array_equal(new.carried_steps[0], carried)
            n_held.append(new.is_held.sum())
            before = record
        assert max(n_held) >= 5 and run.measures(0).delivered == 24 == run.measures(0).picked
        np.testing.assert_array_equal(was_picked, before.swarm.balls.was_picked[0])
        assert run.measures(0).mean_carriage_steps == pytest.approx(carried.mean())

    def test_nothing_is_lost_when_robots_drop_some(self, small):
        """The drop rate of a world is a number at run time."""
        world = World(TYPE1, N, seed=1, gripper=replace(small.gripper, drop_rate=0.2))
        run, falls, last = run_of(small, worlds=[world]), 0, None
        for record in records(run):
            check_balls(run, record)
            balls = record.swarm.balls
            if last is not None:
                falls += int((last.is_held & balls.is_lying).sum())
            last = balls
        assert falls > 20
        assert run.measures(0).delivered > 0


class TestMeasures:
    def test_never_decrease(self, small):
        run = run_of(small, seed=2)
        seen = [(run.measures(0).delivered, run.measures(0).picked, run.measures(0).collisions) for _ in records(run)]
        assert (np.diff(seen, axis=0) >= 0).all()
        assert (np.array(seen)[:, 0] <= np.array(seen)[:, 1]).all()
        assert min(seen[-1]) >= 20

    def test_collisions_are_new_contacts(self, small, monkeypatch):
        """Robots 0 and 5 touch, 0 and 7 join, the first pair parts, touches again, both part, both touch."""
        script = iter([[5], [5, 7], [7], [5, 7], [], [5, 7]])

        def move(self, bodies, phases, is_running):
            touching = np.zeros((1, N, N), bool)
            touching[0, 0, next(script)] = True
            return Motion(bodies, touching, np.zeros(1, np.int32), np.zeros(1, np.int32))

        monkeypatch.setattr(MujocoEngine, "move", move)
        run = run_of(small, steps=6)
        assert [int(record.collisions[0]) for record in records(run)] == [1, 2, 2, 3, 3, 5]

    def test_collisions_of_a_real_run(self, small):
        """Contacts are read after the turn and after the walk."""
        run, total, touching, read = run_of(small, steps=40, seed=3), 0, set(), set()
        engine = engine_of(run)
        robot_of, step = {geom: k for k, geom in enumerate(engine._arena.hull)}, engine._step

        def step_and_read(*arguments):
            failed = step(*arguments)
            for contact in engine._batch.get_data(0, engine._scratch).contact:
                robots = [robot_of.get(geom) for geom in contact.geom]
                if contact.dist <= 0 and None not in robots:
                    read.add(frozenset(robots))
            return failed

        engine._step = step_and_read
        for record in records(run):
            total += len(read - touching)
            touching = set(read)
            read.clear()
            assert record.collisions[0] == total
        assert total > 20

    def test_a_run_stops_at_its_goal(self, small):
        run = run_of(small, stop_at=7)
        delivered = [run.measures(0).delivered for _ in records(run)]
        assert delivered[-1] >= 7 > delivered[-2]
        assert run.measures(0).finished_at == run.step == len(delivered) < 200

    def test_a_run_stops_when_its_time_is_up(self, small):
        run = run_of(small, steps=3)
        assert [record.step.tolist() for record in records(run)] == [[1], [2], [3]]
        assert run.measures(0).finished_at is None

    @pytest.mark.parametrize("settings", [{"steps": 2}, {"stop_at": 1}])
    def test_a_run_that_is_over_does_not_go_on(self, small, settings):
        run = run_of(small, **settings)
        poses, measures = end_of(run)
        with pytest.raises(RuntimeError, match=rf"the run is over after {run.step} control steps"):
            run.advance()
        np.testing.assert_array_equal(poses_of(run), poses)
        assert [run.measures(0)] == measures


class TestSeedsAndWorlds:
    def test_a_seed_determines_all(self, small):
        one, again, other = (end_of(run_of(small, seed=seed, steps=80)) for seed in (4, 4, 5))
        np.testing.assert_array_equal(one[0], again[0])
        assert one[1] == again[1] != other[1]

    def test_robots_err_by_the_seed_too(self, small):
        """The same start with another seed soon goes another way."""
        run = run_of(small, seed=0, steps=3)
        other = run_of(small, steps=3, worlds=[World(TYPE1, N, seed=1, start=run.starts[0])])
        assert np.abs(end_of(run)[0] - end_of(other)[0]).max() > 0.1

    def test_each_world_errs_in_its_own_way(self, small):
        """Three worlds with one start soon part."""
        start = run_of(small).starts[0]
        poses, _ = end_of(run_of(small, steps=3, worlds=[World(TYPE1, N, index=w, start=start) for w in range(3)]))
        for one, other in combinations(range(3), 2):
            assert np.abs(poses[one] - poses[other]).max() > 0.1

    def test_threads_do_not_matter(self, small):
        ends = [end_of(run_of(small, n_worlds=3, threads=n, steps=60)) for n in (1, 2)]
        np.testing.assert_array_equal(ends[0][0], ends[1][0])
        assert ends[0][1] == ends[1][1]
        assert np.abs(np.diff(ends[0][0], axis=0)).max(axis=(1, 2)).min() > 1.0  # worlds differ

    def test_a_world_is_the_same_in_any_batch(self, small):
        """Up to the rounding of float32, as programs for other shapes may round otherwise."""
        together = list(records(run_of(small, n_worlds=3, steps=5)))
        for world in range(3):
            alone = run_of(small, worlds=[World(TYPE1, N, index=world)], steps=5)
            for one, many in zip(records(alone), together, strict=True):
                np.testing.assert_allclose(one.poses[0], many.poses[world], atol=1e-3)
                np.testing.assert_array_equal(one.swarm.balls.is_held[0], many.swarm.balls.is_held[world])

    def test_empty_places_do_not_matter(self, small):
        """Not in the last bit; only the mean of all robots' speeds is a sum in another order."""
        exact, roomy = (run_of(small, n_worlds=3, steps=30, failed_fraction=0.1, capacity=c) for c in (None, CROWD))

        def are_equal(values, roomy):
            np.testing.assert_array_equal(values, roomy[:, :N] if roomy.shape[1:2] == (CROWD,) else roomy)

        for one, other in zip(records(exact), records(roomy), strict=True):
            np.testing.assert_allclose(one.speed, other.speed, rtol=1e-12)
            jax.tree.map(are_equal, one._replace(speed=0 * other.speed), other._replace(speed=0 * other.speed))
        assert [exact.measures(w) for w in range(3)] == [roomy.measures(w) for w in range(3)]
        assert exact.measures(1).picked > 2

    def test_too_little_capacity(self):
        with pytest.raises(UserError, match=r"capacity must be at least the number of robots \(got 29\)"):
            RunSettings(30, 5, capacity=29)

    def test_as_many_worlds_as_settings_say(self, small):
        with pytest.raises(UserError, match=r"worlds must be as many as n_worlds, 2 \(got 1\)"):
            Run(small, TYPE1, RunSettings(N, 5, n_worlds=2), worlds=[World(TYPE1, N)])

    def test_finished_worlds_stand_still(self, small):
        run = run_of(small, n_worlds=3, steps=300, stop_at=6)
        frozen = {}
        for record in records(run):
            for world in range(3):
                if world in frozen:
                    now = jax.tree.map(lambda a, w=world: a[w], record)
                    for name in ("swarm", "poses", "balls", "collisions"):
                        jax.tree.map(np.testing.assert_array_equal, getattr(now, name), getattr(frozen[world], name))
                    assert now.speed == 0.0 and not now.is_running
                elif run.measures(world).finished_at is not None:
                    assert run.measures(world).finished_at == run.step
                    frozen[world] = jax.tree.map(lambda a, w=world: a[w], record)
        ends = [run.measures(world).finished_at for world in range(3)]
        assert len(set(ends)) > 1 and None not in ends
        assert run.step == max(ends)


class TestWorldsOfDifferentSize:
    SIZES = (12, N, 1)
    """Robots; a program for N is shared with the other tests."""

    def worlds(self):
        return [World(TYPE1, n, index=index) for index, n in enumerate(self.SIZES)]

    def test_each_is_as_if_alone(self, small):
        """Robots that a world lacks are in its model, out of the way: only contact forces round otherwise."""
        run = run_of(small, worlds=self.worlds(), steps=60)
        together = list(records(run))
        for world, n_robots in enumerate(self.SIZES):
            alone = run_of(small, worlds=self.worlds()[world : world + 1] * 3, n_robots=n_robots, steps=60, capacity=N)
            for one, many in zip(records(alone), together, strict=True):
                np.testing.assert_allclose(many.poses[world], one.poses[0], atol=1e-8 if n_robots == 12 else 0, rtol=0)
                np.testing.assert_array_equal(many.links.valid[world], one.links.valid[0])
                assert many.collisions[world] == one.collisions[0]
            assert run.measures(world) == alone.measures(0)
        assert run.measures(0).collisions > 0 and run.measures(0).picked > 0 and run.measures(2).collisions == 0

    def test_absent_robots_do_nothing(self, small):
        run = run_of(small, worlds=self.worlds(), steps=20)
        before = poses_of(run)
        for record in records(run):
            step = np.linalg.norm((record.poses - before)[..., :2], axis=-1)
            before = record.poses
            for world, n_robots in enumerate(self.SIZES):
                assert record.speed[world] == pytest.approx(step[world, :n_robots].mean())
                assert not record.poses[world, n_robots:].any()
                assert not record.links.valid[world, n_robots:].any()
                assert (record.links.sender[world][record.links.valid[world]] < n_robots).all()
                balls = record.swarm.balls
                assert (balls.holder[world][balls.is_held[world]] < n_robots).all()
                assert not record.has_priority[world, n_robots:].any()
            _, state = run.arrays()
            assert not state.touching[0, :, 12:].any() and not state.touching[2].any()


def far_apart():
    """Poses of N robots that meet nobody in a step, at all headings."""
    grid = np.stack(np.meshgrid(np.arange(6) * 6.0 - 15, np.arange(5) * 6.0 - 12), -1).reshape(-1, 2)
    return np.column_stack([grid, np.linspace(-3, 3, N)])


class TestLimitsOfTheDrive:
    COMMANDS = ((3.0, 3.1), (-3.0, -3.1), (1.0, -0.5))
    """Turn [rad] and distance [mm] in each world, in place of what the paper's strategy wants."""

    def test_hold_after_any_strategy(self, small):
        start = run_of(small).starts[0]._replace(poses=far_apart())
        worlds = [World(TYPE1, N, index=index, start=start) for index in range(3)]
        turn, forward = np.array(self.COMMANDS).T
        strategy = scripted(run_of(small, worlds=worlds), step=1, robot=-1, turn=turn, forward=forward)
        run = run_of(small, worlds=worlds, strategy=strategy, steps=1)
        run.advance()
        moved = poses_of(run) - far_apart()
        limits = np.array([(np.pi / 2, np.sqrt(2)), (-np.pi / 2, -np.sqrt(2)), (1.0, -0.5)])
        heading = far_apart()[:, 2] + limits[:, :1]
        expected = np.stack([np.cos(heading), np.sin(heading)], axis=-1) * limits[:, 1, None, None]
        np.testing.assert_allclose(moved[..., 2], np.broadcast_to(limits[:, :1], (3, N)), atol=1e-6)
        np.testing.assert_allclose(moved[..., :2], expected, atol=1e-5)
        assert not run.faults


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs to the working directory


@pytest.mark.usefixtures("elsewhere")
class TestFaults:
    STEPS, GOAL = 200, 3

    def healthy(self, small):
        return run_of(small, n_worlds=3, steps=self.STEPS, stop_at=self.GOAL)

    def broken(self, small, value, column):
        """Robots 4 and 7 of world 2 are spoilt after two steps."""
        run = run_of(small, n_worlds=3, steps=5, stop_at=self.GOAL)
        run.advance()
        run.advance()
        engine = engine_of(run)
        engine._qpos[2, engine._arena.qpos[[4, 7], column]] = value
        return run

    def check_others(self, run, others, small):
        """They go on to their usual end, as if nothing had happened."""
        steps = run.settings.steps
        end, expected = end_of(run), end_of(run_of(small, n_worlds=3, steps=steps, stop_at=self.GOAL))
        for world in others:
            np.testing.assert_array_equal(end[0][world], expected[0][world])
            assert end[1][world] == expected[1][world]
        assert run.step == max(end[1][world].finished_at or steps for world in others)

    @pytest.mark.parametrize(
        "value, column, kind",
        [
            (np.nan, 0, FaultKind.POSE_NOT_FINITE),
            (np.nan, 2, FaultKind.POSE_NOT_FINITE),
            (np.inf, 2, FaultKind.POSE_NOT_FINITE),
            (1e3, 0, FaultKind.OUTSIDE),
            (-1e3, 1, FaultKind.OUTSIDE),
        ],
    )
    def test_of_poses_end_their_world_alone(self, small, value, column, kind):
        run = self.broken(small, value, column)
        before = poses_of(run)[2].copy()
        self.check_others(run, (0, 1), small)
        (fault,) = run.faults
        assert (fault.step, fault.world, fault.robots, fault.kind) == (3, 2, (4,), kind)
        np.testing.assert_array_equal(poses_of(run)[2], before)

    def test_of_commands_end_their_world_alone(self, small):
        strategy = scripted(self.healthy(small), step=[99, 9, 99], robot=5, turn=np.nan, forward=0.0)
        run = run_of(small, n_worlds=3, steps=self.STEPS, stop_at=self.GOAL, strategy=strategy)
        seen = np.array([record.is_running for record in records(run)])
        assert seen[:9].all() and not seen[9:, 1].any() and seen[9:, [0, 2]].any(axis=1).all()
        (fault,) = run.faults
        assert (fault.step, fault.world, fault.robots) == (9, 1, (5,))
        assert fault.kind == FaultKind.COMMAND_NOT_FINITE
        with pytest.raises(SimulationFault, match=r"^step 9, world 1: the command of robot 5 is not finite; make"):
            run.raise_faults()
        self.check_others(run, (0, 2), small)
        ends = [run.measures(world).finished_at for world in range(3)]
        assert ends[0] != ends[2] and ends[1] is None and None not in (ends[0], ends[2])

    def test_commands_must_be_finite(self, small):
        wrong = {"turn": [np.inf, 0.0, 0.0], "forward": [0.0, -np.inf, np.nan]}
        strategy = scripted(self.healthy(small), step=2, robot=[7, 8, 9], **wrong)
        run = run_of(small, n_worlds=3, strategy=strategy, steps=5)
        end_of(run)
        found = [(fault.step, fault.robots, fault.kind) for fault in run.faults]
        assert found == [(2, (robot,), FaultKind.COMMAND_NOT_FINITE) for robot in (7, 8, 9)]
        assert run.step == 2 and run.is_over

    @pytest.mark.parametrize("x, kind", [(np.nan, FaultKind.POSE_NOT_FINITE), (50.0, FaultKind.OUTSIDE)])
    def test_of_the_start(self, small, x, kind):
        healthy = run_of(small, n_worlds=3)
        poses = healthy.starts[1].poses.copy()
        poses[3, 0] = x
        start = healthy.starts[1]._replace(poses=poses)
        worlds = [healthy.worlds[0], replace(healthy.worlds[1], start=start), healthy.worlds[2]]
        run = run_of(small, worlds=worlds, steps=5, stop_at=self.GOAL)
        self.check_others(run, (0, 2), small)
        assert [(f.step, f.world, f.robots, f.kind) for f in run.faults] == [(1, 1, (3,), kind)]

    def test_when_all_worlds_have_one_the_run_is_over(self, small):
        strategy = scripted(run_of(small, n_worlds=3), step=[2, 4, 3], robot=[1, 2, 3], turn=np.nan, forward=0.0)
        run = run_of(small, n_worlds=3, strategy=strategy)
        assert len(list(records(run))) == run.step == 4
        with pytest.raises(SimulationFault, match=r"^step 2, world 0: [^;]*robot 1 .*; step 4, world 1: .*robot 3 "):
            run.raise_faults()
        with pytest.raises(RuntimeError, match="the run is over after 4 control steps"):
            run.advance()

    def test_without_one_nothing_is_raised(self, small):
        run = run_of(small, steps=1)
        end_of(run)
        assert run.faults == []
        run.raise_faults()

    def test_just_outside_is_outside(self):
        edge, present = 7.5 * RD, np.ones((1, N), bool)
        poses = np.zeros((1, N, 3))
        poses[0, 3, :2] = edge - 1e-6, 1e-6 - edge
        assert find_lost(poses, present, edge)[0].tolist() == [0]
        poses[0, 3, 1] = -1e-6 - edge
        bits, robot = find_lost(poses, present, edge)
        assert (bits.tolist(), robot.tolist()) == ([FaultKind.OUTSIDE], [3])
        present[0, 3] = False
        assert find_lost(poses, present, edge)[0].tolist() == [0]

    def test_poses_that_are_not_finite_come_first(self):
        poses = np.zeros((2, N, 3))
        poses[1, 8, 2], poses[1, 3, 0] = np.nan, 99.0
        bits, robot = find_lost(poses, np.ones((2, N), bool), 7.5 * RD)
        assert bits.tolist() == [0, FaultKind.POSE_NOT_FINITE | FaultKind.OUTSIDE] and robot[1] == 8

    def test_too_many_robots(self, small):
        with pytest.raises(UserError, match=r"n_robots must be between 1 and 216 "):
            run_of(small, n_robots=217)


class TestKindsOfSwarm:
    def test_scouts_alone_carry_nothing(self, small):
        run = run_of(small, Genome(fraction_scouts=1.0), steps=40)
        *_, record = records(run)
        assert record.swarm.memory.is_scout.all() and record.swarm.memory.dust.known.any()
        assert run.measures(0)[:2] == (0, 0) and record.speed[0] > 0

    def test_scouts_that_pick_in_a_tiny_arena_by_received_power(self):
        arena = ArenaConfig(size=10, dump_size=2, dust_area_size=2, dust_area_offset=3.5, n_dust=4)
        tiny = SwarmConfig(arena, optics=OpticsConfig(mode="power"), strategy=StrategyConfig(scouts_pick=True))
        run = run_of(tiny, Genome(fraction_scouts=1.0), n_robots=12, steps=150)
        n_links = 0
        for record in records(run):
            check_balls(run, record)
            n_links += record.links.valid.sum()
        assert run.measures(0).picked > 0 and n_links > 100

    def test_the_share_of_scouts(self, small):
        assert run_of(small, Genome(fraction_scouts=0.27)).start.swarm.memory.is_scout.sum() == 8

    def test_one_robot_alone(self, small):
        run = run_of(small, n_robots=1, steps=60, capacity=N)
        for record in records(run):
            check_balls(run, record)
            assert not record.links.valid.any() and record.collisions[0] == 0
        assert record.speed[0] > 0

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
    np.testing.assert_allclose(start.balls[0, :, :2], run.starts[0].balls.position, atol=1e-6)


def test_only_recorded_worlds_are_returned(small):
    every, some, none = (run_of(small, n_worlds=3, steps=2, record_worlds=w) for w in ((0, 1, 2), (2, 0), ()))
    assert none.advance() is None
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[:, [2, 0]], b), every.start, some.start)
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[:, [2, 0]], b), every.advance(), some.advance())


def test_programs_are_kept_for_the_next_process(small, tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda *_, **__: tmp_path)
    before = {name: getattr(jax.config, name) for name in ("jax_compilation_cache_dir", KEEP_FROM)}
    try:
        jax.config.update("jax_compilation_cache_dir", None)
        jax.config.update(KEEP_FROM, 1.0)
        run_of(small)
        assert jax.config.jax_compilation_cache_dir.startswith(str(tmp_path))
        assert getattr(jax.config, KEEP_FROM) == 0.0
    finally:
        for name, value in before.items():
            jax.config.update(name, value)


KEEP_FROM = "jax_persistent_cache_min_compile_time_secs"


def test_the_noise_of_two_steps_differs(small):
    run = run_of(small, steps=3)
    run.advance()
    params, state, running = run._loop._params, run._loop._state, np.ones(1, bool)
    sight = engine_of(run).sense(state.bodies, state.swarm.is_alive, running)
    poses = state.bodies.poses.astype(np.float32)

    def memories(step):
        situation = Situation(poses, sight, np.int32(step), running)
        decision = decide_worlds(small, run.robot, params, state.swarm, situation)
        return decision.swarm.memory

    same = jax.tree.map(lambda a, b: bool((np.asarray(a) == np.asarray(b)).all()), memories(7), memories(7))
    other = jax.tree.map(lambda a, b: bool((np.asarray(a) == np.asarray(b)).all()), memories(7), memories(8))
    assert all(jax.tree.leaves(same))
    assert not all(jax.tree.leaves(other))


def test_overlaps_stay_shallow_in_a_crowd(small):
    run = run_of(small, n_robots=CROWD, n_worlds=3, steps=15)
    engine, deepest = engine_of(run), 0.0
    for _ in records(run):
        for world in range(3):
            contact = engine._batch.get_data(world, engine._scratch).contact
            deepest = max(deepest, -contact.dist.min(initial=0.0))
    assert 0.05 < deepest < 0.75  # one step's approach of two robots at full speed is 0.47 mm


def test_the_dead_neither_move_nor_send_nor_carry(small):
    run = run_of(small, steps=60, seed=4, failed_fraction=0.5)
    dead = ~run.start.swarm.is_alive[0, 0]
    assert dead.sum() == 15
    heard, before, alone = False, run.start.poses[0, 0], 0
    for record in records(run):
        links, after = record.links, record.poses[0]
        apart = np.linalg.norm(before[:, None, :2] - before[None, :, :2], axis=-1) + 99 * np.eye(N)
        out_of_reach = dead & (apart.min(axis=1) > 6)
        alone += out_of_reach.sum()
        np.testing.assert_allclose(after[out_of_reach], before[out_of_reach], atol=1e-6)
        before = after
        assert not dead[links.sender[0][links.valid[0]]].any()
        assert not record.has_priority[0, dead].any()
        balls = record.swarm.balls
        assert not dead[balls.holder[0][balls.is_held[0]]].any()
        heard |= links.valid.any()
    assert heard and alone > 20  # the dead move only when pushed


def test_nobody_lives_and_nothing_happens(small):
    run = run_of(small, steps=5, failed_fraction=1.0)
    poses, _ = end_of(run)
    np.testing.assert_allclose(poses[0], run.starts[0].poses, atol=1e-9)


def test_a_share_of_failed_robots_beyond_one_is_refused():
    with pytest.raises(UserError, match=r"failed_fraction must be between 0 and 1 \(got 1\.5\)"):
        RunSettings(n_robots=4, steps=1, failed_fraction=1.5)


class TestWhatDoesNotFit:
    @pytest.mark.parametrize("field", ["poses", "is_alive"])
    def test_starts_of_other_sizes(self, small, field):
        start = draw_start(small, 5, 0, 0)
        start = start._replace(**{field: getattr(start, field)[:4]})
        with pytest.raises(ConfigError, match=rf"start\.{field} must be an array of shape \(5"):
            Run(small, TYPE1, RunSettings(5, 3), worlds=[World(TYPE1, 5, start=start)])

    def test_starts_with_other_balls(self, small):
        start = draw_start(small, 5, 0, 0)
        start = start._replace(balls=start.balls._replace(radius=start.balls.radius[:7]))
        with pytest.raises(ConfigError, match=r"start\.balls\.radius must be an array of 24 balls \(got \(7,\)\)"):
            Run(small, TYPE1, RunSettings(5, 3), worlds=[World(TYPE1, 5, start=start)])

    @pytest.mark.parametrize("values", [{"n_robots": 0}, {"seed": -1}, {"index": -1}, {"failed_fraction": 5.0}])
    def test_worlds(self, values):
        with pytest.raises(ConfigError, match=next(iter(values))):
            World(**{"genome": TYPE1, "n_robots": 5, **values})

    def test_a_run_of_more_robots_than_its_worlds(self, small):
        with pytest.raises(ConfigError, match=r"n_robots must be that of the largest world, 5 \(got 6\)"):
            Run(small, TYPE1, RunSettings(6, 3), worlds=[World(TYPE1, 5)])

    @pytest.mark.parametrize("engine", ["mjx", 3, MujocoSettings], ids=str)
    def test_engines(self, small, engine):
        with pytest.raises(ConfigError, match="engine must be MujocoSettings or PlanarSettings or MjxSettings"):
            Run(small, TYPE1, RunSettings(5, 3), engine)

    def test_more_deliveries_than_balls(self, small):
        with pytest.raises(ConfigError, match=r"stop_at must be between 1 and the number of balls, 24 \(got 25\)"):
            Run(small, TYPE1, RunSettings(5, 3, stop_at=25))

    def test_strategies_without_an_axis_of_worlds(self, small):
        strategy = vector_strategies(small, 0.9, [World(TYPE1, 5)] * 2)
        with pytest.raises(UserError, match=r"first axis of 1 worlds \(got shape \(2,\)\)"):
            Run(small, TYPE1, RunSettings(5, 3), strategy=strategy)

    def test_measures_of_a_world_that_is_not_there(self, small):
        run = Run(small, TYPE1, RunSettings(5, 3))
        for world in (-1, 1):
            with pytest.raises(IndexError, match="between 0 and 0"):
                run.measures(world)
