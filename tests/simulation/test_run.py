"""Runs: nothing is lost, worlds and seeds are what they should be, faults are named."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from iswarm_mj.simulation.run_mujoco import Run, RunSettings

from iswarm_mj.config import ArenaConfig, OpticsConfig, StrategyConfig, SwarmConfig
from iswarm_mj.simulation import run_mujoco as rollout
from iswarm_mj.simulation import step as swarm
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.units import RD

N = 30


def run_of(config, genome=PRESETS["type1"], n_robots=N, steps=200, **settings):
    return Run(config, genome, RunSettings(n_robots, steps, **{"n_threads": 1, **settings}))


def views(run):
    while not run.is_over:
        yield run.advance()


def check_balls(run, view):
    """Each ball is lying, held or delivered; held ones hang at a tip, one a robot; delivered ones lie in the dump."""
    balls, arena = view.state.balls, run.config.arena
    for world in range(run.settings.n_worlds):
        held, delivered = np.asarray(balls.is_held)[world], np.asarray(balls.is_delivered)[world]
        lying = np.asarray(balls.is_lying)[world]
        assert lying.sum() + held.sum() + delivered.sum() == arena.n_dust
        assert not (held & delivered).any() and not (lying & (held | delivered)).any()
        holder = np.asarray(balls.holder)[world]
        assert len(set(holder[held])) == held.sum()
        x, y, yaw = view.poses[world, holder[held]].T
        ahead, beside = run.arena.probe
        tip = [x + ahead * np.cos(yaw) - beside * np.sin(yaw), y + ahead * np.sin(yaw) + beside * np.cos(yaw)]
        np.testing.assert_allclose(view.balls[world, held, :2].T, tip, atol=1e-5)
        assert (view.balls[world, held, 2] < run.arena.tip_height).all()
        assert np.abs(view.balls[world, delivered, :2]).max(initial=0.0) <= arena.dump_size / 2 * RD + 1e-4
        radius = np.asarray(balls.radius)[world]
        np.testing.assert_allclose(view.balls[world, ~held, 2], 1e3 * radius[~held], rtol=1e-6)


class TestBalls:
    @pytest.mark.parametrize("seed", range(2))
    def test_nothing_is_lost_or_duplicated(self, small, seed):
        run = run_of(small, seed=seed, steps=500)
        n_held, before = [], run.start_view()
        check_balls(run, before)
        was_picked = np.zeros(24, bool)
        carried = np.zeros(24, int)
        for view in views(run):
            check_balls(run, view)
            old, new = before.state.balls, view.state.balls
            assert (np.asarray(new.is_delivered) >= np.asarray(old.is_delivered)).all()
            stays = np.asarray((old.is_lying & new.is_lying) | old.is_delivered)
            np.testing.assert_array_equal(view.balls[stays], before.balls[stays])
            was_picked |= np.asarray(new.is_held)[0]
            carried += np.asarray(new.is_held)[0]
            np.testing.assert_array_equal(new.carried_steps[0], carried)
            n_held.append(new.is_held.sum())
            before = view
        assert max(n_held) >= 5 and run.measures(0).delivered == 24 == run.measures(0).picked
        np.testing.assert_array_equal(was_picked, before.state.balls.was_picked[0])
        assert run.measures(0).mean_carriage_steps == pytest.approx(carried.mean())

    def test_the_engine_has_them_where_the_run_has_them(self, small):
        run = run_of(small, steps=20)
        for view in views(run):
            np.testing.assert_allclose(run.engine._mocap[:, run.arena.mocap], view.balls, atol=1e-9)
        assert np.asarray(view.state.balls.is_held).any()

    def test_nothing_is_lost_when_robots_drop_some(self, small):
        dropping = replace(small, gripper=replace(small.gripper, drop_rate=0.2))
        run, falls, last = run_of(dropping, seed=1), 0, None
        for view in views(run):
            check_balls(run, view)
            balls = view.state.balls
            if last is not None:
                falls += int((last.is_held & balls.is_lying).sum())
            last = balls
        assert falls > 20
        assert run.measures(0).delivered > 0


class TestMeasures:
    def test_never_decrease(self, small):
        run = run_of(small, seed=2)
        seen = [(run.measures(0).delivered, run.measures(0).picked, run.measures(0).collisions) for _ in views(run)]
        assert (np.diff(seen, axis=0) >= 0).all()
        assert (np.array(seen)[:, 0] <= np.array(seen)[:, 1]).all()
        assert min(seen[-1]) >= 20

    def test_collisions_are_new_contacts(self, small, monkeypatch):
        """Pair 5 comes, 7 joins it, 5 goes, comes again, both go, both come."""
        script = iter([[5], [5, 7], [7], [5, 7], [], [5, 7]])
        monkeypatch.setattr(swarm, "drive", lambda *_: [np.array(next(script), int)])
        run = run_of(small, steps=6)
        assert [int(view.collisions[0]) for view in views(run)] == [1, 2, 2, 3, 3, 5]

    def test_collisions_of_a_real_run(self, small):
        """Contacts are read after the turn and after the walk."""
        run, total, touching = run_of(small, steps=40, seed=3), 0, set()
        advance, read = run.engine.advance, []

        def advance_and_read(*arguments):
            advance(*arguments)
            read.extend(run.engine.contacts(0).tolist())

        run.engine.advance = advance_and_read
        for view in views(run):
            now = set(read)
            read.clear()
            total += len(now - touching)
            touching = now
            assert view.collisions[0] == total
        assert total > 20

    def test_a_run_stops_at_its_goal(self, small):
        run = run_of(small, stop_at=7)
        delivered = [run.measures(0).delivered for _ in views(run)]
        assert delivered[-1] >= 7 > delivered[-2]
        assert run.measures(0).finished_at == run.step == len(delivered) < 200

    def test_a_run_stops_when_its_time_is_up(self, small):
        run = run_of(small, steps=3)
        assert [view.step for view in views(run)] == [1, 2, 3]
        assert run.measures(0).finished_at is None


def end_of(run):
    for _ in views(run):
        pass
    return run.engine.poses(), [run.measures(w) for w in range(run.settings.n_worlds)]


class TestSeedsAndWorlds:
    def test_a_seed_tells_all(self, small):
        one, again, other = (end_of(run_of(small, seed=seed)) for seed in (4, 4, 5))
        np.testing.assert_array_equal(one[0], again[0])
        assert one[1] == again[1] != other[1]

    def test_robots_err_by_the_seed_too(self, small):
        """The same start with another seed soon goes another way."""
        runs = [run_of(small, seed=0, steps=3)]
        runs.append(Run(small, Genome(), RunSettings(N, 3, seed=1, n_threads=1), runs[0].starts))
        ends = [end_of(run)[0] for run in runs]
        assert np.abs(ends[0] - ends[1]).max() > 0.1

    def test_each_world_errs_in_its_own_way(self, small):
        """Three worlds with one start soon part."""
        settings = RunSettings(N, 3, n_worlds=3, n_threads=1)
        poses, _ = end_of(Run(small, Genome(), settings, run_of(small).starts * 3))
        for one, other in ((0, 1), (0, 2), (1, 2)):
            assert np.abs(poses[one] - poses[other]).max() > 0.1

    def test_threads_do_not_matter(self, small):
        ends = [end_of(run_of(small, n_worlds=3, n_threads=n, steps=60)) for n in (1, 2)]
        np.testing.assert_array_equal(ends[0][0], ends[1][0])
        assert ends[0][1] == ends[1][1]
        assert np.abs(np.diff(ends[0][0], axis=0)).max(axis=(1, 2)).min() > 1.0  # worlds differ

    @pytest.mark.parametrize("world", range(3))
    def test_a_world_is_the_same_in_any_batch(self, small, world):
        """Up to the rounding of float32, as programs for other shapes may round otherwise."""
        together, alone = run_of(small, n_worlds=3, steps=5), run_of(small, steps=5)
        if world == 0:
            np.testing.assert_array_equal(alone.starts[0].poses, together.starts[0].poses)
        alone = Run(small, Genome(), alone.settings, together.starts[world : world + 1])
        alone._keys = together._keys[world : world + 1]
        for one, many in zip(views(alone), views(together), strict=True):
            np.testing.assert_allclose(one.poses[0], many.poses[world], atol=1e-3)
            np.testing.assert_array_equal(one.state.balls.is_held[0], many.state.balls.is_held[world])

    def test_empty_places_do_not_matter(self, small):
        """Up to the rounding of float32, as programs for other shapes may round otherwise."""
        exact, roomy = (run_of(small, n_worlds=2, steps=20, failed_fraction=0.1, n_places=p) for p in (None, 64))
        for one, other in zip(views(exact), views(roomy), strict=True):
            np.testing.assert_allclose(one.poses, other.poses, atol=1e-3)
            np.testing.assert_array_equal(one.has_priority, other.has_priority)
            jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-3), one.state, other.state)
            jax.tree.map(np.testing.assert_array_equal, one.links, other.links)
        assert exact.measures(1) == roomy.measures(1) and exact.measures(1).picked > 2

    def test_too_few_places(self):
        with pytest.raises(UserError, match=r"n_places must be at least the number of robots.*\(got 29\)"):
            RunSettings(30, 5, n_places=29)

    def test_finished_worlds_stand_still(self, small):
        run = run_of(small, n_worlds=3, steps=300, stop_at=6)
        frozen = {}
        for view in views(run):
            for world, at in enumerate(run.finished_at):
                if world in frozen:
                    poses, balls, collisions, state = frozen[world]
                    jax.tree.map(
                        np.testing.assert_array_equal, jax.tree.map(lambda a, w=world: a[w], view.state), state
                    )
                    np.testing.assert_array_equal(view.poses[world], poses)
                    np.testing.assert_array_equal(view.balls[world], balls)
                    assert view.collisions[world] == collisions and view.speed[world] == 0.0
                elif at is not None:
                    assert at == run.step
                    state = jax.tree.map(lambda a, w=world: a[w], view.state)
                    frozen[world] = view.poses[world], view.balls[world], view.collisions[world], state
        assert len(set(run.finished_at)) > 1 and None not in run.finished_at
        assert run.step == max(run.finished_at)


@pytest.mark.filterwarnings("ignore:invalid value")
class TestFaults:
    @pytest.fixture(autouse=True)
    def elsewhere(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)  # MuJoCo logs to the working directory

    def broken(self, small, value, column):
        """Robots 4 and 7 of world 2 are spoilt after two steps."""
        run = run_of(small, n_worlds=3, steps=5)
        run.advance()
        run.advance()
        run.engine._qpos[2, run.arena.qpos[[4, 7], column]] = value
        return run

    @pytest.mark.parametrize("value, column", [(np.nan, 0), (np.nan, 2), (np.inf, 2), (1e3, 0), (-22.0, 1)])
    def test_are_named_by_step_world_and_robots(self, small, value, column):
        run = self.broken(small, value, column)
        with pytest.raises(SimulationFault, match=r"step 3, world 2: robots 4, 7 "):
            run.advance()

    def test_many_robots_are_not_all_listed(self, small):
        run = self.broken(small, np.nan, 2)
        run.engine._qpos[2, run.arena.qpos[:, 2]] = np.nan
        with pytest.raises(SimulationFault, match=r"robots 0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and more left"):
            run.advance()

    def test_just_outside_is_outside(self, small):
        run, edge = run_of(small, steps=5), 7.5 * RD
        poses = np.zeros((1, N, 3))
        poses[0, 3, :2] = edge - 1e-6, 1e-6 - edge
        run._check(poses)
        poses[0, 3, 1] = 1e-6 + edge
        with pytest.raises(SimulationFault, match=r"world 0: robots 3 "):
            run._check(poses)

    def test_too_many_robots(self, small):
        with pytest.raises(UserError, match=r"n_robots must be between 1 and 216 "):
            run_of(small, n_robots=217)


class TestKindsOfSwarm:
    def test_scouts_alone_carry_nothing(self, small):
        run = run_of(small, Genome(fraction_scouts=1.0), steps=40)
        *_, view = views(run)
        assert view.state.memory.is_scout.all() and np.asarray(view.state.memory.dust.known).any()
        assert run.measures(0)[:2] == (0, 0) and view.speed[0] > 0

    def test_scouts_that_pick_in_a_tiny_arena_by_received_power(self):
        arena = ArenaConfig(size=10, dump_size=2, dust_area_size=2, dust_area_offset=3.5, n_dust=4)
        tiny = SwarmConfig(arena, optics=OpticsConfig(mode="power"), strategy=StrategyConfig(scouts_pick=True))
        run = run_of(tiny, Genome(fraction_scouts=1.0), n_robots=12, steps=150)
        n_links = 0
        for view in views(run):
            check_balls(run, view)
            n_links += view.links.valid.sum()
        assert run.measures(0).picked > 0 and n_links > 100

    def test_the_share_of_scouts(self, small):
        assert run_of(small, Genome(fraction_scouts=0.27)).state.memory.is_scout.sum() == 8

    def test_one_robot_alone(self, small):
        run = run_of(small, n_robots=1, steps=60)
        for view in views(run):
            check_balls(run, view)
            assert not view.links.valid.any() and view.collisions[0] == 0
        assert view.speed[0] > 0

    def test_without_light_all_keep_what_they_know_to_themselves(self, small, monkeypatch):
        """Nobody knows of a dump that he has not stood on."""
        monkeypatch.setattr(rollout.swarm, "find_links", lambda poses, *_: _nobody(poses))
        run = run_of(small, steps=25)
        stood = np.zeros(N, bool)
        for view in views(run):
            stood |= np.asarray(view.state.memory.dump.known)[0] & (np.asarray(view.state.memory.dump.hop)[0] == 0)
            assert not (np.asarray(view.state.memory.dump.hop)).any()
        assert 0 < stood.sum() < N


def _nobody(poses):
    shape = (*poses.shape[:2], 4)
    zero, off = np.zeros(shape, np.float32), np.zeros(shape, bool)
    return swarm.Links(np.zeros(shape, np.int32), off, np.zeros(shape, np.int32), zero, zero)


def test_the_start_is_seen_too(small):
    run = run_of(small)
    view = run.start_view()
    assert view.step == 0 and not view.links.valid.any() and not view.collisions.any()
    np.testing.assert_array_equal(view.poses[0], run.starts[0].poses)
    np.testing.assert_allclose(view.balls[0, :, :2], run.starts[0].balls.position, atol=1e-6)


def test_the_noise_of_two_steps_differs(small):
    run = run_of(small, steps=3)
    run.advance()
    poses = run.engine.poses()
    links, sees_wall = swarm.see(small, run.engine, poses, np.ones(poses.shape[:2], bool))

    def memories(step):
        return swarm.decide_worlds(
            small, tuple(run.arena.probe.tolist()), run._conditions, run._strategy, run.state, poses.astype(np.float32),
            links, sees_wall, step, run._keys, np.ones(1, bool),
        )[0].memory  # fmt: skip

    same = jax.tree.map(lambda a, b: bool((np.asarray(a) == np.asarray(b)).all()), memories(7), memories(7))
    other = jax.tree.map(lambda a, b: bool((np.asarray(a) == np.asarray(b)).all()), memories(7), memories(8))
    assert all(jax.tree.leaves(same))
    assert not all(jax.tree.leaves(other))


def test_overlaps_stay_shallow_in_a_crowd():
    crowd = SwarmConfig(arena=ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=24))
    run = run_of(crowd, n_robots=100, steps=40)
    deepest = 0.0
    for _ in views(run):
        contact = run.engine._batch.get_data(0, run.engine._scratch).contact
        deepest = max(deepest, -contact.dist.min(initial=0.0))
    assert 0.05 < deepest < 0.75  # one step's approach of two robots at full speed is 0.47 mm


def test_the_dead_neither_move_nor_send_nor_carry(small):
    settings = RunSettings(n_robots=40, steps=60, seed=4, failed_fraction=0.5)
    run = Run(small, PRESETS["type1"], settings)
    dead = ~np.asarray(run.state.is_alive[0])
    assert dead.sum() == 20
    heard, before, alone = False, run.engine.poses()[0], 0
    for view in views(run):
        links, after = view.links, view.poses[0]
        apart = np.linalg.norm(before[:, None, :2] - before[None, :, :2], axis=-1) + 99 * np.eye(40)
        out_of_reach = dead & (apart.min(axis=1) > 6)
        alone += out_of_reach.sum()
        np.testing.assert_allclose(after[out_of_reach], before[out_of_reach], atol=1e-6)
        before = after
        assert not dead[links.sender[0][links.valid[0]]].any()
        assert not view.has_priority[0, dead].any()
        assert not dead[np.asarray(view.state.balls.holder[0])[np.asarray(view.state.balls.is_held[0])]].any()
        heard |= links.valid.any()
    assert heard and alone > 20  # the dead move where they are pushed only


def test_nobody_lives_and_nothing_happens(small):
    run = Run(small, PRESETS["type1"], RunSettings(n_robots=20, steps=5, failed_fraction=1.0))
    for _ in views(run):
        pass
    np.testing.assert_allclose(run.engine.poses()[0], run.starts[0].poses, atol=1e-9)


def test_a_share_of_failed_robots_beyond_one_is_refused():
    with pytest.raises(UserError, match=r"failed_fraction must be within 0 to 1 \(got 1\.5\)"):
        RunSettings(n_robots=4, steps=1, failed_fraction=1.5)
