"""Classes of robots, balls and links, and their colours, in recordings and on the page."""

from itertools import cycle

import numpy as np
from jaxtyping import Bool, Int, UInt16

from iswarm_mj.output.palette import EMPTY, LOADED, PINK, PURPLE, SCOUT, SKY, YELLOW, Rgb, rgb
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
