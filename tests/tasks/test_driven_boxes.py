"""Tasks that lay boxes at other places in each world, and drive those of mass 0. Units: mm, s."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.boxes import ARENA, placed
from support.mjx import ran

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mjx.arena import compile_mjx_arena
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.geometry.obstacles import numbers, overlap, poses_of_boxes
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.aggregation import Beeclust
from iswarm_mj.tasks.base import Quantity, Task, without_balls
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

N = 12
STEPS = 6
WORLDS = 2
CONFIG = SwarmConfig(ARENA)
SCENARIO = Scenario(CONFIG, strategy=Beeclust(), robots=N, seed=3, worlds=WORLDS, steps=STEPS)


@dataclass(frozen=True)
class Lift(Task):
    """A driven box moves from a random place to a corner, which is farther than a step.

    Another box can be pushed.
    """

    boxes: Any = ()
    measured: ClassVar = {"off": Quantity("distance of the driven box", "mm")}
    senses: ClassVar = {"light": Quantity("none")}

    def lay_boxes(self, config, rng, shared):
        driven = np.array([4, rng.uniform(-4, 4), 0.6, 0.4, rng.uniform(0, 90), 0, 0])
        pushed = (-4, rng.uniform(-4, 4), 0.6, 0.4, 45, 1e-5, 0.01)
        return [driven, pushed]

    def lay_out(self, config, n_robots, rng, shared, cell):
        boxes = poses_of_boxes(config.arena.boxes).astype(np.float32)
        return place_robots(config.arena, n_robots, rng, cell), boxes

    def goal(self, config, n_robots):
        return None

    def advance(self, state, inputs, key):
        return inputs.boxes, without_balls(len(inputs.poses), light=jnp.zeros(len(inputs.poses)))

    def drive_boxes(self, state):
        return jnp.array([[-20.0, -20.0, 9.0], [jnp.nan, 0, jnp.inf]])

    def progress(self, state):
        return jnp.int32(0)

    def reward(self, before, after, inputs):
        return jnp.zeros(len(inputs.poses))

    def metrics(self, state):
        return {"off": jnp.hypot(state[0, 0], state[0, 1])}


def engines(boxes, n_robots):
    """Return the engines by their names."""
    config = SwarmConfig(replace(ARENA, boxes=boxes))
    arena = compile_arena(config, n_robots, np.zeros(0))
    return {
        "mujoco": MujocoEngine(config, arena, 1, 1, n_robots),
        "planar": PlanarEngine(config, arena, 1),
        "mjx": MjxEngine(compile_mjx_arena(config, n_robots, "jax", 1), config, False),
    }


@pytest.mark.parametrize("name", ["mujoco", "planar", pytest.param("mjx", marks=pytest.mark.slow)])
def test_a_driven_box_pushes_and_is_not_pushed(name):
    """It walks 4 mm east through a robot and a box, which drive against it."""
    boxes = ((-3.0, 4.5, 0.5, 1.2, 0.0, 0.0, 0.0), (-1.5, 5.2, 0.4, 0.4, 45.0, 1e-5, 0.001))
    engine = engines(boxes, 2)[name]
    velocity = np.float32([[2.0, 0, 0.0], [9, 9, 9]])
    robots = np.float32([[9.0, -9.0, 0.0], [-3 * RD + 3.0, 4.0 * RD, np.pi]])
    phase = Phase(20, lambda poses: jnp.float32([[0.0, 0, 0], [-2.4, 0, 0]]) + 0 * poses, velocity)
    if name == "mjx":
        start = np.concatenate([robots, np.float32(poses_of_boxes(boxes))])
        present = jnp.ones(2, bool)
        move = jax.jit(
            lambda start: engine.move(engine.place(start, present), [phase], jnp.bool_(True)),
        )
        poses = np.asarray(move(start).bodies.poses)
    else:
        phase_on_host = phase._replace(
            velocity=lambda poses: np.asarray(phase.velocity(poses)),
            boxes=velocity[None],
        )
        bodies = placed(engine, robots[None], boxes)
        poses = engine.move(bodies, [phase_on_host], np.ones(1, bool)).bodies.poses[0]

    driven_box = poses[2]
    pushed_box = poses[3]
    start_of_driven, start_of_pushed = poses_of_boxes(boxes)
    np.testing.assert_allclose(driven_box - start_of_driven, [4.0, 0, 0], atol=0.02)

    # Robot and box were in the way of the driven box, and are ahead of it now.
    edge = driven_box[0] + RD / 2
    assert robots[1, 0] < edge
    assert poses[1, 0] > edge + 0.7
    assert start_of_pushed[0] - 0.56 * RD < edge
    assert pushed_box[0] > edge


def test_a_run():
    """Boxes lie at other places in each world, and the driven one moves as fast as it may.

    The robots are teams.
    """
    teams = Teams({"few": (0.25, Beeclust()), "many": (0.75, Beeclust(2.0))})
    scenario = replace(SCENARIO, strategy=teams, task=Lift(), engine=PlanarSettings(1))
    run = Run(scenario, record_worlds=(0, 1))
    record = ran(run)
    start = run.start.boxes[0]
    assert not run.faults
    assert len(run.config.arena.boxes) == 2
    assert np.abs(start[0] - start[1])[:, 1].min() > 0.1

    # No robot begins in a box, as if all looked along x.
    for world in range(WORLDS):
        boxes = run.starts[world].boxes
        np.testing.assert_allclose(poses_of_boxes(boxes), start[world], atol=1e-5)
        xy = run.start.poses[0, world][:, :2]
        hulls = np.column_stack([xy, np.ones(N), np.zeros((N, 1)), np.ones((N, 2))])
        for box in numbers(boxes, RD):
            assert not overlap(hulls, np.broadcast_to(box, hulls.shape)).any()

    drive = CONFIG.drive
    duration = (drive.turn_substeps + drive.walk_substeps) * drive.timestep
    moved = np.diff(np.concatenate([run.start.boxes, record.boxes]), axis=0)[:2, :, 0]
    expected = np.broadcast_to(duration * np.array([-5, -5, 0.5]), moved.shape)
    np.testing.assert_allclose(moved, expected, atol=0.05)


class Odd(Lift):
    drive_boxes = Task.drive_boxes  # none

    def lay_boxes(self, config, rng, shared):
        return self.boxes


WRONG = {
    "no numbers": (
        Odd("none"),
        r"boxes of Odd.lay_boxes: arena.boxes must be boxes of 7 numbers each",
    ),
    "beyond": (
        Odd(((9, 0, 1, 1, 0, 0, 0),)),
        r"boxes of Odd.lay_boxes: arena.boxes\[0\] must be inside the walls",
    ),
    "mass": (
        Odd(((4, 0, 1, 1, 0, 2, 0.1),)),
        "a mass from 1e-08 to 0.01 kg, or 0 where robots cannot push it",
    ),
}


@pytest.mark.parametrize("task, sentence", WRONG.values(), ids=WRONG)
def test_boxes_that_cannot_be(task, sentence):
    with pytest.raises(UserError, match=sentence):
        Run(replace(SCENARIO, task=task))


class Still(Lift):
    def lay_boxes(self, config, rng, shared):
        return [(4, 0, 0.6, 0.4, 0, 1e-5, 0)]


class Various(Lift):
    def lay_boxes(self, config, rng, shared):
        return [(4, 0, rng.uniform(0.5, 1), 0.4, 0, 0, 0)]


class Fewer(Lift):
    def drive_boxes(self, state):
        return state[:1]


class Broken(Lift):
    def lay_boxes(self, config, rng, shared):
        return [1 / 0]


METHODS = {
    Still: r"Still.drive_boxes moves boxes of mass 0, of which there are none; lay one, or add it",
    Various: "world 1 of Various has other boxes than the first; worlds of a run may differ in x",
    Fewer: r"Fewer.drive_boxes must return .*\[2, ?3\]",
    Broken: r"Broken.lay_boxes .*(division by zero|ZeroDivisionError)",
}


@pytest.mark.parametrize(
    "task, sentence",
    METHODS.items(),
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_mistakes_in_methods_are_refused(task, sentence):
    with pytest.raises(UserError, match=sentence):
        Run(replace(SCENARIO, task=task()))


class Lost(Lift):
    """A task that drives its first box nowhere."""

    def drive_boxes(self, state):
        return state.at[0, 0].set(jnp.nan)


def test_a_box_that_is_driven_nowhere_is_named():
    run = Run(replace(SCENARIO, task=Lost(), engine=PlanarSettings(1), worlds=1))
    run.advance()
    (fault,) = run.faults
    assert (fault.robots, fault.boxes) == ((), (0,))
    assert "the pose of box 0 is not finite" in str(fault)
