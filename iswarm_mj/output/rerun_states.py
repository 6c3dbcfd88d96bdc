"""States of robots in a swarm's recording: lanes of some robots, and how many robots are in each state."""

from typing import NamedTuple

import numpy as np
import rerun as rr
from jaxtyping import Bool, Int, UInt8

from iswarm_mj.output.memory_vectors import is_known, vector
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene

COUNTS = "series/states"
"""Entity of the number of robots in each state, in the order of `states`."""
MOST = 8
"""Lanes that are shown if none are asked for."""


class State(NamedTuple):
    """A state of a robot; of several that hold, the last one of `STATES` is shown."""

    name: str
    colour: tuple[int, int, int]
    is_loaded: bool = False
    """Whether the robot holds a ball."""
    vector: str = ""
    """The recorded vector that the robot knows; empty if that does not matter."""
    stands: bool = False
    """The drive carried out neither a turn nor a way."""


DEAD = State("dead", (70, 70, 70))
STATES = (
    State("empty", (213, 94, 0)),
    State("empty, knows dust", (240, 165, 95), vector="dust_vector"),
    State("empty, stands", (150, 120, 100), stands=True),
    State("loaded", (0, 114, 178), True),
    State("loaded, knows dump", (86, 180, 233), True, "dump_vector"),
    State("loaded, stands", (100, 120, 150), True, stands=True),
    DEAD,
)
"""Colours are those of the robots, lighter with a vector, greyer at rest."""


def states(scene: Scene) -> list[State]:
    """Return the states that robots of this scene can have."""
    return [
        state
        for state in STATES
        if (not state.vector or state.vector in scene.arrows)
        and (not state.is_loaded or len(scene.ball_radius) > 0)
        and (state != DEAD or not np.all(scene.is_alive))
    ]


def states_of(scene: Scene, frames: Frames) -> UInt8[np.ndarray, "T N"]:
    """Return the state of each robot, its place in `states`; at the start, before the first step, none stands."""
    stands = ~frames.command.any(axis=-1) & (frames.step > 0)[:, None]
    found = np.zeros(frames.is_loaded.shape, np.uint8)
    for place, state in enumerate(states(scene)):
        found[_is_in(state, scene, frames, stands)] = place
    return found


def _is_in(state: State, scene: Scene, frames: Frames, stands: Bool[np.ndarray, "T N"]) -> Bool[np.ndarray, "T N"]:
    if state == DEAD:
        return np.broadcast_to(~np.asarray(scene.is_alive), stands.shape)
    known = is_known(frames, vector(state.vector)) if state.vector else True
    return (frames.is_loaded == state.is_loaded) & known & (stands | (not state.stands))


def lane(robot: int) -> str:
    """Return the entity of a robot's lane."""
    return f"states/robot_{robot}"


def shown_lanes(scene: Scene, wanted: tuple[int, ...]) -> tuple[int, ...]:
    """Return the robots that get a lane: those asked for, or some that are alive, from the first to the last."""
    alive = np.flatnonzero(scene.is_alive)
    places = np.linspace(0, len(alive) - 1, min(MOST, len(alive)), dtype=int)
    return tuple(wanted) or tuple(alive[places].tolist())


def static_lanes(scene: Scene, robots: tuple[int, ...]) -> list[tuple[str, rr.AsComponents]]:
    """Return (entity, archetype) of the looks of the lanes and of the counts."""
    names, colours = [state.name for state in states(scene)], [state.colour for state in states(scene)]
    found: list[tuple[str, rr.AsComponents]] = [
        (COUNTS, rr.SeriesLines(names=names, colors=colours, widths=[1.5] * len(names)))
    ]
    for robot in robots:
        labels = [f"scout, {name}" if scene.is_scout[robot] else name for name in names]
        found.append((lane(robot), rr.StateConfiguration(values=names, labels=labels, colors=colours)))
    return found


def changes(
    found: UInt8[np.ndarray, "T N"], last: UInt8[np.ndarray, "N"] | None, robots: tuple[int, ...]
) -> dict[int, Int[np.ndarray, "M"]]:
    """Return the frames of a block in which robots change their states, for those that do.

    Args:
        found: states of all robots in the block.
        last: in the frame before it; None before the first, in which all change.
        robots: numbers of some robots.
    """
    before = np.full_like(found[:1], len(STATES)) if last is None else last[None]
    changed = np.diff(np.concatenate([before, found]), axis=0) != 0
    return {robot: np.flatnonzero(changed[:, robot]) for robot in robots if changed[:, robot].any()}
