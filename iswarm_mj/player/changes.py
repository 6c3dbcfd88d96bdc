"""Changes of settings, robots and balls while a run goes on, by which it can be repeated."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.geometry.obstacles import distances, numbers
from iswarm_mj.geometry.walls import beyond
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.simulation.failures import STREAM
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.state import SwarmState
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import mm_from_rd

KILL = "kill"
REVIVE = "revive"
BALL = "ball"
FAIL = "fail"
MOVE = "move"
EDITS = (KILL, REVIVE, BALL, FAIL, MOVE)
"""Changes that are no settings; they name a robot by its number, the place x,y of a ball [rd], the
share of the robots that fail, or a robot and its new place as 17,3.5,-2."""
_MOST_DIGITS = 9
"""Most digits of the number of a control step."""


class Change(NamedTuple):
    """A change between two control steps.

    As text it is like `40:p_vector_forget=0.5`, `52:kill=17` or `60:ball=3.5,-2`.
    """

    step: int
    """Control steps before the change."""
    name: str
    """Name of a setting, or one of `EDITS`."""
    value: str
    """New value of the setting, number of the robot, place of the ball, or share of robots."""

    def __str__(self) -> str:
        return f"{self.step}:{self.name}={self.value}"

    @classmethod
    def parse(cls, text: str) -> "Change":
        """Return the change that a text describes.

        Raises:
            ConfigError: it describes none.
        """
        step, _, rest = text.partition(":")
        name, equals, value = rest.partition("=")
        is_step = step.isascii() and step.isdigit() and len(step) <= _MOST_DIGITS
        if not (is_step and name and equals):
            form = "STEP:SETTING=VALUE, as 40:p_vector_forget=0.5"
            raise ConfigError("changes", text, form)
        return cls(int(step), name.replace("-", "_"), value)


def edit(run: Run, change: Change) -> Callable[[], None]:
    """Return the function that changes the robots or the balls of a run's first world.

    Raises:
        UserError: there is no such robot or place, or there are no balls. The function raises it,
            too, where it depends on the present state.
    """
    if change.name == MOVE:
        robot, *place = _numbers(change, float, 3, "a robot and its place, as 60:move=17,3.5,-2")
        index = _checked_robot(run, robot)
        _check_place_of_robot(run, index, place)
        return partial(run.move_robot, index, mm_from_rd(np.array(place)))
    return partial(run.edit, edit_of_swarm(run, change))


def edit_of_swarm(run: Run, change: Change) -> Callable[[SwarmState], SwarmState]:
    """Return the function of the swarm's state for a change that moves no robot, see `edit`."""
    if change.name == BALL:
        place = _place_of_ball(run, change)
        return partial(_drop_ball, run, place)
    if change.name == FAIL:
        (share,) = _numbers(change, float, 1, "a share of the robots, as 40:fail=0.1")
        check("fail", share, "between 0 and 1", 0 <= share <= 1)
        rng = np.random.default_rng([run.settings.seed, change.step, STREAM])
        return partial(_let_fail, share, rng.permutation(run.settings.n_robots))
    (robot,) = _numbers(change, int, 1, "a robot by its number")
    return partial(_set_alive, _checked_robot(run, robot), is_alive=change.name == REVIVE)


def _checked_robot(run: Run, robot: float) -> int:
    """Return the number of a robot that a run has.

    Raises:
        UserError: it has none of this number.
    """
    n_robots = run.settings.n_robots
    if robot not in range(n_robots):
        raise UserError(f"there is no robot {robot:g}; they are numbered 0 to {n_robots - 1}")
    return int(robot)


def _check_place_of_robot(run: Run, index: int, place: list[float]) -> None:
    """Check that a robot could stand at a place with some heading, if all others were elsewhere.

    Args:
        run: run with the arena.
        index: number of the robot, for the error.
        place: x, y of its centre [rd].

    Raises:
        ConfigError: its centre would lie beyond a wall or in an obstacle.
    """
    arena = run.config.arena
    is_within = beyond(np.array(place), arena.walls) <= 0  # False where it is not a number
    is_free = bool((distances(np.array([place]), numbers(arena.obstacles)) > 0).all())
    constraint = "such that robots stand within the walls and outside obstacles"
    check(f"place of robot {index}", f"{place} rd", constraint, bool(is_within) and is_free)


