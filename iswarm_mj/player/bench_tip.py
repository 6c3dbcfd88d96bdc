"""The tip of the bench on the page: its solid in the scene, and its profile over a ball."""

from typing import Any

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.tips.profile import Profile, seat_of
from iswarm_mj.gripper.tips.solid import points_of, revolved
from iswarm_mj.output.palette import BLUE, ORANGE
from iswarm_mj.output.trial_shapes import PROBE_LENGTH, UM
from iswarm_mj.player.widgets import AXIS

_SECTIONS = 48
"""Sectors of the solid, few enough for a browser."""
_N_POINTS = 401
"""Points of the outlines in the plot."""
_HALF_WIDTH = 1.15
"""Half the width of the plot, in radii of the tip or the ball, whichever is wider."""
_BELOW, _ABOVE = -0.75, 0.35
"""Ends of the vertical axis over half the width of the plot, so that circles look round."""
_HEIGHT = 190
"""Height of the plot [pixels]."""


def tip_mesh(
    profile: Profile, ball_radius: float
) -> tuple[Float[np.ndarray, "V 3"], Float[np.ndarray, "F 3"]]:
    """Return vertices and faces of a tip about the middle of the probe [um].

    The probe's face, half its length below the middle, is where the top of a touching ball is. A
    hollow tip reaches below it, and its hollow lies above it.

    Args:
        profile: of the tip.
        ball_radius: of the ball [m].
    """
    solid = revolved(profile, shaft=PROBE_LENGTH / UM, sections=_SECTIONS)
    vertices = np.array(solid.vertices, np.float32)
    vertices[:, 2] += _height_over_ball(profile, ball_radius) * UM - PROBE_LENGTH / 2
    return vertices, np.array(solid.faces, np.uint32)


def _height_over_ball(profile: Profile, ball_radius: float) -> float:
    """Return the height of a profile's z = 0 over the top of a ball that touches it [m]."""
    ball_centre = seat_of(profile, ball_radius).height
    return -(ball_centre + ball_radius)


def outlines(
    profile: Profile, ball_radius: float
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Return outlines of a tip and of a ball that touches it from below [um].

    Args:
        profile: of the tip.
        ball_radius: of the ball [m].

    Returns:
        places: distance from the axis, negative on the left.
        tip: height of the tip's face over the ball's top, NaN beside the tip.
        ball: height of the ball's upper half, NaN beside the ball.
    """
    face_r, face_z = points_of(profile)
    tip_radius = face_r[-1]

    # Places from left to right, with the edges of tip and ball among them.
    half_width = _HALF_WIDTH * max(tip_radius, ball_radius)
    edges = [-tip_radius, tip_radius, -ball_radius, ball_radius]
    places = np.union1d(np.linspace(-half_width, half_width, _N_POINTS), edges)
    from_axis = np.abs(places)

    # Heights over the top of the ball.
    face_height = np.interp(from_axis, face_r, face_z) + _height_over_ball(profile, ball_radius)
    tip = np.where(from_axis <= tip_radius, face_height, np.nan)

    squared_height = np.maximum(ball_radius**2 - from_axis**2, 0.0)
    ball_height = np.sqrt(squared_height) - ball_radius
    ball = np.where(from_axis <= ball_radius, ball_height, np.nan)
    return places * UM, tip * UM, ball * UM


class TipPlot:
    """Plot of the profile of a tip, and of a ball that touches it."""

    def __init__(self, gui: Any):
        """Add the plot, without data, to the present container.

        Args:
            gui: panel of a viser server.
        """
        nothing = (np.arange(2.0), np.full(2, np.nan), np.full(2, np.nan))
        self._plot = gui.add_uplot(
            nothing,
            (
                {"label": "place"},
                {"label": "tip", "stroke": BLUE, "width": 2},
                {"label": "ball", "stroke": ORANGE, "width": 2},
            ),
            title="Profile of the tip on the ball",
            axes=(
                AXIS | {"label": "distance from the axis [µm]"},
                AXIS | {"label": "height [µm]"},
            ),
            scales={"x": {"time": False}},
            height=_HEIGHT,
        )

    def draw(self, profile: Profile, ball_radius: float) -> None:
        """Draw a tip on a ball of a radius [m]."""
        places, tip, ball = outlines(profile, ball_radius)
        half_width = float(places[-1])
        self._plot.scales = {
            "x": {"time": False, "range": (-half_width, half_width)},
            "y": {"range": (_BELOW * half_width, _ABOVE * half_width)},
        }
        self._plot.data = (places, tip, ball)
