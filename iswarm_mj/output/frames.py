"""From records of a run to frames of a trajectory, and what its task adds: arena units become SI here."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float, Shaped

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.output.message_columns import stored
from iswarm_mj.output.schema import ARRAYS, IN_FILES, Frames, Observed
from iswarm_mj.output.trajectory import AREA, METRIC, Scene
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.strategy.declared import array_name, parts_of
from iswarm_mj.tasks.base import Look, Quantity, Task
from iswarm_mj.tasks.grasping import ball_centres
from iswarm_mj.tasks.layout import no_balls
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import MM, ROBOT_DIAMETER

FIXED = ("dump", "dust_areas")
"""Areas that stay where they are: arrays of `Scene`."""
BLOCK = 64
"""Frames that are made and written at a time: programs are compiled for as many, and for each block Rerun keeps some 60
to 160 kB in memory."""


class RecordedWorld:
    """A recorded world of a run, or of an environment.

    Attributes:
        config: its configuration.
        scene: what does not change in it.
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
        """Take in how it starts.

        Args:
            start: of the W recorded worlds (1, W, ...).
            index: which of them.
            config: its configuration.
            task: of its robots.
            robot: their geometry.
            number: of the world in its run.
            recorded: unit of each recorded part of the memory.
            payload: what messages carry.
            teams: number of robots of each.

        Raises:
            UserError: a part of the memory that is recorded has the name of another array of trajectories.
        """
        recorded, teams = recorded or {}, teams or {}
        for name in map(array_name, recorded):
            if name in (*ARRAYS, "file", "allow_pickle") or name.startswith((AREA, METRIC)):  # NumPy has two itself
                raise UserError(
                    f"what is recorded of the memory cannot be called {name}, as trajectories have that; rename it"
                )
        self.config, self._index = config, index
        self._task, self._robot, self._recorded = task, robot, recorded
        self._watch = _watch(task, config)
        scene = self._scene(jax.tree.map(lambda a: a[:, index], start), number, payload or Payload())
        self.scene = scene._replace(team_names=tuple(teams), team_sizes=tuple(teams.values()))

    @classmethod
    def of(cls, run: Run, index: int) -> "RecordedWorld":
        """Return one of the recorded worlds of a run at its start.

        Raises:
            UserError: see above.
        """
        world = run.worlds[run.settings.record_worlds[index]]
        about = {"number": world.index, "recorded": run.recorded, "payload": run.payload, "teams": run.teams}
        return cls(run.start, index, world.config or run.config, run.task, run.robot, **about)

    def frames(self, records: Sequence[StepRecord]) -> Frames:
        """Return its frames, of records of consecutive steps (T, W, ...) of the W recorded worlds."""
        world = self._index
        record = jax.tree.map(lambda *parts: np.concatenate([part[:, world] for part in parts]), *records)
        seen = self._observed(record)
        parts = parts_of(record.swarm.memory)
        memory = {array_name(name): _in_si(parts[name], unit) for name, unit in self._recorded.items()}
        return Frames.observed(seen, memory, self._watch(record.swarm.task))

    def _scene(self, own: StepRecord, number: int, payload: Payload) -> Scene:
        """Constants of the world of this number, from the record of its start (1, ...)."""
        config, task, recorded = self.config, self._task, self._recorded
        rectangles = _fixed_areas(task, config, jax.tree.map(lambda a: a[0], own.swarm.task))
        areas, metrics = _looks(task), _quantities(task)
        numbers = np.arange(own.poses.shape[1])
        return Scene(
            robot_size=2 * MM * self._robot.each("half_edges", numbers),
            kind=self._robot.kind_of(numbers),
            is_scout=_scouts(own),
            ball_radius=np.asarray(self._observed(own).balls.radius[0]),
            arena_size=config.arena.size * ROBOT_DIAMETER,
            dump=rectangles.get("dump", np.zeros((1, 4)))[0],
            dust_areas=rectangles.get("dust_areas", np.zeros((0, 4))),
            control_period=config.drive.control_period,
            is_alive=np.asarray(own.swarm.is_alive[0]),
            payload=stored(payload),
            world=number,
            n_leds=len(self._robot.sides),
            memory_names=tuple(map(array_name, recorded)),
            memory_units=tuple(IN_FILES.get(unit, (unit,))[0] for unit in recorded.values()),
            memory_sizes=tuple(math.prod(np.shape(parts_of(own.swarm.memory)[name])[2:]) for name in recorded),
            obstacles=np.array(config.arena.obstacles).reshape(-1, 5) * [*[ROBOT_DIAMETER] * 4, np.pi / 180],
            boxes=np.array(config.arena.boxes).reshape(-1, 7)[:, [2, 3, 5, 6]] * [*[ROBOT_DIAMETER] * 2, 1, 1],
            corners=np.array(config.arena.corners) * ROBOT_DIAMETER,
            area_names=tuple(areas),
            area_colours=tuple(look.colour for look in areas.values()),
            area_shapes=tuple(look.shape for look in areas.values()),
            metric_names=tuple(metrics),
            metric_units=tuple(quantity.unit for quantity in metrics.values()),
            metric_descriptions=tuple(quantity.description for quantity in metrics.values()),
        )

    def _observed(self, record: StepRecord) -> Observed:
        """Its steps (T, ...), with what the task offers of them."""
        balls = self._task.balls(record.swarm.task)
        if balls is None:
            balls = jax.tree.map(lambda a: np.zeros((len(record.poses), *a.shape), a.dtype), no_balls())
        return Observed(record, balls, np.asarray(ball_centres(balls, record.poses, self._robot)))