def _place_of_ball(run: Run, change: Change) -> Float[np.ndarray, "2"]:
    """Return the place at which a change drops a ball [mm].

    Raises:
        UserError: the task has no balls, or there is no such place within the walls.
    """
    balls = run.task.balls(run.starts[0].task)
    if balls is None or not np.size(balls.radius):
        raise UserError(f"{type(run.task).__name__} has no balls; click on a robot instead")
    place = np.array(_numbers(change, float, 2, "a place, as 60:ball=3.5,-2"))
    is_within = beyond(place, run.config.arena.walls) <= 0  # False where it is not a number
    if not is_within:
        raise UserError(f"a ball must lie within the walls (got {change})")
    return np.array(mm_from_rd(place), np.float32)


def _numbers(change: Change, kind: Callable[[str], Any], n: int, meaning: str) -> list[Any]:
    """Return the numbers of which the value of a change consists.

    Args:
        change: change whose value has commas between its numbers.
        kind: type of the numbers.
        n: how many there must be.
        meaning: what they are, for the error.

    Raises:
        UserError: the value does not consist of so many numbers.
    """
    try:
        numbers = [kind(text) for text in change.value.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != n:
        raise UserError(f"the change {change} must name {meaning}")
    return numbers


def _set_alive(robot: int, swarm: SwarmState, *, is_alive: bool) -> SwarmState:
    """Return a swarm in whose first world a robot is alive or dead."""
    alive = np.array(swarm.is_alive)
    alive[0, robot] = is_alive
    return swarm._replace(is_alive=alive)


def _let_fail(share: float, order: Int[np.ndarray, "N"], swarm: SwarmState) -> SwarmState:
    """Return a swarm in whose first world a share of the robots that are alive have failed.

    Args:
        share: share of the living robots.
        order: numbers of all robots in the order in which they fail.
        swarm: present swarm.
    """
    alive = np.array(swarm.is_alive)
    living = order[alive[0, order]]
    alive[0, living[: round(share * len(living))]] = False
    return swarm._replace(is_alive=alive)


def _drop_ball(run: Run, place: Float[np.ndarray, "2"], swarm: SwarmState) -> SwarmState:
    """Return a swarm in whose first world another ball lies at a place [mm].

    It is the farthest one of the delivered balls, or else of those on the floor.

    Raises:
        UserError: robots hold all balls.
    """
    balls: Any = run.task.balls(swarm.task)
    is_delivered = np.asarray(balls.is_delivered[0])
    is_held = np.asarray(balls.is_held[0])
    is_free = is_delivered if is_delivered.any() else ~is_held
    if not is_free.any():
        raise UserError("robots hold all balls; wait until one is delivered")
    distance = np.linalg.norm(np.asarray(balls.position[0]) - place, axis=-1)
    ball = int(np.argmax(np.where(is_free, distance, -1.0)))

    def is_balls(part: Any) -> bool:
        return isinstance(part, Balls)

    def put_ball(part: Any) -> Any:
        return _with_ball_at(part, ball, place) if is_balls(part) else part

    # A task may keep its balls anywhere in its state.
    task = jax.tree.map(put_ball, swarm.task, is_leaf=is_balls)
    return swarm._replace(task=task)


def _with_ball_at(balls: Balls, ball: int, place: Float[np.ndarray, "2"]) -> Balls:
    """Return balls of which one lies on the floor at a place [mm], in the first world."""
    position = np.array(balls.position)
    is_delivered = np.array(balls.is_delivered)
    wait = np.array(balls.wait)
    position[0, ball] = place
    is_delivered[0, ball] = False
    wait[0, ball] = 0
    return balls._replace(position=position, is_delivered=is_delivered, wait=wait)
