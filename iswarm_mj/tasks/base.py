"""The base class of tasks: how worlds start and go on, what robots sense, and how well they do.

A task of your own derives from `Task`, or from one that ships:

    @dataclass(frozen=True)
    class Gather(Task):
        measured: ClassVar = {"inside": Quantity("robots within 5 rd of the middle")}

        def lay_out(self, config, n_robots, rng, shared, cell):
            return place_robots(config.arena, n_robots, rng, cell), np.zeros((), np.int32)

        def advance(self, state, inputs, key):
            x, y, _ = inputs.poses.T
            is_inside = (jnp.hypot(x, y) < mm_from_rd(5.0)) & inputs.is_present
            n_inside = is_inside.sum(dtype=jnp.int32)
            return n_inside, without_balls(n_robots=len(x))

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
    """Smallest value, for observations that learning algorithms scale."""
    high: float = float("inf")
    """Largest value."""


class AreaStyle(NamedTuple):
    """Colour and shape in which areas on the floor are drawn."""

    colour: tuple[int, int, int]
    """Red, green and blue, from 0 to 255."""
    shape: Literal["square", "disc"] = "disc"


class TaskInputs(NamedTuple):
    """State of a world at the start of a control step, as its task sees it."""

    poses: Float[Array, "N 3"]
    """x, y [mm] and yaw [rad] of the robots."""
    is_present: Bool[Array, "N"]
    """Places with a robot; the others are empty."""
    is_alive: Bool[Array, "N"]
    """Robots that have not failed."""
    picks: Bool[Array, "N"]
    """Robots that pick up balls within reach of their tools."""
    team: Int[Array, "N"]
    """Number of the robot's team (`strategy.teams`), from 0; robots without teams are one team."""
    kind: Int[Array, "N"]
    """Index of the robot's kind in `robot.kinds`; 0 where all robots are of one kind."""
    conditions: Conditions
    """Noise, voltages and places of this world."""
    arena: Arena
    """Size, dust and balls of this world's arena."""
    config: StaticConfig
    """Settings that all worlds of a run share, compiled in: drive, light, gripper, energy."""
    robot: Robots
    """Geometry of the robots; `robot.each("probe_tip", n_robots)` returns an attribute of each."""
    decide_attempts: Decider = by_balance
    """Function that decides which attempts to pick up and release balls succeed."""
    voltage: Float[Array, "N"] | None = None
    """Voltage of each robot's capacitor [V]; None: as much as a gripper asks for."""
    releases: Bool[Array, "N"] | None = None
    """Robots that release their ball wherever they are; None: only over the dump."""
    command: Command | None = None
    """Commands that the drives carried out in the step; only in `Task.reward`."""
    message: UInt32[Array, "N"] | None = None
    """Bits that each robot sent in the step (`Payload.unpack`); only in `Task.reward`."""
    notices: Bool[Array, "N"] | bool = True
    """Robots that notice the dust or dump they are at (`StrategyConfig.error_in_sensing`)."""
    boxes: Float[Array, "M 3"] = np.zeros((0, 3))
    """x, y [mm] and yaw [rad] of the boxes of `ArenaConfig.boxes`."""


class Sensed(NamedTuple):
    """Quantities of the task that N robots sense, and its effects on them.

    With what the robots hear it becomes their `Observation`.
    """

    at_dust: Bool[Array, "N"]
    """A ball lies beside or beneath the robot."""
    ball_vector: Float[Array, "N 2"]
    """Vector from the robot to that ball, in the robot's frame [mm]."""
    on_dump: Bool[Array, "N"]
    """The robot is on the dump."""
    is_loaded: Bool[Array, "N"]
    """The robot carries something."""
    grasp_failed: Bool[Array, "N"]
    """The robot tried to pick up a ball in this step, and the ball stayed on the floor."""
    is_busy: Bool[Array, "N"]
    """The robot stays where it is in this step, whatever it commands."""
    tool_voltage_squared: Float[Array, "N"]
    """Sum of squared voltages over the robot's attempts in this step, for its energy [V^2]."""
    own: Mapping[str, Array]
    """Arrays (N, ...) of the quantities in `Task.senses`, by name."""


def without_balls(n_robots: int, **own: Array) -> Sensed:
    """Return what robots sense in a task without balls and dump.

    Args:
        n_robots: N.
        own: arrays (N, ...) of the quantities in `Task.senses`, by name.
    """
    nobody = jnp.zeros(n_robots, bool)
    return Sensed(
        at_dust=nobody,
        ball_vector=jnp.zeros((n_robots, 2)),
        on_dump=nobody,
        is_loaded=nobody,
        grasp_failed=nobody,
        is_busy=nobody,
        tool_voltage_squared=jnp.zeros(n_robots),
        own=own,
    )


