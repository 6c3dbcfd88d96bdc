"""What is changed while a run goes on: settings, dead robots, balls. With it a run can be repeated bit by bit."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from iswarm_mj.geometry.walls import beyond
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.state import SwarmState
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import mm_from_rd

EDITS = KILL, REVIVE, BALL = "kill", "revive", "ball"
"""Changes that are no settings: of a robot by its number; a ball comes to lie at x,y [rd]."""


class Change(NamedTuple):
    """A change after so many control steps, as text `40:p_vector_forget=0.5`, `52:kill=17` or `60:ball=3.5,-2`."""

    step: int
    what: str
    """Name of a setting, or one of `KILL`, `REVIVE` and `BALL`."""
    value: str

    def __str__(self) -> str:
        return f"{self.step}:{self.what}={self.value}"

    @classmethod
    def parse(cls, text: str) -> "Change":
        """Return the change that a text describes.

        Raises:
            UserError: it describes none.
        """
        step, _, rest = text.partition(":")
        what, equals, value = rest.partition("=")
        if not (step.isascii() and step.isdigit() and len(step) < 10 and what and equals):
            raise UserError(f"a change must be STEP:SETTING=VALUE, as 40:p_vector_forget=0.5 (got {text!r})")
        return cls(int(step), what.replace("-", "_"), value)


def edit(run: Run, change: Change) -> Callable[[SwarmState], SwarmState]:
    """Return what changes the robots or the balls of a run's first world, for `Run.edit`.

    Raises:
        UserError: there is no such robot or place, or there are no balls.
    """
    if change.what == BALL:
        balls = run.task.balls(run.starts[0].task)
        if balls is None or not np.size(balls.radius):
            raise UserError(f"{type(run.task).__name__} has no balls; click on a robot instead")
        place = np.array(_numbers(change, float, 2, "a place, as 60:ball=3.5,-2"))
        if not beyond(place, run.config.arena.walls) <= 0:
            raise UserError(f"a ball must lie within the walls (got {change})")
        return partial(_with_ball, np.array(mm_from_rd(place), np.float32), run)
    (robot,) = _numbers(change, int, 1, "a robot by its number")
    if not 0 <= robot < run.settings.n_robots:
        raise UserError(f"there is no robot {robot}; they are numbered 0 to {run.settings.n_robots - 1}")
    return partial(_with_life, robot, change.what == REVIVE)


def _numbers(change: Change, kind: Callable[[str], Any], n: int, words: str) -> list[Any]:
    """So many numbers that the value of a change consists of."""
    try:
        found = list(map(kind, change.value.split(",")))
    except ValueError:
        found = []
    if len(found) != n:
        raise UserError(f"the change {change} must name {words}")
    return found


def _with_life(robot: int, is_alive: bool, swarm: SwarmState) -> SwarmState:
    alive = np.array(swarm.is_alive)
    alive[0, robot] = is_alive
    return swarm._replace(is_alive=alive)


def _with_ball(place: np.ndarray, run: Run, swarm: SwarmState) -> SwarmState:
    """The delivered ball that is farthest from a place, or else the farthest one on the floor, lies there."""
    balls: Any = run.task.balls(swarm.task)
    delivered, held = np.asarray(balls.is_delivered[0]), np.asarray(balls.is_held[0])
    free = delivered if delivered.any() else ~held
    if not free.any():
        raise UserError("robots hold all balls; wait until one is delivered")
    distance = np.linalg.norm(np.asarray(balls.position[0]) - place, axis=-1)
    ball = int(np.argmax(np.where(free, distance, -1.0)))

    def laid(part: Any) -> Any:
        if not isinstance(part, Balls):
            return part
        position, delivered, wait = (np.array(a) for a in (part.position, part.is_delivered, part.wait))
        position[0, ball], delivered[0, ball], wait[0, ball] = place, False, 0
        return part._replace(position=position, is_delivered=delivered, wait=wait)

    moved = jax.tree.map(laid, swarm.task, is_leaf=lambda part: isinstance(part, Balls))  # wherever they are in it
    return swarm._replace(task=moved)
