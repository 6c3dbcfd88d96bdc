"""States of robots in a swarm's recording: lanes of some robots, and how many robots are in each state."""

from typing import Any, NamedTuple

import numpy as np
import rerun as rr
from jaxtyping import Int, UInt8

from iswarm_mj.output.remembered import is_known
from iswarm_mj.output.trajectory import Frames, Scene

COUNTS = "series/states"
"""Entity of the number of robots in each state, in the order of `names`."""

MOST = 8
"""Lanes that are shown if none are asked for."""


class State(NamedTuple):
    """A state of a robot; of several that hold, the last one of `STATES` is shown."""

    name: str
    colour: tuple[int, int, int]
    is_loaded: bool | None
    """Whether the robot holds a ball; None if that does not matter."""
    vector: str = ""
    """The recorded vector that the robot knows; empty if that does not matter."""


STANDS, DEAD = ", stands", "dead"
STATES = (
    State("empty", (213, 94, 0), False),
    State("empty, knows dust", (240, 165, 95), False, "dust_vector"),
    State(f"empty{STANDS}", (150, 120, 100), False),
    State("loaded", (0, 114, 178), True),
    State("loaded, knows dump", (86, 180, 233), True, "dump_vector"),
    State(f"loaded{STANDS}", (100, 120, 150), True),
    State(DEAD, (70, 70, 70), None),
)
"""Colours are those of the robots, lighter with a vector, greyer at rest."""


def states(scene: Scene) -> list[State]:
    """Return the states that robots of this scene can have."""
    return [
        state
        for state in STATES
        if (not state.vector or state.vector in scene.arrows)
        and (not state.is_loaded or len(scene.ball_radius) > 0)
        and (state.name != DEAD or not np.all(scene.is_alive))
    ]


def names(scene: Scene) -> list[str]:
    """Return the names of these states."""
    return [state.name for state in states(scene)]


def states_of(scene: Scene, frames: Frames) -> UInt8[np.ndarray, "T N"]:
    """Return the state of each robot, its place in `states`.

    A robot stands if its drive carried out neither a turn nor a way; at the start, before the first step, none does.
    """
    stands = ~(frames.command[..., 0].astype(bool) | frames.command[..., 1].astype(bool))
    stands[np.asarray(frames.step) == 0] = False
    found = np.zeros(frames.is_loaded.shape, np.uint8)
    for place, state in enumerate(states(scene)):
        if state.name == DEAD:
            found[:, ~np.asarray(scene.is_alive)] = place
            continue
        holds = frames.is_loaded if state.is_loaded else ~frames.is_loaded
        if state.vector:
            holds = holds & is_known(frames, state.vector)
        if state.name.endswith(STANDS):
            holds = holds & stands
        found[holds] = place
    return found


def counts(found: UInt8[np.ndarray, "T N"], n_states: int) -> Int[np.ndarray, "T K"]:
    """Return the number of robots in each state."""
    return np.stack([np.count_nonzero(found == place, axis=1) for place in range(n_states)], axis=1)


def lane(robot: int) -> str:
    """Return the entity of a robot's lane."""
    return f"states/robot_{robot}"


def shown_lanes(scene: Scene, wanted: tuple[int, ...]) -> tuple[int, ...]:
    """Return the robots that get a lane: those asked for, or some that are alive, from the first to the last."""
    alive = np.flatnonzero(scene.is_alive)
    n_lanes = min(MOST, len(alive))
    return tuple(wanted) or tuple(alive[np.linspace(0, len(alive) - 1, n_lanes, dtype=int)].tolist())


def static_lanes(scene: Scene, robots: tuple[int, ...]) -> list[tuple[str, Any]]:
    """Return (entity, archetype) of the looks of the lanes and of the counts."""
    each = states(scene)
    own, colours = [state.name for state in each], [state.colour for state in each]
    looks = [
        (
            lane(robot),
            rr.StateConfiguration(
                values=own,
                labels=[f"scout, {name}" if scene.is_scout[robot] else name for name in own],
                colors=colours,
            ),
        )
        for robot in robots
    ]
    return [(COUNTS, rr.SeriesLines(names=own, colors=colours, widths=[1.5] * len(own))), *looks]


class Lanes:
    """Tells when some robots change their states."""

    def __init__(self, robots: tuple[int, ...]):
        """Begin without a state.

        Args:
            robots: their numbers.
        """
        self._robots, self._last = robots, np.full(len(robots), len(STATES), np.uint8)

    def changes(self, found: UInt8[np.ndarray, "T N"]) -> dict[int, Int[np.ndarray, "M"]]:
        """Return the frames of the next block in which each robot that changes its state does so.

        Args:
            found: states of all robots in the block.
        """
        own = np.concatenate([self._last[None], found[:, list(self._robots)]])
        self._last = own[-1]
        changed = own[1:] != own[:-1]
        each = {robot: np.flatnonzero(changed[:, place]) for place, robot in enumerate(self._robots)}
        return {robot: when for robot, when in each.items() if len(when)}
