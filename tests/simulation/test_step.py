"""One control step: driving, walls in sight, balls at the tips, and a world turned by a quarter."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.runs import CountingMemory, N, Scripted, engine_of, first_step, records, run_of, scripted
from support.tasks import Still
from support.worlds import start_of

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Motion
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.simulation.actuate import DriveOutput, drive_phases
from iswarm_mj.simulation.layouts import Start
from iswarm_mj.simulation.state import Fault, WorldParams, WorldState
from iswarm_mj.simulation.step import account_for_motion, account_for_task
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.grasping import ball_centres
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.units import RD

STEP = np.sqrt(2)  # half a robot diameter [mm]


def test_robots_turn_on_the_spot_then_walk(small):
    """East, north, and backwards after a turn to the north-west."""
    start = np.array([[(-8, 0, 0), (0, 0, 0), (8, 0, np.pi / 2)]])
    engine = MujocoEngine(small, compile_arena(small, 3, np.zeros(0)), 1, 1, 3)
    command = Command(np.array([[0, np.pi / 2, np.pi / 4]]), np.array([[STEP, STEP, -1.0]]))
    bodies, phases = engine.place(start, np.ones((1, 3), bool)), drive_phases(small.drive, command)
    motion = engine.move(bodies, phases, np.ones(1, bool))
    half = np.sqrt(0.5)
    expected = [(-8 + STEP, 0, 0), (0, STEP, np.pi / 2), (8 + half, -half, 3 * np.pi / 4)]
    np.testing.assert_allclose(motion.bodies.poses[0], expected, atol=1e-6)
    assert not motion.touching.any()


def quarter_turn(start):
    """The same world, turned by a quarter: dust to the north and south."""
    x, y, yaw = start.poses.T
    balls = start.task.position
    turned = np.column_stack([-balls[:, 1], balls[:, 0]])
    return Start(np.column_stack([-y, x, yaw + np.pi / 2]), start.task._replace(position=turned), start.is_alive)


def test_robots_stop_to_emit_as_often_as_configured(small):
    """And are heard all the same; worlds of one run may differ in it."""
    shares = [0.0, 0.3, 1.0]
    often = [replace(small, drive=replace(small.drive, stop_share=share)) for share in shares]
    run = run_of(small, Genome(), worlds=[World(Genome(), N, 3, config=config) for config in often], steps=16)
    stands = []
    for record in records(run):
        stands.append((record.command.turn == 0) & (record.command.forward == 0))
        assert record.is_heard.any(axis=(1, 2)).all()
    np.testing.assert_allclose(np.mean(stands, axis=(0, 2)), shares, atol=0.05)


def test_robots_that_sense_neither_dust_nor_dump_pick_nothing_up(small):
    blind = replace(small, strategy=replace(small.strategy, error_in_sensing=1.0))
    run = run_of(small, Genome(), worlds=[World(Genome(), N, 3, config=c) for c in (small, blind)], steps=60)
    picked = [record.swarm.task.was_picked.sum(axis=-1) for record in records(run)][-1]
    assert picked[0] > 0 and picked[1] == 0


@jax.tree_util.register_static
@dataclass(frozen=True)
class Ahead(Still):
    """Robots walk straight on."""

    def act(self, memory, observation, key):
        return memory, Command(jnp.zeros(len(memory)), jnp.full(len(memory), STEP))


def test_robots_in_cells_stay_and_collide_in_each_step(small):
    """Two face each other a little aside, in neighbouring cells; a third walks alone, in steps of two seconds."""
    config = replace(small, drive=replace(small.drive, locations="cells", control_period=2.0))
    poses = np.array([(0.1 * RD, 0, 0), (0.9 * RD, 0.3, np.pi), (0, 4 * RD, 0)])
    start = start_of(config, 3, 0, 0)._replace(poses=poses)
    run = run_of(config, Genome(), 3, 4, worlds=[World(Genome(), 3, 0, start=start)], strategy=Ahead())
    seen = list(records(run))
    assert [int(record.collisions[0]) for record in seen] == [2, 4, 6, 8]
    ends = np.asarray(seen[-1].poses[0])
    assert np.allclose(ends[:2], poses[:2], atol=1e-9) and ends[2, 0] > 3 * STEP
    np.testing.assert_allclose([record.speed[0] for record in seen], STEP / 3 / 2, rtol=1e-3)


def test_worlds_that_are_faulty_or_do_not_run_are_not_counted():
    """Of five, the first and the last reach their goal; the third has a fault, and the fourth was finished before."""
    is_running, bits, nothing = np.arange(5) != 3, np.array([0, 0, 2, 0, 0]), np.zeros(5, np.int32)
    touching, robots = np.int32([[[0, 0, 1]]] * 5), np.zeros((5, 3), bool)
    state = WorldState(*[nothing] * len(WorldState._fields))._replace(
        is_finished=~is_running,
        finished_at=np.where(is_running, 0, 4),
        touching=0 * touching,
        fault=Fault(nothing, nothing, nothing),
    )
    done = DriveOutput(None, None, robots | [True, False, False], robots, None)
    moved = account_for_motion(state, Motion(None, touching, bits, nothing), done, np.int32(6), is_running)
    assert moved.collisions.tolist() == [2, 2, 0, 0, 2] and moved.fault.step.tolist() == [0, 0, 7, 0, 0]
    params = WorldParams(*[None] * len(WorldParams._fields))._replace(goal=np.full(5, 3))
    after = account_for_task(params, moved, np.array([3, 2, 3, 3, 4]), np.int32(6), is_running)
    assert after.is_finished.tolist() == [True, False, False, True, True]
    assert after.finished_at.tolist() == [7, 0, 0, 4, 7]


@pytest.mark.parametrize("seed", range(2))
def test_a_world_turned_by_a_quarter_takes_the_same_first_steps(small, seed):
    rng = np.random.default_rng(seed)
    off_grid = place_robots(small.arena, N, rng, cell=1.15) + rng.uniform(-0.2, 0.2, (N, 3))  # none at equal distances
    start = start_of(small, N, seed, 0)._replace(poses=off_grid)
    worlds = [World(Genome(), N, seed, start=s) for s in (start, quarter_turn(start))]
    for record in records(run_of(small, Genome(), worlds=worlds, steps=2)):
        valid, sender, (x, y, yaw) = record.links.valid, record.links.sender, record.poses[0].T
        np.testing.assert_array_equal(valid[0], valid[1])
        np.testing.assert_array_equal(sender[0][valid[0]], sender[1][valid[1]])
        np.testing.assert_allclose(record.poses[1], np.stack([-y, x, yaw + np.pi / 2], axis=-1), atol=2e-4)
        for memory in (record.swarm.memory.dust, record.swarm.memory.dump):
            np.testing.assert_array_equal(memory.known[0], memory.known[1])
            np.testing.assert_allclose(memory.vector[0], memory.vector[1], atol=2e-4)
    assert valid.sum() > 40


def test_held_balls_hang_at_the_tips(small):
    """Robot 1 looks along (3, 4) and holds ball 0; ball 1 lies. The tip is 0.9 mm ahead and 0.1 mm to the left."""
    run = run_of(small, Genome(), steps=1)
    poses = np.zeros((1, N, 3))
    poses[0, 1] = (5, 7, np.arctan2(4, 3))
    balls = first_step(run.start).swarm.task
    is_held, holder = balls.is_held.copy(), balls.holder.copy()
    is_held[0, 0], holder[0, 0] = True, 1
    robot = replace(run.robot, probe_tip=(0.9, 0.1), tip_height=0.05)
    centres = ball_centres(balls._replace(is_held=is_held, holder=holder), poses, robot)[0]
    radius = balls.radius[0] * 1e3
    np.testing.assert_allclose(centres[0], [5 + 0.54 - 0.08, 7 + 0.72 + 0.06, 0.05 - radius[0]], atol=1e-6)
    np.testing.assert_allclose(centres[1], [*balls.position[0, 1], radius[1]], atol=1e-7)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Looking(Scripted):
    """Remembers which sides saw a wall in the last step, as the digits of a binary number."""

    def act(self, memory, observation, key):
        after, command = self.inner.act(memory.inner, observation, key)
        return CountingMemory(after, (observation.sees_wall * 2 ** jnp.arange(4)).sum(axis=1)), command


def test_sides_that_are_off_receive_nothing_and_see_no_wall(small):
    """Fronts alone are on while a robot emits, which with four slots is all the time; steps are as much shorter."""
    config = replace(small, optics=OpticsConfig(baud_rate=4000.0, slots=4))
    looking = Looking(**vars(scripted(run_of(config), step=0, robot=0, turn=0, forward=0)))
    run = run_of(config, strategy=looking, steps=30)
    state = run.arrays()[1]
    walls = engine_of(run).sense(state.bodies, state.swarm.is_alive, np.ones(1, bool)).sees_wall[0]
    first, *others = records(run)
    np.testing.assert_array_equal(first.swarm.memory.age[0], walls[:, 0])
    assert walls[:, 0].any() and walls[:, 1:].any()
    n_links = sum(record.links.valid.sum(axis=(0, 1)) for record in others)
    assert n_links[0] > 30 and not n_links[1:].any()
    longest = max(np.abs(record.command.forward).max() for record in others)
    assert longest == pytest.approx(STEP * (0.6 - 4 * 32 / 4000) / 0.6, rel=1e-4)