def _scouts(start: StepRecord) -> Bool[np.ndarray, "N"]:
    """Which robots are scouts, if the strategy knows such."""
    found, shape = np.asarray(getattr(start.swarm.memory, "is_scout", None)), start.poses.shape[:2]
    return found[0] if found.shape == shape and found.dtype == bool else np.zeros(shape[1], bool)


def _in_si(part: Any, unit: str) -> Shaped[np.ndarray, "T N *shape"]:
    """A part of the memory as it is stored: lengths in m, floats in single precision."""
    values, (_, factor) = np.asarray(part), IN_FILES.get(unit, (unit, 1.0))
    is_float = unit in IN_FILES or np.issubdtype(values.dtype, np.floating)
    return (values * factor if unit in IN_FILES else values).astype(np.float32 if is_float else values.dtype)


def _looks(task: Task) -> dict[str, Look]:
    """Return how areas are drawn that may change from step to step."""
    return {name: look for name, look in task.drawn.items() if name not in FIXED}


def _quantities(task: Task) -> dict[str, Quantity]:
    """Return metrics that trajectories have beside those of `Frames`."""
    return {name: quantity for name, quantity in task.measured.items() if name not in ARRAYS}


def _watch(task: Task, config: SwarmConfig) -> Callable[[Any], dict[str, np.ndarray]]:
    """Return what reads areas [m] and metrics of a task in worlds of this configuration.

    It takes the states of the task after T steps, and returns arrays (T, ...) by their names in a trajectory.
    """
    areas, metrics = _looks(task), _quantities(task)
    if not areas and not metrics:
        return lambda state: {}

    @jax.jit
    @jax.vmap
    def read(state: Any) -> Any:
        shapes = task.areas(config, state) if areas else {}
        numbers = task.metrics(state) if metrics else {}
        return {AREA + name: shapes[name] * MM for name in areas} | {METRIC + name: numbers[name] for name in metrics}

    def of_steps(state: Any) -> dict[str, np.ndarray]:
        n_steps = len(jax.tree.leaves(state)[0])
        rows = np.minimum(np.arange(-(-n_steps // BLOCK) * BLOCK), n_steps - 1).reshape(-1, BLOCK)
        parts = [read(jax.tree.map(lambda a, block=block: np.asarray(a)[block], state)) for block in rows]
        return {name: np.concatenate([part[name] for part in parts])[:n_steps] for name in parts[0]}

    return of_steps


def _fixed_areas(task: Task, config: SwarmConfig, state: Any) -> dict[str, Float[np.ndarray, "A 4"]]:
    """Return rectangles x_min, y_min, x_max, y_max [m] of the dump and of dust areas, as far as the task has them."""
    if not any(name in task.drawn for name in FIXED):
        return {}
    found = task.areas(config, state)
    shapes = {name: np.asarray(found[name], float) * MM for name in FIXED if name in found}
    return {name: np.hstack([a[:, :2] - a[:, 2:], a[:, :2] + a[:, 2:]]) for name, a in shapes.items()}
