"""From steps of a run to frames of a trajectory: the door from arena units to SI."""

from dataclasses import fields
from typing import Any

import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.output.trajectory import Frames, Scene
from iswarm_mj.simulation.run_mujoco import StepView
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import MM, ROBOT_DIAMETER

LYING, HELD, DELIVERED = 0, 1, 2
_FROM_ARENA = {"m": MM, "m/s": MM}
"""Arena units in SI."""


def scene_of(config: SwarmConfig, robot: Robot, start: StepView, world: int) -> Scene:
    """What does not change in one world of a run."""
    arena = config.arena

    def square(x: float, edge: float) -> list[float]:
        return [x - edge / 2, -edge / 2, x + edge / 2, edge / 2]

    dust = [square(side * arena.dust_area_offset, arena.dust_area_size) for side in (-1, 1)]
    return Scene(
        robot_size=2 * MM * np.array(robot.half_edges),
        is_scout=np.asarray(start.state.memory.is_scout[world]),
        ball_radius=np.asarray(start.state.balls.radius[world]),
        arena_size=arena.size * ROBOT_DIAMETER,
        dump=np.array(square(0.0, arena.dump_size)) * ROBOT_DIAMETER,
        dust_areas=np.array(dust) * ROBOT_DIAMETER,
        control_period=config.drive.control_period,
    )


class FrameBuffer:
    """Collects the steps of one world and hands them out as blocks of frames."""

    def __init__(self, world: int):
        self._world = world
        self._views: list[dict[str, Any]] = []

    def __len__(self) -> int:
        """Return the number of frames that wait."""
        return len(self._views)

    def add(self, view: StepView) -> None:
        """Take in a step."""
        self._views.append(_frame(view, self._world))

    def take(self) -> Frames:
        """Hand out what was taken in since the last time; there must be something."""
        views, self._views = self._views, []
        block = {f.name: _in_si(np.stack([v[f.name] for v in views]), **f.metadata) for f in fields(Frames)}
        return Frames(**block)


def _in_si(values: np.ndarray, dtype: type, units: tuple[str, ...]) -> np.ndarray:
    """Values in SI, from arena units; `units` are those of the last axis, or one for all, or none."""
    scale = np.array([_FROM_ARENA.get(unit, 1.0) for unit in units], values.dtype)
    return (values * scale).astype(dtype) if units else values.astype(dtype)


def _frame(view: StepView, world: int) -> dict[str, Any]:
    """One world's step, in arena units; `take` converts whole blocks."""
    memory, balls = view.state.memory, view.state.balls
    held, delivered = np.asarray(balls.is_held)[world], np.asarray(balls.is_delivered)[world]
    is_loaded = np.zeros(view.poses.shape[1], bool)
    is_loaded[np.asarray(balls.holder)[world][held]] = True
    return {
        "step": np.asarray(view.step),
        "pose": view.poses[world].astype(np.float32),
        "is_loaded": is_loaded,
        "has_priority": view.has_priority[world],
        "ball_position": view.balls[world].astype(np.float32),
        "ball_state": np.where(held, HELD, np.where(delivered, DELIVERED, LYING)).astype(np.uint8),
        "link_sender": view.links.sender[world],
        "link_valid": view.links.valid[world],
        "dust_vector": np.asarray(memory.dust.vector)[world],
        "dust_known": np.asarray(memory.dust.known)[world],
        "dump_vector": np.asarray(memory.dump.vector)[world],
        "dump_known": np.asarray(memory.dump.known)[world],
        "delivered": np.int32(delivered.sum()),
        "picked": np.int32(np.asarray(balls.was_picked)[world].sum()),
        "collisions": np.int32(view.collisions[world]),
        "mean_speed": view.speed[world],
    }
