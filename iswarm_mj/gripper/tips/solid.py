"""Files of a tip: points of its profile, and its solid by revolution."""

from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.gripper.tips.profile import Profile
from iswarm_mj.utils.files import atomic_write

_UM = 1e6
"""Micrometres per metre."""
_POINTS_A_PIECE = 40
_SECTIONS = 128
"""Number of sectors of the solid."""
SHAFT = 2.0
"""Length of the wall of the solid, in radii of the tip."""


def points_of(profile: Profile) -> tuple[np.ndarray, np.ndarray]:
    """Return points (r, z) of the face, with the ends of all its arcs [m]."""
    face = profile.face
    arc_lengths = [0.0]
    for start, length, curvature in zip(face.start, face.length, face.curvature, strict=True):
        n_points = _POINTS_A_PIECE if curvature else 1
        from_start = length * np.arange(1, n_points + 1) / n_points
        arc_lengths += (start + from_start).tolist()
    r, z = face.at(np.array(arc_lengths))

    # Rounding may leave r next to the axis, or let it fall along the wall.
    r[0] = 0.0
    return np.maximum.accumulate(r), z


def write_points(profile: Profile, path: Path) -> None:
    """Write a table of points that `shapes.read_profile` reads [um]."""
    r, z = points_of(profile)
    lines = ["r [um],z [um]"]
    lines += [f"{x:.6f},{y:.6f}" for x, y in zip(r * _UM, z * _UM, strict=True)]
    with atomic_write(path) as part:
        part.write_text("\n".join(lines) + "\n", encoding="utf-8")


def revolved(profile: Profile, shaft: float, sections: int = _SECTIONS) -> Any:
    """Return the tip with a part of its shaft as a closed surface of `trimesh`, the face down.

    Args:
        profile: of the tip.
        shaft: length of the shaft above the highest point of the face [m].
        sections: number of sectors.

    Returns:
        The surface, in micrometres.
    """
    import trimesh

    r, z = points_of(profile)
    top = z.max() + shaft
    outline = np.stack([[*r, r[-1], 0.0], [*z, top, top]], axis=1) * _UM
    return trimesh.creation.revolve(outline, sections=sections)


def write_stl(profile: Profile, path: Path) -> None:
    """Write the tip with a part of its shaft as a closed surface, in micrometres, the face down."""
    import trimesh

    solid = revolved(profile, SHAFT * profile.radius)
    with atomic_write(path) as part:
        part.write_bytes(trimesh.exchange.stl.export_stl(solid))
