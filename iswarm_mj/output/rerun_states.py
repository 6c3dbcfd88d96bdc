"""States of robots in a swarm's recording: lanes of some robots, and how many robots are in each state."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import rerun as rr
from jaxtyping import UInt8

from iswarm_mj.output.memory import is_known, vectors
from iswarm_mj.output.palette import EMPTY, LOADED, SKY, Rgb, rgb
from iswarm_mj.output.rerun_names import COUNTS
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene

MOST = 8
"""Lanes at most."""


class State(NamedTuple):
    """A state of a robot; of several that hold, the last one of `STATES` is shown."""

    name: str
    colour: Rgb
    is_loaded: bool = False
    """Whether the robot holds a ball."""
    vector: str = ""
    """The recorded vector that the robot knows; empty if that does not matter."""
    stands: bool = False
    """The drive carried out neither a turn nor a way."""


DEAD = State("dead", (70, 70, 70))
STATES = (
    State("empty", rgb(EMPTY)),
    State("empty, knows dust", (240, 165, 95), vector="dust_vector"),
    State("empty, stands", (150, 120, 100), stands=True),
    State("loaded", rgb(LOADED), True),
    State("loaded, knows dump", rgb(SKY), True, "dump_vector"),
    State("loaded, stands", (100, 120, 150), True, stands=True),
    DEAD,
)
"""Colours are those of the robots, lighter with a vector, greyer at rest."""


def states(scene: Scene) -> list[State]:
    """Return the states that robots of this scene can have."""
    recorded = {"", *(vector.name for vector in vectors(scene.memory))}
    return [
        state for state in STATES if state.vector in recorded and (not state.is_loaded or len(scene.ball_radius) > 0)
    ]


def states_of(scene: Scene, frames: Frames) -> UInt8[np.ndarray, "T N"]:
    """Return the state of each robot, its place in `states`; at the start, before the first step, none stands."""
    stands = ~frames.command.any(axis=-1) & (frames.step > 0)[:, None]
    known = {vector.name: is_known(frames, vector) for vector in vectors(scene.memory)}
    found = np.zeros(frames.is_loaded.shape, np.uint8)
    for place, state in enumerate(states(scene)):
        is_in = (frames.is_loaded == state.is_loaded) & known.get(state.vector, True) & (stands | (not state.stands))
        found[is_in if state != DEAD else ~frames.is_alive] = place
    return found


def lane(robot: int) -> str:
    """Return the entity of a robot's lane."""
    return f"states/robot_{robot}"


def shown_lanes(scene: Scene) -> tuple[int, ...]:
    """Return the robots that get a lane: some that are alive, from the first to the last."""
    alive = np.flatnonzero(scene.is_alive)
    places = np.linspace(0, len(alive) - 1, min(MOST, len(alive)), dtype=int)
    return tuple(alive[places].tolist())


def static_lanes(scene: Scene, robots: tuple[int, ...]) -> Iterator[tuple[str, rr.AsComponents]]:
    """Yield (entity, archetype) of the looks of the lanes and of the counts."""
    names, colours = [state.name for state in states(scene)], [state.colour for state in states(scene)]
    yield COUNTS, rr.SeriesLines(names=names, colors=colours, widths=[1.5] * len(names))
    for robot in robots:
        labels = [f"scout, {name}" if scene.is_scout[robot] else name for name in names]
        yield lane(robot), rr.StateConfiguration(values=names, labels=labels, colors=colours)
