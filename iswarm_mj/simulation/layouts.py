"""Layout of a world at the start: robots, which of them are dead, boxes, and the task."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.geometry.obstacles import BOX_FIELDS, Box
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.simulation.layout_checks import check_poses
from iswarm_mj.strategy.base import overrides
from iswarm_mj.tasks.base import Task
from iswarm_mj.tasks.layout import cell_of
from iswarm_mj.tasks.validation import check_layout
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.user_code import user_code

_SHARED_STREAM = 2**32 - 1
"""Number of the random stream that all worlds of a seed share; worlds have the numbers below it."""

_VARIES_BETWEEN_WORLDS = {"x", "y", "yaw"}
"""Numbers of a box in which worlds of a run may differ."""


class Start(NamedTuple):
    """Layout of one world at the start."""

    poses: Float[np.ndarray, "N 3"]
    """x, y [mm] and yaw [rad] of the robots."""
    task: Any
    """State of the task, see `tasks.base.Task.lay_out`."""
    is_alive: Bool[np.ndarray, "N"]
    """Robots that live; the others are dead from the start."""
    boxes: Sequence[Box] | None = None
    """Boxes (`ArenaConfig.boxes`), like those of the run but for their poses; None: the arena's."""


def draw_start(
    config: SwarmConfig,
    task: Task,
    robot: Robots,
    n_robots: int,
    seed: int,
    index: int,
    failed_fraction: float = 0.0,
) -> Start:
    """Draw the start of a world of a seed.

    All worlds of a seed share what the task draws from the seed alone.

    Args:
        config: configuration of the world.
        task: lays out robots and all else.
        robot: geometry of the robots.
        n_robots: number of robots.
        seed: seed of the run.
        index: number of the world under the seed.
        failed_fraction: share of the robots that are dead.
    """
    return draw_start_with(
        config=config,
        task=task,
        robot=robot,
        n_robots=n_robots,
        rng=np.random.default_rng([seed, index]),
        shared=np.random.default_rng([seed, _SHARED_STREAM]),
        failed_fraction=failed_fraction,
    )


def draw_start_with(
    config: SwarmConfig,
    task: Task,
    robot: Robots,
    n_robots: int,
    rng: np.random.Generator,
    shared: np.random.Generator,
    failed_fraction: float = 0.0,
) -> Start:
    """Draw the start of a world.

    Args:
        config: configuration of the world.
        task: lays out robots and all else.
        robot: geometry of the robots.
        n_robots: number of robots N.
        rng: generator of the world.
        shared: generator of what worlds of one seed have in common; may be `rng`.
        failed_fraction: share of the robots that are dead.

    Raises:
        UserError: the task returns no layout, or robots stand beyond the walls or in each other.
    """
    task_name = type(task).__name__

    # Boxes come first, since robots and balls are laid around them.
    with user_code(f"{task_name}.lay_boxes"):
        boxes = task.lay_boxes(config, rng, shared)
    if boxes is not None:
        config = with_boxes_laid(config, boxes, f"{task_name}.lay_boxes")

    with user_code(f"{task_name}.lay_out"):
        poses, task_state = task.lay_out(config, n_robots, rng, shared, cell_of(robot))
    check_layout(task, poses, task_state, n_robots)
    check_poses(f"poses of {task_name}.lay_out", poses, robot, config.arena)

    n_dead = round(failed_fraction * n_robots)
    is_alive = np.ones(n_robots, bool)
    is_alive[rng.permutation(n_robots)[:n_dead]] = False
    return Start(poses, task_state, is_alive, config.arena.boxes)


def with_boxes_laid(config: SwarmConfig, boxes: Any, source: str) -> SwarmConfig:
    """Return a configuration with other boxes.

    Args:
        config: configuration of a world.
        boxes: boxes as in `ArenaConfig.boxes`, in tuples, lists or arrays.
        source: who laid them, for messages.

    Raises:
        UserError: these are no boxes, or they cannot lie so.
    """
    boxes = _as_tuples(boxes)
    if boxes == config.arena.boxes:
        return config
    try:
        return replace(config, arena=replace(config.arena, boxes=boxes))
    except ConfigError as error:
        raise UserError(f"boxes of {source}: {error}") from None


def _as_tuples(values: Any) -> Any:
    """Return tuples in place of lists and arrays, at all depths, so that boxes can be compared."""
    if hasattr(values, "tolist"):
        values = values.tolist()
    if isinstance(values, list | tuple):
        return tuple(_as_tuples(value) for value in values)
    return values


def check_boxes(task: Task, starts: Sequence[Start]) -> None:
    """Check that worlds have the same boxes but for their poses, and those that the task drives.

    Raises:
        UserError: worlds have different boxes, or the task drives boxes and none has mass 0.
    """
    name = type(task).__name__
    boxes_of_worlds = [_fixed_properties(start) for start in starts]
    for world, boxes in enumerate(boxes_of_worlds):
        if boxes != boxes_of_worlds[0]:
            raise UserError(
                f"world {world} of {name} has other boxes than the first; worlds of a run may "
                "differ in x, y and yaw of their boxes, not in number, half edges, mass and "
                "friction"
            )

    has_driven_box = any(box["mass"] == 0 for box in boxes_of_worlds[0])
    if overrides(task, Task, "drive_boxes") and not has_driven_box:
        raise UserError(
            f"{name}.drive_boxes moves boxes of mass 0, of which there are none; lay one, or add "
            "it to `arena.boxes`"
        )


def _fixed_properties(start: Start) -> list[dict[str, float]]:
    """Return the properties of each box of a world that are the same in all worlds, by name."""
    properties = []
    for box in start.boxes or ():
        named = zip(BOX_FIELDS, box, strict=True)
        fixed = {name: value for name, value in named if name not in _VARIES_BETWEEN_WORLDS}
        properties.append(fixed)
    return properties
