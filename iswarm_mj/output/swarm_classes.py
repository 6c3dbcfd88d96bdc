"""Classes of robots, balls and links, and their colours, in recordings and on the page."""

import numpy as np
from jaxtyping import Bool, UInt16

from iswarm_mj.output.palette import EMPTY, LOADED, PINK, PURPLE, SCOUT, rgb

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


def robot_classes(
    is_loaded: Bool[np.ndarray, "T N"], is_scout: Bool[np.ndarray, "N"], has_priority: Bool[np.ndarray, "T N"]
) -> UInt16[np.ndarray, "T N"]:
    """Return classes of `ROBOT_CLASSES`: load before scout before worker, twice that, plus priority."""
    return (np.where(is_loaded, 4, np.where(is_scout, 2, 0)) + has_priority).astype(np.uint16)
