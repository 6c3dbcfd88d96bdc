"""What a task is: how worlds begin, what robots sense of it, how it goes on, and how well they do.

A task of your own derives from `Task`, or from one that ships:

    @dataclass(frozen=True)
    class Gather(Task):
        measured: ClassVar = {"inside": Quantity("robots within 5 rd of the middle")}

        def lay_out(self, config, n_robots, rng, shared, cell):
            return place_robots(config.arena, n_robots, rng, cell), np.zeros((), np.int32)

        def advance(self, state, inputs, key):
            away = jnp.hypot(inputs.poses[:, 0], inputs.poses[:, 1])
            inside = (away < mm_from_rd(5.0)) & inputs.is_present
            return inside.sum(dtype=jnp.int32), without_balls(len(away))

        def metrics(self, state):
            return {"inside": state}
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.gripper.attempts import Decider, by_balance
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.arena import Arena
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.strategy.base import overrides
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.arrays import Array


class Quantity(NamedTuple):
    """A number that a task lets robots sense, or that it measures."""

    description: str
    unit: str = ""
    low: float = 0.0
    high: float = float("inf")


class Look(NamedTuple):
    """How areas on the floor are drawn."""

    colour: tuple[int, int, int]
    """Red, green, blue from 0 to 255."""
    shape: Literal["square", "disc"] = "disc"


class TaskInputs(NamedTuple):
    """A world as its task finds it when a control step begins."""

    poses: Float[Array, "N 3"]
    """x, y [mm] and yaw [rad] of the robots."""
    is_present: Bool[Array, "N"]
    """The other places are empty."""
    is_alive: Bool[Array, "N"]
    picks: Bool[Array, "N"]
    """Robots that pick up what their tools reach."""
    team: Int[Array, "N"]
    """Number of the robot's team (`strategy.teams`), from 0; robots without teams are one."""
    kind: Int[Array, "N"]
    """Index of the robot's kind in `robot.kinds`; 0 where all robots are of one kind."""
    conditions: Conditions
    """Noise, voltages and places of this world."""
    arena: Arena
    """Size, dust and balls of this world's arena."""
    config: StaticConfig
    """Settings that all worlds of the run share and that are compiled in: drive, light, gripper, energy."""
    robot: Robots
    """Geometry of the robots; `robot.each("probe_tip", n_robots)` is an attribute of each."""
    decide_attempts: Decider = by_balance
    """Decides whether attempts to pick up and to release balls succeed."""
    voltage: Float[Array, "N"] | None = None
    """Of the robots' capacitors [V]; None: as much as a gripper asks for."""
    releases: Bool[Array, "N"] | None = None
    """Robots that release the ball that they hold wherever they are; None: over the dump alone."""
    command: Command | None = None
    """What the drives carried out in the step; only in `Task.reward`."""
    message: UInt32[Array, "N"] | None = None
    """The 32 bits that each robot sent in the step (`Payload.unpack`); only in `Task.reward`."""
    notices: Bool[Array, "N"] | bool = True
    """Robots that sense the dust and the dump that they are at, see `StrategyConfig.error_in_sensing`."""
    boxes: Float[Array, "M 3"] = np.zeros((0, 3))
    """x, y [mm] and yaw [rad] of the boxes of `ArenaConfig.boxes`."""


class Sensed(NamedTuple):
    """What N robots sense of the task, and what it does to them; with what they hear it makes the `Observation`."""

    at_dust: Bool[Array, "N"]
    """A ball lies beside or beneath the robot."""
    ball_vector: Float[Array, "N 2"]
    """From the robot to that ball, in the robot's frame [mm]."""
    on_dump: Bool[Array, "N"]
    """The robot is on the dump."""
    is_loaded: Bool[Array, "N"]
    """The robot carries something."""
    grasp_failed: Bool[Array, "N"]
    """The robot tried to pick up a ball in this step, and the ball stayed on the floor."""
    is_busy: Bool[Array, "N"]
    """The robot stays where it is in this step, whatever it commands."""
    tool_voltage_squared: Float[Array, "N"]
    """Sum of V^2 over the attempts for which the robot charged its tool in this step [V^2]."""
    own: Mapping[str, Array]
    """Of each of `Task.senses`, an array whose first axis is that of the robots."""


def without_balls(n_robots: int, **own: Array) -> Sensed:
    """Return what robots sense of a task without balls and dump: these quantities alone."""
    no, zero = jnp.zeros(n_robots, bool), jnp.zeros(n_robots)
    return Sensed(no, jnp.zeros((n_robots, 2)), no, no, no, no, zero, own)


