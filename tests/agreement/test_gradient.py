"""Derivatives of short rollouts in MJX-JAX, against closed forms and differences. Units: mm, s."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.worlds import start_of

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mjx.arena import compile_mjx_arena
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.geometry.obstacles import poses_of_boxes
from iswarm_mj.simulation.build import build_loop
from iswarm_mj.simulation.decide import decide
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.setup import set_up
from iswarm_mj.simulation.step import Stepper, control_step, drive_phases
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.profiling import Stopwatch
from iswarm_mj.utils.units import RD

SMALL = SwarmConfig(
    arena=ArenaConfig(size=10, dump_size=2, dust_area_size=1, dust_area_offset=3.5, n_dust=2),
)
APART = [[-6, -6, 0.3], [6, -5, 2.0], [-5, 6, -1.0], [5, 5, -2.5]]
CROWD = [[-2, 0, 0.1], [2, 0.4, 3.0], [0.3, 3, -1.5], [-0.4, -3.2, 1.5]]
SLIDING_BOX = (0, -2, 0.5, 0.5, 0, 1e-5, 8e-4)
ROUGH_BOX = (0, 3, 0.5, 0.4, 0, 1e-5, 0.5)
"""Box that stays when a robot pushes it."""
TURNS = np.random.default_rng(0).uniform(-0.3, 0.3, (4, 4))
"""Turns of the robots in four control steps [rad]."""
PARAMETERS = np.array([1.1, 1.5])
"""Distance that a robot walks in a control step [mm], and a factor of the contacts' stiffness."""


def roll_out(arena, poses, parameters):
    """Return poses after four control steps, and the pairs that touched in each."""
    stride, factor = parameters
    solref = arena.model.geom_solref.at[:, 0].multiply(factor)
    engine = MjxEngine(
        replace(arena, model=arena.model.replace(geom_solref=solref)),
        SMALL,
        is_masked=False,
    )

    def step(bodies, turn):
        phases = drive_phases(SMALL.drive, Command(turn, jnp.full_like(turn, stride)))
        motion = engine.move(bodies, phases, jnp.bool_(True))
        return motion.bodies, motion.touching

    start = engine.place(poses, jnp.ones(len(poses), bool))
    bodies, touching = jax.lax.scan(step, start, jnp.asarray(TURNS, poses.dtype))
    return bodies.poses, touching


def distance(arena, poses, parameters):
    """Return the mean square distance from the dump's centre [mm^2], and the pairs that touched."""
    ends, touching = roll_out(arena, poses, parameters)
    return (ends[:, :2] ** 2).sum(axis=-1).mean(), touching


def slope_of(arena, derivative):
    """Return a program for the derivatives of `distance`, its value, and the pairs that touched."""

    def measure(parameters, poses):
        value, touching = distance(arena, poses, parameters)
        return value, (value, touching)

    program = jax.jit(derivative(measure, has_aux=True))

    def slope(poses, parameters):
        derivatives, (value, touching) = program(parameters, poses)
        return np.asarray(derivatives), float(value), np.asarray(touching)

    return slope


@pytest.fixture(scope="module")
def double():
    """Return `slope_of` in double precision, with a solver that stops by rounding."""
    with jax.enable_x64(True):
        arena = compile_mjx_arena(SMALL, len(CROWD), "jax", 1)
        arena = replace(arena, model=arena.model.tree_replace({"opt.tolerance": jnp.asarray(0.0)}))
        slope = slope_of(arena, jax.jacfwd)

    def call(poses, parameters):
        with jax.enable_x64(True):
            return slope(jnp.asarray(poses, float), jnp.asarray(parameters))

    return call


@pytest.mark.slow
def test_without_contacts_it_is_the_closed_form(double):
    slope, _, touching = double(APART, PARAMETERS)
    assert not touching.any()
    poses = np.array(APART)
    yaw = poses[:, 2] + np.cumsum(TURNS, axis=0)
    ahead = np.stack([np.cos(yaw).sum(axis=0), np.sin(yaw).sum(axis=0)], axis=-1)
    ends = poses[:, :2] + PARAMETERS[0] * ahead
    expected = [(2 * ends * ahead).sum(axis=-1).mean(), 0.0]
    # The gain of the servos is rounded to float32.
    np.testing.assert_allclose(slope, expected, rtol=1e-6, atol=1e-12)


@pytest.mark.slow
def test_with_contacts_it_agrees_with_differences(double):
    h = 1e-4
    slope, _, touching = double(CROWD, PARAMETERS)
    assert touching.any(axis=(1, 2)).all()
    differences = []
    for change in h * np.eye(2):
        _, above, touching_above = double(CROWD, PARAMETERS + change)
        _, below, touching_below = double(CROWD, PARAMETERS - change)
        differences.append((above - below) / (2 * h))

        # No contact begins or ends in between.
        np.testing.assert_array_equal(touching_above, touching)
        np.testing.assert_array_equal(touching_below, touching)
    assert min(np.abs(differences)) > 0.01
    np.testing.assert_allclose(slope, differences, rtol=3e-5)


