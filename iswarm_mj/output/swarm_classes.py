"""Classes of robots, balls and links, states of robots, and their colours, in recordings and on the page."""

from itertools import cycle
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int, UInt8, UInt16

from iswarm_mj.output.memory import is_known, vectors
from iswarm_mj.output.palette import EMPTY, LOADED, PINK, PURPLE, SCOUT, SKY, YELLOW, Rgb, rgb
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene

ROBOT_CLASSES = (
    (0, "empty", rgb(EMPTY)),
    (1, "empty, sends priority", (135, 55, 0)),
    (2, "scout", rgb(SCOUT)),
    (3, "scout, sends priority", (0, 95, 70)),
    (4, "loaded", rgb(LOADED)),
    (5, "loaded, sends priority", (0, 60, 105)),
)
"""Class, label and colour: load goes before scout, scout before worker; priority is the darker shade.

None is that of the floor or an area on it.
"""
BALL_CLASS_OFFSET, LINK_CLASS_OFFSET = 10, 20
"""A ball's class is the first plus its state; a link's the second, plus one if its message was heard."""
BALL_CLASSES = (
    (10, "on the floor", (25, 25, 25)),
    (11, "held", (255, 240, 60)),
    (12, "delivered", rgb(PURPLE)),
)
LINK_CLASSES = ((20, "damaged message", rgb(PINK)), (21, "heard", (95, 95, 105)))
TEAM_CLASS_OFFSET = 30
"""Class of the first team's robots; that of its loaded ones follows, then those of the other teams."""
TEAM_COLOURS = tuple(map(rgb, (EMPTY, LOADED, SCOUT, PINK, YELLOW, SKY)))
"""In turn."""


def groups(scene: Scene) -> tuple[Int[np.ndarray, "N"], tuple[str, ...]]:
    """Return to which team each robot belongs, or else to which kind, and their names; none if all are alike."""
    if scene.team_names:
        return scene.team, scene.team_names
    kinds = int(np.max(scene.kind, initial=0)) + 1
    return scene.kind, tuple(f"kind {number}" for number in range(kinds)) if kinds > 1 else ()


def robot_classes(
    scene: Scene, is_loaded: Bool[np.ndarray, "*T N"], has_priority: Bool[np.ndarray, "*T N"]
) -> UInt16[np.ndarray, "*T N"]:
    """Return classes of `ROBOT_CLASSES`: load before scout before worker, twice that, plus priority; or of teams."""
    number, names = groups(scene)
    if names:
        return (TEAM_CLASS_OFFSET + 2 * number + is_loaded).astype(np.uint16)
    return (np.where(is_loaded, 4, np.where(scene.is_scout, 2, 0)) + has_priority).astype(np.uint16)


def shown_classes(scene: Scene) -> list[tuple[int, str, Rgb]]:
    """Return class, label and colour of the robots that a scene can show; loaded ones of a team are darker."""
    has_balls, names = len(scene.ball_radius) > 0, groups(scene)[1]
    if not names:
        there = {0, 1, *((2, 3) if np.any(scene.is_scout) else ()), *((4, 5) if has_balls else ())}
        return [one for one in ROBOT_CLASSES if one[0] in there]
    found = []
    for number, (name, colour) in enumerate(zip(names, cycle(TEAM_COLOURS))):
        place, dark = TEAM_CLASS_OFFSET + 2 * number, (colour[0] * 3 // 5, colour[1] * 3 // 5, colour[2] * 3 // 5)
        found += [(place, name, colour), (place + 1, f"{name}, loaded", dark)][: 1 + has_balls]
    return found


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
