"""One control step: driving, collisions, goals, cells, message slots, and quarter turns."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.runs import (
    CountingMemory,
    N,
    Scripted,
    engine_of,
    first_step,
    records,
    run_of,
    scripted,
)
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

STEP = np.sqrt(2)
"""Longest step: half a robot diameter [mm]."""


def test_robots_turn_on_the_spot_then_walk(small):
    """One walks east, one north, and one backwards after a turn to the north-west."""
    start = np.array([[(-8, 0, 0), (0, 0, 0), (8, 0, np.pi / 2)]])
    turn = np.array([[0, np.pi / 2, np.pi / 4]])
    forward = np.array([[STEP, STEP, -1.0]])

    engine = MujocoEngine(small, compile_arena(small, 3, np.zeros(0)), 1, 1, 3)
    bodies = engine.place(start, np.ones((1, 3), bool))
    phases = drive_phases(small.drive, Command(turn, forward))
    motion = engine.move(bodies, phases, np.ones(1, bool))

    diagonal = np.sqrt(0.5)
    east = (-8 + STEP, 0, 0)
    north = (0, STEP, np.pi / 2)
    backwards = (8 + diagonal, -diagonal, 3 * np.pi / 4)
    np.testing.assert_allclose(motion.bodies.poses[0], [east, north, backwards], atol=1e-6)
    assert not motion.touching.any()


def worlds_of(*configs, seed=3):
    """Return one world of the same seed for each configuration."""
    return [World(Genome(), N, seed, config=config) for config in configs]


def test_robots_stop_to_emit_as_often_as_configured(small):
    """They are heard all the same. Worlds of one run may differ in it."""
    stop_shares = [0.0, 0.3, 1.0]
    configs = [
        replace(small, drive=replace(small.drive, stop_share=share)) for share in stop_shares
    ]
    run = run_of(small, Genome(), worlds=worlds_of(*configs), steps=16)

    stands = []
    for record in records(run):
        stands.append((record.command.turn == 0) & (record.command.forward == 0))
        assert record.is_heard.any(axis=(1, 2)).all()
    np.testing.assert_allclose(np.mean(stands, axis=(0, 2)), stop_shares, atol=0.05)


def test_robots_that_sense_neither_dust_nor_dump_pick_nothing_up(small):
    blind = replace(small, strategy=replace(small.strategy, error_in_sensing=1.0))
    run = run_of(small, Genome(), worlds=worlds_of(small, blind), steps=60)
    *_, last = records(run)
    n_picked, n_picked_blind = last.swarm.task.was_picked.sum(axis=-1)
    assert n_picked > 0
    assert n_picked_blind == 0


@jax.tree_util.register_static
@dataclass(frozen=True)
class StraightOn(Still):
    """Robots walk straight on."""

    def act(self, memory, observation, key):
        n_robots = len(memory)
        return memory, Command(jnp.zeros(n_robots), jnp.full(n_robots, STEP))


def test_robots_in_cells_stay_and_collide_in_each_step(small):
    """Two robots face each other in neighbouring cells; a third walks alone, in steps of 2 s."""
    period = 2.0
    drive = replace(small.drive, locations="cells", control_period=period)
    config = replace(small, drive=drive)
    poses = np.array([(0.05 * RD, 0, 0), (0.95 * RD, 0.3, np.pi), (0, 4 * RD, 0)])
    start = start_of(config, 3, 0, 0)._replace(poses=poses)
    world = World(Genome(), 3, 0, start=start)
    run = run_of(config, Genome(), 3, 4, worlds=[world], strategy=StraightOn())

    steps = list(records(run))
    collisions = [int(record.collisions[0]) for record in steps]
    assert collisions == [2, 4, 6, 8]

    last_poses = np.asarray(steps[-1].poses[0])
    np.testing.assert_allclose(last_poses[:2], poses[:2], atol=1e-9)
    assert last_poses[2, 0] > 3 * STEP
    mean_speed = STEP / 3 / period
    np.testing.assert_allclose([record.speed[0] for record in steps], mean_speed, rtol=1e-3)


def test_worlds_that_are_faulty_or_do_not_run_are_not_counted():
    """Worlds 0 and 4 reach the goal in step 7; 2 has a fault, and 3 was finished before."""
    goal = 3
    step = np.int32(6)
    is_running = np.array([True, True, True, False, True])
    fault_bits = np.array([0, 0, 2, 0, 0])
    zeros = np.zeros(5, np.int32)
    no_robots = np.zeros((5, 3), bool)

    # In each world robots 0 and 1 begin to touch, and robot 0 is blocked by another one.
    touching = np.int32([[[0, 0, 1]]] * 5)
    state = WorldState(*[zeros] * len(WorldState._fields))._replace(
        is_finished=~is_running,
        finished_at=np.where(is_running, 0, 4),
        touching=np.zeros_like(touching),
        fault=Fault(zeros, zeros, zeros),
    )
    drive = DriveOutput(
        command=None,
        shortfall=None,
        is_blocked=no_robots | [True, False, False],
        is_refused=no_robots,
        energy=None,
    )
    motion = Motion(None, touching, fault_bits, robot=zeros)
    moved = account_for_motion(state, motion, drive, step, is_running)
    assert moved.collisions.tolist() == [2, 2, 0, 0, 2]
    assert moved.fault.step.tolist() == [0, 0, 7, 0, 0]

    params = WorldParams(*[None] * len(WorldParams._fields))._replace(goal=np.full(5, goal))
    progress = np.array([3, 2, 3, 3, 4])
    after = account_for_task(params, moved, progress, step, is_running)
    assert after.is_finished.tolist() == [True, False, False, True, True]
    assert after.finished_at.tolist() == [7, 0, 0, 4, 7]


def quarter_turn(poses):
    """Return poses x, y and yaw (..., 3) after a turn of the whole world by a quarter."""
    x, y, yaw = np.moveaxis(poses, -1, 0)
    return np.stack([-y, x, yaw + np.pi / 2], axis=-1)


def turned_start(start):
    """Return the same world, turned by a quarter: dust lies to the north and south."""
    x, y = start.task.position.T
    balls = start.task._replace(position=np.column_stack([-y, x]))
    return Start(quarter_turn(start.poses), balls, start.is_alive)


@pytest.mark.parametrize("seed", range(2))
def test_a_world_turned_by_a_quarter_takes_the_same_first_steps(small, seed):
    # Robots off the grid have no two senders at equal distances.
    rng = np.random.default_rng(seed)
    on_grid = place_robots(small.arena, N, rng, cell=1.15)
    off_grid = on_grid + rng.uniform(-0.2, 0.2, (N, 3))
    start = start_of(small, N, seed, 0)._replace(poses=off_grid)
    starts = [start, turned_start(start)]
    worlds = [World(Genome(), N, seed, start=start) for start in starts]

    for record in records(run_of(small, Genome(), worlds=worlds, steps=2)):
        valid, turned_valid = record.links.valid
        sender, turned_sender = record.links.sender
        np.testing.assert_array_equal(valid, turned_valid)
        np.testing.assert_array_equal(sender[valid], turned_sender[turned_valid])

        poses, turned_poses = record.poses
        np.testing.assert_allclose(turned_poses, quarter_turn(poses), atol=2e-4)
        for memory in (record.swarm.memory.dust, record.swarm.memory.dump):
            np.testing.assert_array_equal(memory.known[0], memory.known[1])
            np.testing.assert_allclose(memory.vector[0], memory.vector[1], atol=2e-4)
    assert valid.sum() > 20


def test_held_balls_hang_at_the_tips(small):
    """Robot 1 looks along (3, 4) and holds ball 0; ball 1 lies on the floor."""
    run = run_of(small, Genome(), steps=1)
    poses = np.zeros((1, N, 3))
    poses[0, 1] = (5, 7, np.arctan2(4, 3))

    balls = first_step(run.start).swarm.task
    is_held = balls.is_held.copy()
    is_held[0, 0] = True
    holder = balls.holder.copy()
    holder[0, 0] = 1
    balls = balls._replace(is_held=is_held, holder=holder)

    # The tip is 0.9 mm ahead and 0.1 mm to the left.
    robot = replace(run.robot, probe_tip=(0.9, 0.1), tip_height=0.05)
    held, lying = ball_centres(balls, poses, robot)[0, :2]
    radius = balls.radius[0] * 1e3
    tip = (5 + 0.54 - 0.08, 7 + 0.72 + 0.06, 0.05)
    np.testing.assert_allclose(held, [*tip[:2], tip[2] - radius[0]], atol=1e-6)
    np.testing.assert_allclose(lying, [*balls.position[0, 1], radius[1]], atol=1e-7)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RemembersWalls(Scripted):
    """Remembers which sides saw a wall in the last step, as the digits of a binary number."""

    def act(self, memory, observation, key):
        after, command = self.inner.act(memory.inner, observation, key)
        digits = observation.sees_wall * 2 ** jnp.arange(4)
        return CountingMemory(after, digits.sum(axis=1)), command


def test_sides_that_are_off_receive_nothing_and_see_no_wall(small):
    """While robots emit, which with four slots is all the time, only their fronts are on."""
    n_slots = 4
    message_bits = 32
    baud_rate = 4000
    config = replace(small, optics=OpticsConfig(baud_rate=baud_rate, slots=n_slots))
    paper_strategy = scripted(run_of(config), step=0, robot=0, turn=0, forward=0)
    run = run_of(config, strategy=RemembersWalls(**vars(paper_strategy)), steps=30)

    state = run.arrays()[1]
    light = engine_of(run).sense(state.bodies, state.swarm.is_alive, np.ones(1, bool))
    walls = light.sees_wall[0]
    first, *later = records(run)
    np.testing.assert_array_equal(first.swarm.memory.age[0], walls[:, 0])
    assert walls[:, 0].any()
    assert walls[:, 1:].any()

    n_links = sum(record.links.valid.sum(axis=(0, 1)) for record in later)
    assert n_links[0] > 30
    assert not n_links[1:].any()

    # Steps are shorter by the window of slots; without it robots walk for 0.6 s.
    window = n_slots * message_bits / baud_rate
    longest = max(np.abs(record.command.forward).max() for record in later)
    assert longest == pytest.approx(STEP * (0.6 - window) / 0.6, rel=1e-4)