def test_of_a_single_phase():
    """A free robot walks as far as its speed says; one that pushes another yields to it."""
    n_steps = 6
    engine = MjxEngine(compile_mjx_arena(SMALL, 3, "jax", 1), SMALL, is_masked=False)
    poses = jnp.array([[-6.0, -6.0, 0.0], [0.0, 0.0, 0.0], [2.02, 0.0, 0.0]])

    def ends(speed):
        phase = Phase(n_steps, lambda robots: jnp.zeros_like(robots).at[:2, 0].set(speed))
        bodies = engine.place(poses, jnp.ones(3, bool))
        return engine.move(bodies, [phase], jnp.bool_(True)).bodies.poses[:, 0]

    program = jax.jit(lambda speed, change: jax.jvp(ends, (speed,), (change,)))
    _, slopes = program(1.8, 1.0)
    above, _ = program(1.9, 1.0)
    below, _ = program(1.7, 1.0)
    duration = n_steps * SMALL.drive.timestep
    np.testing.assert_allclose(slopes[0], duration, rtol=1e-5)
    assert 0.2 * duration < slopes[2] < slopes[1] < 0.8 * duration
    np.testing.assert_allclose(slopes, (above - below) / 0.2, atol=2e-3)


@pytest.mark.slow
def test_of_boxes_that_are_pushed_it_agrees_with_differences():
    """Friction yields at one of them, which goes with its robot; in single precision."""
    boxes = (SLIDING_BOX, ROUGH_BOX)
    config = replace(SMALL, arena=replace(SMALL.arena, boxes=boxes))
    engine = MjxEngine(compile_mjx_arena(config, 2, "jax", 1), config, is_masked=False)
    box_poses = poses_of_boxes(boxes)
    robot_poses = box_poses - [box_poses[0, 0] + RD / 2 + 0.95, 0, 0]
    poses = jnp.asarray(np.concatenate([robot_poses, box_poses]), jnp.float32)

    def ends(speed):
        phase = Phase(12, lambda robots: jnp.zeros_like(robots).at[:, 0].set(speed))
        bodies = engine.place(poses, jnp.ones(2, bool))
        motion = engine.move(bodies, [phase], jnp.bool_(True))
        box_x = motion.bodies.poses[2:, 0]
        return box_x, box_x

    program = jax.jit(jax.jacfwd(ends, has_aux=True))
    slopes, _ = program(1.8)
    _, above = program(1.9)
    _, below = program(1.7)
    assert slopes[0] > 1
    assert abs(slopes[1]) < 1e-3
    np.testing.assert_allclose(slopes, (above - below) / 0.2, atol=1e-3)


@pytest.mark.slow
def test_in_single_precision_and_in_reverse(double):
    """Single precision, that of all runs, is right to 5 % in a crowd; reverse mode agrees."""
    arena = compile_mjx_arena(SMALL, len(CROWD), "jax", 1)
    forward = slope_of(arena, jax.jacfwd)
    reverse = slope_of(arena, jax.jacrev)
    parameters = jnp.asarray(PARAMETERS, jnp.float32)
    for poses, tolerance in ((APART, 1e-5), (CROWD, 0.05)):
        expected, _, _ = double(poses, PARAMETERS)
        single = jnp.asarray(poses, jnp.float32)
        by_forward, _, _ = forward(single, parameters)
        by_reverse, _, _ = reverse(single, parameters)
        print(expected, by_forward, by_reverse)
        np.testing.assert_allclose(by_forward, expected, rtol=tolerance, atol=1e-5)
        np.testing.assert_allclose(by_reverse, by_forward, rtol=1e-2, atol=1e-5)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Paced(Strategy):
    """The paper's strategy with its walks scaled by `pace`."""

    papers: VectorStrategy
    pace: jax.Array

    def init(self, n_robots, key):
        return self.papers.init(n_robots, key)

    @property
    def payload(self):
        return self.papers.payload

    def say(self, memory, is_loaded):
        return self.papers.say(memory, is_loaded)

    def picks(self, memory):
        return self.papers.picks(memory)

    def act(self, memory, seen, key):
        memory, command = self.papers.act(memory, seen, key)
        return memory, command._replace(forward=self.pace * command.forward)


@pytest.mark.slow
def test_through_whole_control_steps():
    """The mean square displacement, with sight, messages, noise and decisions."""
    n_robots = len(APART)
    n_steps = 3
    rules = rules_of(PRESETS["type1"], SMALL.strategy)
    papers = VectorStrategy(rules, jnp.asarray(0), SMALL.static, read_robot())
    strategy = Paced(papers, jnp.float32(1))
    start = start_of(SMALL, n_robots, 0, 0)._replace(poses=np.array(APART))
    world = World(PRESETS["type1"], n_robots, start=start)
    scenario = Scenario(SMALL, engine=MjxSettings(chunk=1), worlds=[world], steps=n_steps)

    # Parameters, state and engine of the only world.
    setup = set_up(scenario, scenario.settings())
    strategies = jax.tree.map(lambda values: jnp.asarray(values)[None], strategy)
    loop, _ = build_loop(setup, strategies, Stopwatch())
    params, state, engine = loop.on_first_device()
    params, state = jax.tree.map(lambda values: values[0], (params, state))

    def mean_square_displacement(pace):
        paced = params._replace(strategy=replace(params.strategy, pace=pace))
        decide_paced = partial(decide, setup.static, engine.robot, paced)
        stepper = Stepper(engine, setup.static, decide_paced, records=False)

        def step(state, k):
            new_state, _ = control_step(stepper, paced, state, k, jnp.int32(n_steps))
            return new_state, None

        end, _ = jax.lax.scan(step, state, jnp.arange(n_steps))
        displacement = (end.bodies.poses - state.bodies.poses)[:, :2]
        return (displacement**2).sum(axis=-1).mean()

    value = jax.jit(mean_square_displacement)
    slope = jax.jit(jax.jacfwd(mean_square_displacement))
    h = 0.01
    pace = 0.9
    difference = (value(pace + h) - value(pace - h)) / (2 * h)
    assert difference > 0.1
    np.testing.assert_allclose(slope(pace), difference, rtol=1e-3)
