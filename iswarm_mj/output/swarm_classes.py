"""Classes of robots, balls and links, states of robots, and their colours.

Recordings and the page share them.
"""

from itertools import cycle
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int, UInt8, UInt16

from iswarm_mj.output.memory_vectors import is_known, recorded_vectors
from iswarm_mj.output.message_columns import payload_of
from iswarm_mj.output.palette import (
    EMPTY,
    LOADED,
    PINK,
    PURPLE,
    SCOUT,
    SKY,
    YELLOW,
    Rgb,
    rgb,
)
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.sensors.messages import PRIORITY

# Classes of a robot; a robot that sends priority has the next number.
WORKER_CLASS = 0
SCOUT_CLASS = 2
LOADED_CLASS = 4
ROBOT_CLASSES = (
    (0, "empty", rgb(EMPTY)),
    (1, "empty, sends priority", (135, 55, 0)),
    (2, "scout", rgb(SCOUT)),
    (3, "scout, sends priority", (0, 95, 70)),
    (4, "loaded", rgb(LOADED)),
    (5, "loaded, sends priority", (0, 60, 105)),
)
"""Class, label and colour of robots without teams and kinds.

A loaded scout counts as loaded; priority is a darker shade. No colour is that of the floor or of an
area on it.
"""
BALL_CLASS_OFFSET = 10
"""Class of a ball in state 0 (`schema.BALL_STATES`); those of other states follow."""
BALL_CLASSES = (
    (10, "on the floor", (25, 25, 25)),
    (11, "held", (255, 240, 60)),
    (12, "delivered", rgb(PURPLE)),
)
LINK_CLASS_OFFSET = 20
"""Class of a link with a damaged message; that of a link that was heard follows."""
LINK_CLASSES = ((20, "damaged message", rgb(PINK)), (21, "heard", (135, 135, 145)))
TEAM_CLASS_OFFSET = 30
"""Class of the first team's robots; that of its loaded robots follows, then the other teams'."""
TEAM_COLOURS = tuple(map(rgb, (EMPTY, LOADED, SCOUT, PINK, YELLOW, SKY)))
"""Colours of teams, which repeat where there are more teams."""


def robot_groups(scene: Scene) -> tuple[Int[np.ndarray, "N"], tuple[str, ...]]:
    """Return the number of each robot's group, and the names of the groups.

    Groups are teams or, without teams, kinds of robots; there are no names if all robots are alike.
    """
    if scene.team_names:
        return scene.team, scene.team_names
    n_kinds = int(np.max(scene.kind, initial=0)) + 1
    if n_kinds == 1:
        return scene.kind, ()
    return scene.kind, tuple(f"kind {number}" for number in range(n_kinds))


def robot_classes(
    scene: Scene, is_loaded: Bool[np.ndarray, "*T N"], has_priority: Bool[np.ndarray, "*T N"]
) -> UInt16[np.ndarray, "*T N"]:
    """Return the class of each robot: one of `ROBOT_CLASSES`, or that of its group."""
    group, names = robot_groups(scene)
    if names:
        return (TEAM_CLASS_OFFSET + 2 * group + is_loaded).astype(np.uint16)
    empty_class = np.where(scene.is_scout, SCOUT_CLASS, WORKER_CLASS)
    without_priority = np.where(is_loaded, LOADED_CLASS, empty_class)
    return (without_priority + has_priority).astype(np.uint16)


def may_send_priority(scene: Scene) -> bool:
    """Return whether the robots' messages have the flag `priority`."""
    return any(name == PRIORITY for name, _ in payload_of(scene).fields)


def shown_classes(scene: Scene) -> list[tuple[int, str, Rgb]]:
    """Return class, label and colour of the robots that a scene can show.

    Loaded robots of a group are a darker shade.
    """
    has_balls = len(scene.ball_radius) > 0
    _, group_names = robot_groups(scene)
    if not group_names:
        classes = [WORKER_CLASS]
        if np.any(scene.is_scout):
            classes.append(SCOUT_CLASS)
        if has_balls:
            classes.append(LOADED_CLASS)
        if may_send_priority(scene):
            classes += [number + 1 for number in classes]
        return [each for each in ROBOT_CLASSES if each[0] in classes]

    shown = []
    for group, (name, colour) in enumerate(zip(group_names, cycle(TEAM_COLOURS))):
        empty_class = TEAM_CLASS_OFFSET + 2 * group
        shown.append((empty_class, name, colour))
        if has_balls:
            red, green, blue = colour
            darker = (red * 3 // 5, green * 3 // 5, blue * 3 // 5)
            shown.append((empty_class + 1, f"{name}, loaded", darker))
    return shown


class State(NamedTuple):
    """A state of a robot; of several that hold, the last one of `STATES` is shown."""

    name: str
    colour: Rgb
    is_loaded: bool = False
    """The robot holds a ball."""
    vector: str = ""
    """Name of the recorded vector that the robot knows; empty if that does not matter."""
    stands: bool = False
    """The drive carried out neither a turn nor a walk."""


DEAD = State("dead", (70, 70, 70))
STATES = (
    State("empty", rgb(EMPTY)),
    State("empty, knows dust", (240, 165, 95), vector="dust_vector"),
    State("empty, stands", (150, 120, 100), stands=True),
    State("loaded", rgb(LOADED), is_loaded=True),
    State("loaded, knows dump", rgb(SKY), is_loaded=True, vector="dump_vector"),
    State("loaded, stands", (100, 120, 150), is_loaded=True, stands=True),
    DEAD,
)
"""States of a robot; colours are those of the robots, lighter with a vector, greyer at rest."""


def possible_states(scene: Scene) -> list[State]:
    """Return the states that robots of this scene can have."""
    has_balls = len(scene.ball_radius) > 0
    recorded = {"", *(vector.name for vector in recorded_vectors(scene.memory))}
    return [
        state for state in STATES if state.vector in recorded and (has_balls or not state.is_loaded)
    ]


def states_of(scene: Scene, frames: Frames) -> UInt8[np.ndarray, "T N"]:
    """Return the state of each robot as its place in `possible_states`.

    At the start, before the first step, no robot counts as standing.
    """
    is_after_start = (frames.step > 0)[:, None]
    stands = ~frames.command.any(axis=-1) & is_after_start
    known = {vector.name: is_known(frames, vector) for vector in recorded_vectors(scene.memory)}

    places = np.zeros(frames.is_loaded.shape, np.uint8)
    for place, state in enumerate(possible_states(scene)):
        if state == DEAD:
            is_in_state = ~frames.is_alive
        else:
            is_in_state = frames.is_loaded == state.is_loaded
            is_in_state = is_in_state & known.get(state.vector, True)
            if state.stands:
                is_in_state = is_in_state & stands
        places[is_in_state] = place
    return places
