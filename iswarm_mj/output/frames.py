"""From records of a run to frames of a trajectory: arena units become SI here."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import jax
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.output.said import IN_FILES, stored
from iswarm_mj.output.task_arrays import Watch, fixed_areas, looks, quantities
from iswarm_mj.output.trajectory import AREA, ARRAYS, METRIC, Frames, Scene
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.strategy.declared import array_name, parts_of
from iswarm_mj.tasks.grasping import ball_centres
from iswarm_mj.tasks.layout import no_balls
from iswarm_mj.tasks.protocol import Task, balls_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import MM, ROBOT_DIAMETER

LYING, HELD, DELIVERED = 0, 1, 2
_FROM_ARENA = {"m": MM, "m/s": MM}
"""Arena units in SI."""


def scene_of(
    config: SwarmConfig,
    robot: Robot,
    start: StepRecord,
    world: int,
    number: int,
    recorded: Mapping[str, str] | None = None,
    payload: Payload | None = None,
    *,
    task: Task,
) -> Scene:
    """What does not change in one world of a run.

    Args:
        config: of the run.
        robot: its geometry.
        start: record of the start (1, W, ...).
        world: which of the W worlds.
        number: of this world in its run.
        recorded: parts of the memory and their units, see `strategy.declared`.
        payload: what messages carry; nothing by default.
        task: of the run.

    Raises:
        UserError: a part has the name of another array of trajectories.
    """
    arena, memory = config.arena, start.swarm.memory
    for name in recorded or {}:
        if array_name(name) in ARRAYS or name.startswith((AREA, METRIC)):
            raise UserError(
                f"what is recorded of the memory cannot be called {name}, as trajectories have that; rename it"
            )

    areas, metrics = looks(task), quantities(task)
    state = jax.tree.map(lambda a: a[0, world], start.swarm.task)
    found = fixed_areas(task, config, state)
    dump, dust = found.get("dump", np.zeros((1, 4)))[0], found.get("dust_areas", np.zeros((0, 4)))
    balls = balls_of(task, state)
    return Scene(
        robot_size=2 * MM * np.array(robot.half_edges),
        is_scout=_scouts(memory, start.poses.shape[:3])[0, world],
        ball_radius=np.zeros(0, np.float32) if balls is None else balls.radius,
        arena_size=arena.size * ROBOT_DIAMETER,
        dump=dump,
        dust_areas=dust,
        control_period=config.drive.control_period,
        is_alive=start.swarm.is_alive[0, world],
        payload=stored(payload or Payload()),
        world=number,
        n_leds=len(robot.leds),
        memory_names=tuple(map(array_name, recorded or {})),
        memory_units=tuple(IN_FILES.get(unit, (unit,))[0] for unit in (recorded or {}).values()),
        memory_sizes=tuple(math.prod(np.shape(parts_of(memory)[name])[3:]) for name in recorded or {}),
        obstacles=np.array(arena.obstacles).reshape(-1, 5) * [*[ROBOT_DIAMETER] * 4, np.pi / 180],
        area_names=tuple(areas),
        area_colours=tuple(look.colour for look in areas.values()),
        area_shapes=tuple(look.shape for look in areas.values()),
        metric_names=tuple(metrics),
        metric_units=tuple(quantity.unit for quantity in metrics.values()),
        metric_descriptions=tuple(quantity.description for quantity in metrics.values()),
    )


def frames_of(
    records: Sequence[StepRecord],
    world: int,
    recorded: Mapping[str, str] | None = None,
    watched: Watch | None = None,
    *,
    task: Task,
    robot: Robot,
) -> Frames:
    """Frames of one world.

    Args:
        records: of consecutive steps (T, W, ...).
        world: which of the W worlds.
        recorded: as for `scene_of`.
        watched: what the task adds, see `task_arrays.watch`.
        task: of the run.
        robot: its geometry.
    """
    record: StepRecord = jax.tree.map(lambda *parts: np.concatenate([part[:, world] for part in parts]), *records)
    balls = balls_of(task, record.swarm.task)
    if balls is None:
        balls = jax.tree.map(lambda a: np.zeros((len(record.poses), *a.shape), a.dtype), no_balls())
    values = {
        "step": record.step,
        "is_running": record.is_running,
        "pose": record.poses.astype(np.float32),
        "is_loaded": record.swarm.is_loaded,
        "has_priority": record.has_priority,
        "message": record.message,
        "command": np.stack([record.command.turn, record.command.forward], axis=-1),
        "ball_position": ball_centres(balls, record.poses, robot).astype(np.float32),
        "ball_state": np.where(balls.is_held, HELD, np.where(balls.is_delivered, DELIVERED, LYING)),
        "ball_holder": balls.holder,
        "link_sender": record.links.sender,
        "link_valid": record.links.valid,
        "link_led": record.links.led,
        "link_bearing": record.links.bearing,
        "link_distance": record.measured_distance,
        "link_heard": record.is_heard,
        "delivered": balls.is_delivered.sum(axis=1),
        "picked": balls.was_picked.sum(axis=1),
        "collisions": record.collisions,
        "mean_speed": record.speed,
    }
    memory = {
        array_name(name): _stored(np.asarray(parts_of(record.swarm.memory)[name]), unit)
        for name, unit in (recorded or {}).items()
    }
    own = {f.name: _in_si(values[f.name], **f.metadata) for f in fields(Frames) if f.name in ARRAYS}
    return Frames(**own, memory=memory, task={} if watched is None else watched(record.swarm.task))


def _scouts(memory: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Which robots are scouts, if the strategy knows such."""
    found = getattr(memory, "is_scout", None)
    is_flag = found is not None and np.shape(found) == shape and np.asarray(found).dtype == bool
    return np.asarray(found) if is_flag else np.zeros(shape, bool)


def _stored(values: np.ndarray, unit: str) -> np.ndarray:
    """A part of the memory as it is stored: lengths in m, floats in single precision."""
    if unit in IN_FILES:
        return (values * IN_FILES[unit][1]).astype(np.float32)
    return values.astype(np.float32) if np.issubdtype(values.dtype, np.floating) else values


def _in_si(values: np.ndarray, dtype: type, units: tuple[str, ...]) -> np.ndarray:
    """Values in SI, from arena units; `units` are those of the last axis, or one for all, or none."""
    scale = np.array([_FROM_ARENA.get(unit, 1.0) for unit in units], values.dtype)
    return (values * scale).astype(dtype) if units else values.astype(dtype)
