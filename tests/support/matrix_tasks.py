"""Tasks of the matrix, each with another part that a task may have; and the strategy of all.

Units: mm, s.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np

from iswarm_mj.geometry.obstacles import poses_of_boxes
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.base import AreaStyle, Quantity, Task, without_balls
from iswarm_mj.tasks.cleaning import CLEANING, Cleaning
from iswarm_mj.tasks.grasping import update_balls
from iswarm_mj.utils.units import mm_from_rd
from support.matrix_worlds import BOXES, HOLDERS, MORTAL, N, places

TIP = (1.0, 0.05)
"""Place ahead of a robot that the tools of both kinds of robots reach [mm]."""
GATE_STEP = 1.5
"""Gates slide by this in a control step [mm]."""
DIES_AT = 3
"""Control step in which mortal robots die, from 1."""
LIFTS_AT = 2
"""The only control step in which balls can be lifted in bad weather, from 1."""
CALM_AT = 3
"""The control step of bad weather without errors of the drive, from 1."""
DROPS_AT = 4
"""The first control step of bad weather in which all balls fall, from 1."""


@dataclass(frozen=True)
class Drill(Strategy):
    """Every second robot drives ahead, one of them in a circle; the others stand."""

    turn: float = 0.5 * math.radians(90.0)
    forward: float = mm_from_rd(0.5)

    def init(self, n_robots, key):
        return jnp.arange(n_robots)

    def picks(self, memory):
        return memory >= 0

    def act(self, memory, observation, key):
        return memory, Command(self.turn * (memory == 5), self.forward * (memory % 2))


class Diary(NamedTuple):
    """State of the tasks."""

    step: np.ndarray
    """Number of control steps taken."""
    seen: dict[str, Any]
    """Values of `look` in the latest step."""
    gates: np.ndarray
    """Poses that the boxes are to take [mm, mm, rad]."""
    balls: Balls | None
    """Balls of tasks that derive from `Cleaning`."""


def look(arena: Any, conditions: Any) -> dict[str, Any]:
    """Return some settings and conditions that a task sees."""
    return {
        "edge": arena.size,
        "half_height": arena.half_extent[1],
        "offset": arena.dust_area_offset,
        "dust_size": arena.dust_area_size,
        "dump": conditions.dump_size,
        "lifting": conditions.grasp_voltage,
        "dropping": conditions.drop_rate,
        "turning": conditions.error_turn,
    }


SEEN = ("edge", "half_height", "offset", "dust_size", "dump", "lifting", "dropping", "turning")
"""Names of the values that `look` returns."""


@dataclass(frozen=True)
class Own(Task):
    """A task that derives from `Task` and notes what it sees."""

    measured: ClassVar = {name: Quantity("of the world") for name in SEEN}

    def lay_out(self, config, n_robots, rng, shared, cell):
        nothing = {name: np.float32(0) for name in SEEN}
        gates = poses_of_boxes(config.arena.boxes).astype(np.float32)
        poses = places(config.arena)[:n_robots]
        balls = self.lay_balls(config, poses, rng, shared, cell)
        return poses, Diary(np.int32(0), nothing, gates, balls)

    def lay_balls(self, config, poses, rng, shared, cell):
        return None

    def advance(self, state, inputs, key):
        balls, sensed = self.handle(state, inputs, key)
        sight = look(inputs.arena, inputs.conditions)
        seen = {name: jnp.float32(value) for name, value in sight.items()}

        # Gates slide apart; the other boxes have a mass, so that no task drives them.
        north = [0, 1, 0]
        south = [0, -1, 0]
        ignored = [3, 3, 0]
        gates = inputs.boxes + GATE_STEP * jnp.array([north, south, ignored, ignored])
        return Diary(state.step + 1, seen, jnp.float32(gates), balls), sensed

    def handle(self, state, inputs, key):
        return None, without_balls(len(inputs.poses))

    def reward(self, before, after, inputs):
        return jnp.full(len(inputs.poses), inputs.arena.size + inputs.arena.dust_area_offset)

    def metrics(self, state):
        return state.seen


@dataclass(frozen=True)
class Zoned(Own):
    """A task with a disc on the floor, as large as the dump, that goes north beside the dust."""

    drawn: ClassVar = {"disc": AreaStyle((10, 200, 30))}

    def areas(self, config, state):
        x = mm_from_rd(config.arena.dust_area_offset)
        radius = mm_from_rd(config.arena.dump_size) / 2
        disc = [jnp.float32(x), jnp.float32(state.step), jnp.float32(radius)]
        return {"disc": jnp.stack(disc)[None]}


@dataclass(frozen=True)
class Tidy(Own, Cleaning):
    """A task that derives from `Cleaning`: balls lie at tools of robots, the last in the dust."""

    drawn: ClassVar = Cleaning.drawn

    def lay_balls(self, config, poses, rng, shared, cell):
        _, balls = CLEANING.lay_out(config, len(poses), rng, shared, cell)
        x, y, yaw = poses[list(HOLDERS)].T
        ahead, aside = TIP
        tip_x = x + ahead * np.cos(yaw) - aside * np.sin(yaw)
        tip_y = y + ahead * np.sin(yaw) + aside * np.cos(yaw)
        tips = np.column_stack([tip_x, tip_y])
        dust = [[-mm_from_rd(config.arena.dust_area_offset), 0.0]]
        return balls._replace(position=np.float32(np.concatenate([tips, dust])))

    def handle(self, state, inputs, key):
        return update_balls(state.balls, inputs, key)

    def balls(self, state):
        return state.balls

    def progress(self, state):
        return CLEANING.progress(state.balls)

    def areas(self, config, state):
        return CLEANING.areas(config, state.balls)


class Gates:
    """A part of tasks: gates slide apart; in the rectangle the task lays other boxes."""

    def lay_boxes(self, config, rng, shared):
        return laid_boxes(config) if config.arena.outline else None

    def drive_boxes(self, state):
        return state.gates


def laid_boxes(config):
    """Return the boxes of a world of the rectangle, shifted by the place of its dust areas."""
    shift = 0.1 * (config.arena.dust_area_offset - 8.0)
    return [(x + shift, *rest) for x, *rest in BOXES]


class Deaths:
    """A part of tasks: some robots die."""

    def survives(self, state):
        return (state.step < DIES_AT) | ~np.isin(np.arange(N), MORTAL)


class Weather:
    """A part of tasks: conditions change with the control steps, see `LIFTS_AT` and the next."""

    def conditions(self, state, conditions):
        step = state.step + 1
        return conditions._replace(
            grasp_voltage=jnp.where(step == LIFTS_AT, conditions.grasp_voltage, 0.0),
            error_turn=jnp.where(step == CALM_AT, 0.0, conditions.error_turn),
            drop_rate=jnp.where(step >= DROPS_AT, 1.0, conditions.drop_rate),
        )


@dataclass(frozen=True)
class Gated(Gates, Tidy):
    pass


@dataclass(frozen=True)
class Mortal(Deaths, Tidy):
    pass


@dataclass(frozen=True)
class Stormy(Weather, Tidy):
    pass


@dataclass(frozen=True)
class Everything(Gates, Deaths, Weather, Tidy):
    """A task with all parts, and a disc beside the areas of cleaning."""

    drawn: ClassVar = {**Cleaning.drawn, **Zoned.drawn}

    def areas(self, config, state):
        return Tidy.areas(self, config, state) | Zoned.areas(self, config, state)


TASKS = {
    "own": Own(),
    "areas": Zoned(),
    "cleaning": Tidy(),
    "boxes": Gated(),
    "deaths": Mortal(),
    "conditions": Stormy(),
    "everything": Everything(),
}
DISC = "area_disc"