class Task(ABC):
    """Task of the N robots of one world.

    A task is a dataclass that derives from this class. Its fields are its settings, and become
    flags of `iswarm run --task`.

    Methods marked "JAX" run under `jit` and `vmap`, in every engine. For these a task becomes a
    pytree like a strategy (`strategy.pytrees.as_pytree`), whose numbers are arrays. The other
    methods are plain Python, called once for each world.

    A task must define `lay_out` and `advance`. One with balls also defines `balls`; most such tasks
    keep `Balls` in their state and pass them to `update_balls` in `advance`.
    """

    senses: ClassVar[Mapping[str, Quantity]] = {}
    """Quantities that robots sense besides balls and dump (`Sensed.own`, `Observation.sensed`)."""
    measured: ClassVar[Mapping[str, Quantity]] = {}
    """Quantities that `metrics` returns."""
    drawn: ClassVar[Mapping[str, AreaStyle]] = {}
    """Kinds of areas on the floor that `areas` returns, with their colours and shapes."""
    unused: ClassVar[tuple[str, ...]] = ()
    """Settings without effect in the task, as "arena.n_dust", or "gripper" for the whole group.

    `iswarm run` rejects their flags."""
    batch_invariant: ClassVar[bool] = False
    """Compiled, it rounds alike for one world and several, see `Strategy.batch_invariant`."""

    @abstractmethod
    def lay_out(
        self,
        config: SwarmConfig,
        n_robots: int,
        rng: np.random.Generator,
        shared: np.random.Generator,
        cell: float,
    ) -> tuple[Float[np.ndarray, "N 3"], Any]:
        """Return the initial poses of the robots and the initial state of the task.

        Robots must lie within the walls, outside of obstacles, and must not overlap; functions of
        `tasks.layout` see to that.

        Args:
            config: configuration of the world.
            n_robots: N.
            rng: generator of the world's random numbers.
            shared: generator of random numbers that all worlds of a seed share; may be `rng`.
            cell: width of the cells on which robots start without touching each other [rd].

        Returns:
            Poses (x, y [mm], yaw [rad]), and the state, a pytree of arrays.
        """

    @abstractmethod
    def advance(self, state: Any, inputs: TaskInputs, key: Array) -> tuple[Any, Sensed]:
        """Return the next state of everything but the robots, and what robots sense of it; JAX.

        Args:
            state: state after the previous step.
            inputs: the world as the step begins.
            key: random key of this world and step.
        """

    def goal(self, config: SwarmConfig, n_robots: int) -> int | None:
        """Return the progress at which a world is finished; None if it never is.

        Args:
            config: configuration of the run.
            n_robots: N.
        """
        return None

    def progress(self, state: Any) -> Int[Array, ""]:
        """Return the progress so far, int32; JAX.

        A world is finished at the goal, or at `RunSettings.stop_at`.
        """
        return jnp.int32(0)

    def reward(self, before: Any, after: Any, inputs: TaskInputs) -> Float[Array, "N"]:
        """Return the reward of each robot for a control step, for learning; JAX.

        Args:
            before: state before the step.
            after: state that `advance` returned.
            inputs: inputs of `advance`, with the commands and messages of the step.
        """
        return jnp.zeros(len(inputs.poses))

    def metrics(self, state: Any) -> dict[str, Array]:
        """Return the quantities in `measured` so far: scalars, float32, int32 or bool; JAX."""
        return {}

    def areas(self, config: SwarmConfig, state: Any) -> dict[str, Float[Array, "M 3"]]:
        """Return the areas of each kind in `drawn`: x, y, and half width or radius [mm]; JAX.

        Args:
            config: configuration of the world.
            state: state in any control step.
        """
        return {}

    def conditions(self, state: Any, conditions: Conditions) -> Conditions:
        """Return noise, voltages and the like for a step that begins with this state; JAX.

        Args:
            state: state of the task.
            conditions: conditions of the configuration, which the default returns.
        """
        return conditions

    def survives(self, state: Any) -> Bool[Array, "N"] | None:
        """Return which robots still work after a step that `advance` ends with this state; JAX.

        A robot that has failed stays where it is, dark and silent. None: none ever fails.
        """
        return None

    def lay_boxes(
        self, config: SwarmConfig, rng: np.random.Generator, shared: np.random.Generator
    ) -> Sequence[Sequence[float]] | None:
        """Return the boxes of a world, in place of `ArenaConfig.boxes` and with its seven numbers.

        The same rules hold for where they lie. Worlds of a run may differ only in x, y and yaw.
        `lay_out` finds the boxes in its `config`. None: those of the configuration stay.

        Args:
            config: configuration of the world.
            rng: generator of the world's random numbers.
            shared: generator of random numbers that all worlds of a seed share; may be `rng`.
        """
        return None

    def drive_boxes(self, state: Any) -> Float[Array, "M 3"] | None:
        """Return where boxes of mass 0 move in a step that `advance` ends with this state; JAX.

        They move at most as fast as `actuate.MAX_BOX_VELOCITY`, and push robots and other boxes
        aside. Rows of boxes with a mass are ignored. A pose that is not finite is a fault of the
        world. None: the task moves no boxes.

        Returns:
            x, y [mm] and yaw [rad] of all boxes.
        """
        return None

    def balls(self, state: Any) -> Balls | None:
        """Return the K balls of the task, for recordings and statistics; None if it has none.

        The state may be of JAX or NumPy arrays, with any leading axes.
        """
        return None

    def fitness(
        self,
        measures: Measures,
        config: SwarmConfig,
        n_robots: int,
        steps: int,
    ) -> float | None:
        """Return the fitness of a world, which results report; None if the task defines none.

        Args:
            measures: measures of the world.
            config: configuration of the run.
            n_robots: N.
            steps: largest number of control steps of the run.
        """
        return None


def has_balls(task: Any) -> bool:
    """Return whether a task has balls."""
    return overrides(task, Task, "balls")


def is_scored(task: Any) -> bool:
    """Return whether a task has balls and a fitness."""
    return has_balls(task) and overrides(task, Task, "fitness")