class Task(ABC):
    """What N robots of one world are to do.

    A task is a dataclass that derives from this class: its fields are its settings, and flags of `iswarm run --task`.
    Like a strategy it is made a pytree (`strategy.pytrees.as_pytree`), so that numbers are arrays in the methods that
    say "JAX"; these run under `jit` and `vmap`, in every engine. The others are plain Python, called once a world.

    Only `lay_out` and `advance` must be written. A task with balls writes `balls`, too; most such tasks hold a `Balls`
    in their state and hand it to `update_balls` in `advance`.
    """

    senses: ClassVar[Mapping[str, Quantity]] = {}
    """Quantities that robots sense beside balls and dump (`Sensed.own`, `Observation.sensed`)."""
    measured: ClassVar[Mapping[str, Quantity]] = {}
    """Quantities that `metrics` returns."""
    drawn: ClassVar[Mapping[str, Look]] = {}
    """Kinds of areas on the floor that `areas` returns, and how they look."""
    unused: ClassVar[tuple[str, ...]] = ()
    """Settings without effect in the task, as "arena.n_dust", or "gripper" for the whole group; `iswarm run` refuses
    their flags."""
    batch_invariant: ClassVar[bool] = False
    """See `Strategy.batch_invariant`."""

    @abstractmethod
    def lay_out(
        self, config: SwarmConfig, n_robots: int, rng: np.random.Generator, shared: np.random.Generator, cell: float
    ) -> tuple[Float[np.ndarray, "N 3"], Any]:
        """Return poses of the robots (x, y [mm], yaw [rad]) and the state of the task at the start, a pytree of arrays.

        Robots must lie within the walls, outside of obstacles, and may not overlap; see `tasks.layout`.

        Args:
            config: of the world.
            n_robots: N.
            rng: of the world.
            shared: draws what all worlds of a seed have in common; may be `rng`.
            cell: width of the cells on which robots start, so that none touches another [rd].
        """

    @abstractmethod
    def advance(self, state: Any, inputs: TaskInputs, key: Array) -> tuple[Any, Sensed]:
        """Take a control step of all but the robots, and return the state and what robots sense of it; JAX.

        Args:
            state: from the step before.
            inputs: the world as the step begins.
            key: random key of this world and step.
        """

    def goal(self, config: SwarmConfig, n_robots: int) -> int | None:
        """Return the progress with which nothing is left to do; None if there always is.

        Args:
            config: of the run.
            n_robots: N.
        """
        return None

    def progress(self, state: Any) -> Int[Array, ""]:
        """Return how far the robots are, int32; a world is finished at the goal, or at `RunSettings.stop_at`; JAX."""
        return jnp.int32(0)

    def reward(self, before: Any, after: Any, inputs: TaskInputs) -> Float[Array, "N"]:
        """Return the reward of each robot for a control step, for learning; JAX.

        Args:
            before: state of the task before the step.
            after: what `advance` made of it.
            inputs: that `advance` had, with the commands and messages of the step.
        """
        return jnp.zeros(len(inputs.poses))

    def metrics(self, state: Any) -> dict[str, Array]:
        """Return the scalars that `measured` names so far, float32, int32 or bool; JAX."""
        return {}

    def areas(self, config: SwarmConfig, state: Any) -> dict[str, Float[Array, "M 3"]]:
        """Return the areas of each of `drawn`: x, y and half the width, or the radius [mm]; JAX.

        Args:
            config: of the world.
            state: of the task, in any control step.
        """
        return {}

    def conditions(self, state: Any, conditions: Conditions) -> Conditions:
        """Return noise, voltages and the like in a step that begins with this state; JAX.

        Args:
            state: of the task.
            conditions: those of the configuration, which the default keeps.
        """
        return conditions

    def survives(self, state: Any) -> Bool[Array, "N"] | None:
        """Return which robots do not fail in a step that `advance` ends with this state; JAX.

        Robots that failed stay where they are, dark and dumb. None: none ever fails.
        """
        return None

    def lay_boxes(
        self, config: SwarmConfig, rng: np.random.Generator, shared: np.random.Generator
    ) -> Sequence[Sequence[float]] | None:
        """Return the boxes of a world, seven numbers each as in `ArenaConfig.boxes`, whose place they take.

        They lie as those must. Worlds of a run may differ in x, y and yaw alone. `lay_out` finds them in its `config`.
        None: the boxes are those of the configuration.

        Args: as for `lay_out`.
        """
        return None

    def drive_boxes(self, state: Any) -> Float[Array, "M 3"] | None:
        """Return where boxes of mass 0 are to be after a step that `advance` ends with this state; JAX.

        They move there by at most `actuate.MAX_BOX_VELOCITY`, and push robots and other boxes aside; a pose that
        is not finite is a fault of the world. Boxes with a mass stay as robots and friction leave them, whatever their
        rows are. None: the task moves no boxes.

        Returns:
            x, y [mm] and yaw [rad] of all boxes.
        """
        return None

    def balls(self, state: Any) -> Balls | None:
        """Return the K balls, which recordings and pictures show and whose attempts are counted; None if it has none.

        JAX or NumPy, with any leading axes.
        """
        return None

    def fitness(self, measures: Measures, config: SwarmConfig, n_robots: int, steps: int) -> float | None:
        """Return the fitness of a world, which results report with all measures of its balls; None if it has none.

        Args:
            measures: of the world.
            config: of the run.
            n_robots: N.
            steps: of the run at most.
        """
        return None


def has_balls(task: Any) -> bool:
    """Return whether a task has balls."""
    return overrides(task, Task, "balls")


def is_scored(task: Any) -> bool:
    """Return whether a task has balls and a fitness."""
    return has_balls(task) and overrides(task, Task, "fitness")
