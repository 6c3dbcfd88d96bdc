"""From records of a run to frames of a trajectory: arena units become SI here."""

from collections.abc import Sequence
from dataclasses import fields

import jax
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.output.trajectory import Frames, Scene
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import MM, ROBOT_DIAMETER

LYING, HELD, DELIVERED = 0, 1, 2
_FROM_ARENA = {"m": MM, "m/s": MM}
"""Arena units in SI."""


def scene_of(config: SwarmConfig, robot: Robot, start: StepRecord, world: int, number: int) -> Scene:
    """What does not change in one world of a run.

    Args:
        config: of the run.
        robot: its geometry.
        start: record of the start (1, W, ...).
        world: which of the W worlds.
        number: of this world in its run.
    """
    arena = config.arena

    def square(x: float, edge: float) -> list[float]:
        return [x - edge / 2, -edge / 2, x + edge / 2, edge / 2]

    dust = [square(side * arena.dust_area_offset, arena.dust_area_size) for side in (-1, 1)]
    return Scene(
        robot_size=2 * MM * np.array(robot.half_edges),
        is_scout=start.swarm.memory.is_scout[0, world],
        ball_radius=start.swarm.balls.radius[0, world],
        arena_size=arena.size * ROBOT_DIAMETER,
        dump=np.array(square(0.0, arena.dump_size)) * ROBOT_DIAMETER,
        dust_areas=np.array(dust) * ROBOT_DIAMETER,
        control_period=config.drive.control_period,
        is_alive=start.swarm.is_alive[0, world],
        message_range=config.strategy.message_range * ROBOT_DIAMETER,
        world=number,
        n_leds=len(robot.leds),
    )


def frames_of(records: Sequence[StepRecord], world: int) -> Frames:
    """Frames of one world.

    Args:
        records: of consecutive steps (T, W, ...).
        world: which of the W worlds.
    """
    record: StepRecord = jax.tree.map(lambda *parts: np.concatenate([part[:, world] for part in parts]), *records)
    memory, balls = record.swarm.memory, record.swarm.balls
    n_steps, n_robots = record.poses.shape[:2]
    is_loaded = np.zeros((n_steps, n_robots), bool)
    step, ball = np.nonzero(balls.is_held)
    is_loaded[step, balls.holder[step, ball]] = True
    values = {
        "step": record.step,
        "is_running": record.is_running,
        "pose": record.poses.astype(np.float32),
        "is_loaded": is_loaded,
        "has_priority": record.has_priority,
        "message": record.message,
        "command": np.stack([record.command.turn, record.command.forward], axis=-1),
        "ball_position": record.balls.astype(np.float32),
        "ball_state": np.where(balls.is_held, HELD, np.where(balls.is_delivered, DELIVERED, LYING)),
        "ball_holder": balls.holder,
        "link_sender": record.links.sender,
        "link_valid": record.links.valid,
        "link_led": record.links.led,
        "link_bearing": record.links.bearing,
        "link_distance": record.measured_distance,
        "link_heard": record.is_heard,
        "dust_vector": memory.dust.vector,
        "dust_known": memory.dust.known,
        "dust_hop": memory.dust.hop,
        "dump_vector": memory.dump.vector,
        "dump_known": memory.dump.known,
        "dump_hop": memory.dump.hop,
        "delivered": balls.is_delivered.sum(axis=1),
        "picked": balls.was_picked.sum(axis=1),
        "collisions": record.collisions,
        "mean_speed": record.speed,
    }
    return Frames(**{f.name: _in_si(values[f.name], **f.metadata) for f in fields(Frames)})


def _in_si(values: np.ndarray, dtype: type, units: tuple[str, ...]) -> np.ndarray:
    """Values in SI, from arena units; `units` are those of the last axis, or one for all, or none."""
    scale = np.array([_FROM_ARENA.get(unit, 1.0) for unit in units], values.dtype)
    return (values * scale).astype(dtype) if units else values.astype(dtype)
