"""How a world begins: what its task lays out, and which robots are dead."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.simulation.start_check import check_poses
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.layout import cell_of
from iswarm_mj.tasks.protocol import DrivingTask, LayingTask, Task
from iswarm_mj.tasks.signatures import check_layout
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.obstacles import Box
from iswarm_mj.utils.robot import Robots


class Start(NamedTuple):
    """How one world begins."""

    poses: Float[np.ndarray, "N 3"]
    """x, y [mm] and yaw [rad]."""
    task: Any
    """State of the task, see `tasks.protocol.Task.lay_out`."""
    is_alive: Bool[np.ndarray, "N"]
    boxes: Sequence[Box] | None = None
    """As `ArenaConfig.boxes`, of which sizes, masses and friction are those of the run; None: where the arena has them.
    """


def draw_start(
    config: SwarmConfig, task: Task, robot: Robots, n_robots: int, seed: int, index: int, failed_fraction: float = 0.0
) -> Start:
    """Draw how world `index` of a seed begins; all worlds of a seed share what the task draws of the seed alone."""
    shared, own = np.random.default_rng([seed, 2**32 - 1]), np.random.default_rng([seed, index])
    return start_with(config, task, robot, n_robots, own, shared, failed_fraction)


def start_with(
    config: SwarmConfig,
    task: Task,
    robot: Robots,
    n_robots: int,
    rng: np.random.Generator,
    shared: np.random.Generator,
    failed_fraction: float = 0.0,
) -> Start:
    """Draw how a world begins.

    Args:
        config: of the world.
        task: lays out robots and all else.
        robot: geometry.
        n_robots: N.
        rng: of the world.
        shared: draws what worlds of one seed have in common; may be `rng`.
        failed_fraction: share of the robots that are dead.

    Raises:
        UserError: what the task lays out is no layout, or robots stand beyond the walls or in each other.
    """
    if isinstance(task, LayingTask):
        name = f"{type(task).__name__}.lay_boxes"
        with user_code(name):
            boxes = task.lay_boxes(config, rng, shared)
        config = boxed(config, boxes, name)
    name = f"{type(task).__name__}.lay_out"
    with user_code(name):
        poses, state = task.lay_out(config, n_robots, rng, shared, cell_of(robot))
    check_layout(task, poses, state, n_robots)
    check_poses(f"poses of {name}", poses, robot, config.arena)
    is_alive = np.ones(n_robots, bool)
    is_alive[rng.permutation(n_robots)[: round(failed_fraction * n_robots)]] = False
    return Start(poses, state, is_alive, config.arena.boxes)


def boxed(config: SwarmConfig, boxes: Any, name: str) -> SwarmConfig:
    """Return a configuration with other boxes, which `name` gave.

    Raises:
        UserError: they are none, or cannot lie so.
    """
    boxes = _plain(boxes)
    if boxes == config.arena.boxes:
        return config
    try:
        return replace(config, arena=replace(config.arena, boxes=boxes))
    except ConfigError as error:
        raise UserError(f"boxes of {name}: {error}") from None


def check_boxes(task: Task, starts: Sequence[Start]) -> None:
    """Raise a UserError if worlds of a run have different boxes, or a task drives boxes and there are none."""
    name = type(task).__name__
    each = [[(*box[2:4], *box[5:]) for box in start.boxes or ()] for start in starts]
    if different := [world for world, boxes in enumerate(each) if boxes != each[0]]:
        raise UserError(
            f"world {different[0]} of {name} has other boxes than the first; worlds of a run may differ in x, y and "
            "yaw of their boxes, not in number, half edges, mass and friction"
        )
    if isinstance(task, DrivingTask) and not any(mass == 0 for *_, mass, _ in each[0]):
        fact = f"{name}.drive_boxes moves boxes of mass 0, of which there are none"
        raise UserError(f"{fact}; lay one, or add it to `arena.boxes`")


def _plain(given: Any) -> Any:
    """Tuples in place of lists and arrays, at all depths, so that boxes can be compared."""
    given = given.tolist() if hasattr(given, "tolist") else given
    return tuple(map(_plain, given)) if isinstance(given, list | tuple) else given
