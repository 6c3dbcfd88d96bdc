"""Frames of a recorded world, made from the records of its steps: arena units become SI here."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Shaped

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.output.message_columns import payload_json
from iswarm_mj.output.schema import ARRAYS, FILE_UNITS, Frames, Observed
from iswarm_mj.output.trajectory import AREA, METRIC, Scene
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.strategy.attributes import array_name, parts_of
from iswarm_mj.tasks.base import AreaStyle, Quantity, Task
from iswarm_mj.tasks.grasping import ball_centres
from iswarm_mj.tasks.layout import no_balls
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import MM, ROBOT_DIAMETER

FIXED_AREAS = ("dump", "dust_areas")
"""Areas that do not change during a run: fields of `Scene`, not arrays of the frames."""
BLOCK_FRAMES = 64
"""Number of frames that are made and written together.

Programs are compiled for this number, and Rerun keeps 60 to 160 kB in memory for each block.
"""
NUMPY_NAMES = ("file", "allow_pickle")
"""Names that no array can have, since they are parameters of `numpy.savez` itself."""


class RecordedWorld:
    """A recorded world of a run, or of an environment.

    Attributes:
        config: its configuration.
        scene: its constants.
    """

    def __init__(
        self,
        start: StepRecord,
        index: int,
        config: SwarmConfig,
        task: Task,
        robot: Robots,
        *,
        number: int,
        recorded: Mapping[str, str] | None = None,
        payload: Payload | None = None,
        teams: Mapping[str, int] | None = None,
    ):
        """Initialise from the record of the start.

        Args:
            start: record of the start of W recorded worlds (1, W, ...).
            index: place of this world among the W.
            config: configuration of the world.
            task: task of its robots.
            robot: geometry of its robots.
            number: number of the world in its run.
            recorded: unit of each part of the robots' memory that is recorded, by name.
            payload: fields of the robots' messages.
            teams: number of robots of each team, by name.

        Raises:
            UserError: a recorded part of the memory has the name of another array of trajectories.
        """
        recorded = recorded or {}
        teams = teams or {}
        check_memory_names(recorded)

        self.config = config
        self._index = index
        self._task = task
        self._robot = robot
        self._recorded = recorded
        self._read_task = task_reader(task, config)

        start_of_world = jax.tree.map(lambda values: values[:, index], start)
        scene = self._scene(start_of_world, number, payload or Payload())
        self.scene = scene._replace(team_names=tuple(teams), team_sizes=tuple(teams.values()))

    @classmethod
    def of_run(cls, run: Run, index: int) -> "RecordedWorld":
        """Return one of the recorded worlds of a run at its start.

        Args:
            run: a run that has not taken a step.
            index: place of the world in `run.settings.record_worlds`.

        Raises:
            UserError: a recorded part of the memory has the name of another array of trajectories.
        """
        world = run.worlds[run.settings.record_worlds[index]]
        return cls(
            run.start,
            index,
            world.config or run.config,
            run.task,
            run.robot,
            number=world.index,
            recorded=run.recorded,
            payload=run.payload,
            teams=run.teams,
        )

    def frames(self, records: Sequence[StepRecord]) -> Frames:
        """Return the frames of this world.

        Args:
            records: records of consecutive steps (T, W, ...) of the W recorded worlds.
        """
        world = self._index

        def join(*parts: Any) -> np.ndarray:
            return np.concatenate([part[:, world] for part in parts])

        record = jax.tree.map(join, *records)
        parts = parts_of(record.swarm.memory)
        memory = {
            array_name(name): _in_si(parts[name], unit) for name, unit in self._recorded.items()
        }
        return Frames.from_record(
            self._observed(record), memory=memory, task=self._read_task(record.swarm.task)
        )

    def _scene(self, start: StepRecord, number: int, payload: Payload) -> Scene:
        """Return the constants of the world.

        Args:
            start: record of the start of the world (1, ...).
            number: number of the world in its run.
            payload: fields of the robots' messages.
        """
        arena = self.config.arena
        task_start = jax.tree.map(lambda values: values[0], start.swarm.task)
        rectangles = _fixed_areas(self._task, self.config, task_start)
        areas = _changing_areas(self._task)
        metrics = _added_metrics(self._task)
        parts = parts_of(start.swarm.memory)
        robots = np.arange(start.poses.shape[1])

        # Factors from settings in robot diameters and degrees to SI.
        obstacle_units = np.array([ROBOT_DIAMETER] * 4 + [np.pi / 180])
        box_units = np.array([ROBOT_DIAMETER, ROBOT_DIAMETER, 1, 1])
        box_columns = [2, 3, 5, 6]  # half edges, mass, friction
        boxes = np.array(arena.boxes).reshape(-1, 7)[:, box_columns]

        return Scene(
            robot_size=2 * MM * self._robot.each("half_edges", robots),
            kind=self._robot.kind_of(robots),
            is_scout=_scouts(start),
            ball_radius=np.asarray(self._observed(start).balls.radius[0]),
            arena_size=arena.size * ROBOT_DIAMETER,
            dump=rectangles.get("dump", np.zeros((1, 4)))[0],
            dust_areas=rectangles.get("dust_areas", np.zeros((0, 4))),
            control_period=self.config.drive.control_period,
            is_alive=np.asarray(start.swarm.is_alive[0]),
            payload=payload_json(payload),
            world=number,
            n_leds=len(self._robot.sides),
            memory_names=tuple(map(array_name, self._recorded)),
            memory_units=tuple(_unit_in_files(unit) for unit in self._recorded.values()),
            memory_sizes=tuple(math.prod(np.shape(parts[name])[2:]) for name in self._recorded),
            obstacles=np.array(arena.obstacles).reshape(-1, 5) * obstacle_units,
            boxes=boxes * box_units,
            corners=np.array(arena.corners) * ROBOT_DIAMETER,
            area_names=tuple(areas),
            area_colours=tuple(style.colour for style in areas.values()),
            area_shapes=tuple(style.shape for style in areas.values()),
            metric_names=tuple(metrics),
            metric_units=tuple(quantity.unit for quantity in metrics.values()),
            metric_descriptions=tuple(quantity.description for quantity in metrics.values()),
        )

    def _observed(self, record: StepRecord) -> Observed:
        """Return steps of the world (T, ...) with the balls of its task."""
        balls = self._task.balls(record.swarm.task)
        if balls is None:
            n_steps = len(record.poses)
            balls = jax.tree.map(
                lambda values: np.zeros((n_steps, *values.shape), values.dtype), no_balls()
            )
        centres = np.asarray(ball_centres(balls, record.poses, self._robot))
        return Observed(record, balls, centres)


def check_memory_names(recorded: Mapping[str, str]) -> None:
    """Raise a UserError if a recorded part of the memory takes the name of another array."""
    reserved = {*ARRAYS, *NUMPY_NAMES}
    for name in map(array_name, recorded):
        if name in reserved or name.startswith((AREA, METRIC)):
            reason = (
                f"what is recorded of the memory cannot be called {name}, as trajectories have that"
            )
            raise UserError(f"{reason}; rename it")


def _scouts(start: StepRecord) -> Bool[np.ndarray, "N"]:
    """Return which robots are scouts; none where the strategy has no scouts."""
    n_robots = start.poses.shape[1]
    is_scout = np.asarray(getattr(start.swarm.memory, "is_scout", None))
    if is_scout.shape == start.poses.shape[:2] and is_scout.dtype == bool:
        return is_scout[0]
    return np.zeros(n_robots, bool)


def _unit_in_files(unit: str) -> str:
    """Return the unit that files use in place of a unit of the model."""
    return FILE_UNITS.get(unit, (unit, 1.0))[0]


def _in_si(part: Any, unit: str) -> Shaped[np.ndarray, "T N *shape"]:
    """Return a part of the memory as it is stored: lengths in m, floats in single precision."""
    values = np.asarray(part)
    if unit in FILE_UNITS:
        _, factor = FILE_UNITS[unit]
        return (values * factor).astype(np.float32)
    if np.issubdtype(values.dtype, np.floating):
        return values.astype(np.float32)
    return values


def _changing_areas(task: Task) -> dict[str, AreaStyle]:
    """Return the styles of the areas that may change from step to step, by name."""
    return {name: style for name, style in task.drawn.items() if name not in FIXED_AREAS}


def _added_metrics(task: Task) -> dict[str, Quantity]:
    """Return the metrics that trajectories have in addition to those of `Frames`, by name."""
    return {name: quantity for name, quantity in task.measured.items() if name not in ARRAYS}


def task_reader(task: Task, config: SwarmConfig) -> Callable[[Any], dict[str, np.ndarray]]:
    """Return a function that reads areas [m] and metrics from states of a task.

    It takes the states of the task after T steps, and returns arrays (T, ...) by their names in a
    trajectory.
    """
    areas = _changing_areas(task)
    metrics = _added_metrics(task)
    if not areas and not metrics:
        return lambda state: {}

    @jax.jit
    @jax.vmap
    def read_block(state: Any) -> Any:
        shapes = task.areas(config, state) if areas else {}
        values = task.metrics(state) if metrics else {}
        arrays = {AREA + name: shapes[name] * MM for name in areas}
        return arrays | {METRIC + name: values[name] for name in metrics}

    def read(state: Any) -> dict[str, np.ndarray]:
        n_steps = len(jax.tree.leaves(state)[0])
        n_blocks = math.ceil(n_steps / BLOCK_FRAMES)

        # Repeat the last step up to a full block, since the program is compiled for full blocks.
        steps = np.minimum(np.arange(n_blocks * BLOCK_FRAMES), n_steps - 1)
        blocks = []
        for rows in steps.reshape(n_blocks, BLOCK_FRAMES):
            block = jax.tree.map(lambda values, rows=rows: np.asarray(values)[rows], state)
            blocks.append(read_block(block))
        arrays = {}
        for name in blocks[0]:
            joined = np.concatenate([block[name] for block in blocks])
            arrays[name] = joined[:n_steps]
        return arrays

    return read


def _fixed_areas(
    task: Task, config: SwarmConfig, state: Any
) -> dict[str, Float[np.ndarray, "A 4"]]:
    """Return x_min, y_min, x_max, y_max [m] of the dump and of dust areas, where the task has them.

    Args:
        task: the task.
        config: configuration of the world.
        state: state of the task at the start.
    """
    if not any(name in task.drawn for name in FIXED_AREAS):
        return {}
    squares = task.areas(config, state)
    rectangles = {}
    for name in FIXED_AREAS:
        if name in squares:
            places = np.asarray(squares[name], float) * MM
            centre = places[:, :2]
            half_width = places[:, 2:]
            rectangles[name] = np.hstack([centre - half_width, centre + half_width])
    return rectangles
