"""Named shapes of tips, and profiles read from a table of points."""

import csv
import math
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.tips.profile import Profile, chain_of, polyline
from iswarm_mj.utils.errors import ConfigError, UserError, shown

Shape = Literal["flat", "rounded", "cone", "cup", "ring"]
SHAPES: tuple[str, ...] = get_args(Shape)

UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9}
"""Units of length in the header of a table [m]."""
MAX_POINTS = 500
"""Maximum number of points of a table."""


def flat(radius: float) -> Profile:
    """Return the end of a wire, cut square, with a sharp edge; lengths here are in metres."""
    return Profile("flat", chain_of([(radius, 0.0)]), 0.0)


def rounded(radius: float, curvature_radius: float) -> Profile:
    """Return the end of a wire that is a part of a sphere.

    Raises:
        ConfigError: the sphere is smaller than the wire.
    """
    if curvature_radius < radius:
        raise ConfigError(
            "tip_curvature",
            curvature_radius,
            f"at least the tip's radius, {radius:g} m, of a rounded tip",
            "choose the shape cone for a sharper one",
        )
    length = curvature_radius * math.asin(radius / curvature_radius)
    face = chain_of([(length, 1 / curvature_radius)])
    return Profile("rounded", face, 1 / curvature_radius)


def cone(radius: float, curvature_radius: float, half_angle: float) -> Profile:
    """Return a cone with a rounded apex.

    Args:
        radius: of the wire, where the cone ends.
        curvature_radius: of the apex.
        half_angle: between axis and side [rad].

    Raises:
        ConfigError: the apex is wider than the wire.
    """
    turn = math.pi / 2 - half_angle
    side_begins = curvature_radius * math.sin(turn)
    if side_begins >= radius:
        largest = radius / math.sin(turn)
        raise ConfigError(
            "tip_curvature", curvature_radius, f"below {largest:g} m, for a cone of this radius"
        )
    side = (radius - side_begins) / math.cos(turn)
    face = chain_of([(curvature_radius * turn, 1 / curvature_radius), (side, 0.0)])
    return Profile("cone", face, 1 / curvature_radius)


def cup(radius: float, cup_radius: float, edge_radius: float) -> Profile:
    """Return a tip with a hollow that is a part of a sphere, with a rounded rim.

    Args:
        radius: of the wire.
        cup_radius: of the hollow sphere.
        edge_radius: of curvature of the rim.

    Raises:
        ConfigError: hollow and rim do not fit into the wire.
    """
    # The rim, a circle about (radius - edge_radius, .), touches the hollow from inside the metal.
    if not edge_radius < radius < cup_radius:
        raise ConfigError(
            "cup_radius",
            cup_radius,
            f"above the tip's radius, {radius:g} m, which must exceed the edge's radius",
        )
    turn = math.asin((radius - edge_radius) / (cup_radius + edge_radius))
    hollow = (cup_radius * turn, -1 / cup_radius)
    rim = (edge_radius * (turn + math.pi / 2), 1 / edge_radius)
    return Profile("cup", chain_of([hollow, rim]), -1 / cup_radius)


def ring(radius: float, hole_radius: float, depth: float, edge_radius: float) -> Profile:
    """Return the end of a tube, with rounded edges.

    Args:
        radius: of the tube.
        hole_radius: of the hole.
        depth: of the hole.
        edge_radius: of curvature of both edges.

    Raises:
        ConfigError: the wall is thinner than both edges, or the hole is shallower.
    """
    largest = radius - 2 * edge_radius
    if hole_radius > largest or hole_radius <= 0:
        raise ConfigError(
            "hole_radius",
            hole_radius,
            f"above 0 and at most {largest:g} m, for a tube of {radius:g} m with rounded edges",
        )
    side = depth - edge_radius
    if side < 0:
        raise ConfigError("hole_depth", depth, f"at least the edge's radius, {edge_radius:g} m")
    quarter = edge_radius * math.pi / 2
    pieces = [
        (hole_radius, 0.0),
        (side, 0.0),
        (quarter, 1 / edge_radius),
        (radius - hole_radius - 2 * edge_radius, 0.0),
        (quarter, 1 / edge_radius),
    ]
    face = chain_of(pieces, start_z=depth, turns={1: -math.pi / 2})
    return Profile("ring", face, 0.0)


def read_profile(path: Path) -> Profile:
    """Return the profile in a table of points, from the axis to the wall.

    The header states the units: `r [um],z [um]`. Lines join the points; the curvature at the axis
    is that of the parabola through the points within a fifth of the tip's radius.

    Raises:
        UserError: the file cannot be read, or is no such table.
    """
    r, z = _read_points(path)
    remedy = f"correct {path}"
    if r[0] != 0:
        raise UserError(f"a profile must begin on the axis, at r = 0 (got {r[0]:g} m); {remedy}")
    if (np.diff(r) < 0).any() or r[-1] <= 0:
        raise UserError(f"r must not fall from one point of a profile to the next; {remedy}")
    lengths = np.hypot(np.diff(r), np.diff(z))
    if (lengths <= 0).any():
        raise UserError(f"two points of a profile must not be the same; {remedy}")
    if r[1] <= 0:
        raise UserError(
            "only the first point of a profile may lie on the axis, at r = 0 "
            f"(got the second there, too); {remedy}"
        )
    if not 1e-6 <= r[-1] <= 200e-6 or np.ptp(z) > 200e-6:
        raise UserError(
            f"a profile must be 1 to 200 um wide and at most 200 um high "
            f"(got {r[-1] * 1e6:g} um and {np.ptp(z) * 1e6:g} um); {remedy}, or its units"
        )

    is_near = (r <= max(r[-1] / 5, r[1])) & (r > 0)
    height = z - z[0]
    curvature = 2 * float((height * r**2)[is_near].sum() / (r**4)[is_near].sum())
    return Profile(path.stem, polyline(r, z), curvature)


def _read_points(path: Path) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Return the points (r, z) of a table [m]."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is no text"
        raise UserError(f"{path} cannot be read ({reason}); name a CSV file of points") from None

    rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].startswith("#")]
    n_points = len(rows) - 1
    if not 2 <= n_points <= MAX_POINTS:
        raise UserError(
            f"{path} must have a header and 2 to {MAX_POINTS} points (got {len(rows)} lines); "
            f"{_EXAMPLE}"
        )

    columns = _read_header(path, rows[0])
    points = [
        _read_point(path, number, row, columns) for number, row in enumerate(rows[1:], start=2)
    ]
    r, z = np.array(points).T
    return r, z


_EXAMPLE = "write a header such as `r [um],z [um]`, then a point a line"


class _Column(NamedTuple):
    """A column of a table of points."""

    place: int
    """Place in each row, from 0."""
    unit: float
    """Unit of its numbers [m]."""


def _read_header(path: Path, titles: list[str]) -> list[_Column]:
    """Return the columns of r and z."""
    columns = {}
    for index, title in enumerate(titles):
        name, _, unit = title.strip().removesuffix("]").partition("[")
        name = name.strip()
        unit = unit.strip()
        if name in ("r", "z") and unit not in UNITS:
            raise UserError(
                f"{path} must state the unit of {name}, one of {', '.join(UNITS)} "
                f"(got {shown(title)!r}); {_EXAMPLE}"
            )
        columns[name] = _Column(index, UNITS.get(unit, 1.0))

    if not {"r", "z"} <= set(columns):
        given = shown(", ".join(titles))
        raise UserError(f"{path} must have columns r and z (got {given}); {_EXAMPLE}")
    return [columns["r"], columns["z"]]


def _read_point(path: Path, number: int, row: list[str], columns: list[_Column]) -> list[float]:
    """Return the point (r, z) of a row of a table [m]; its number is for messages."""
    try:
        point = [float(row[column.place]) * column.unit for column in columns]
    except (ValueError, IndexError):
        point = [math.nan]
    if not all(map(math.isfinite, point)):
        raise UserError(f"row {number} of {path} is no point of two numbers; correct it")
    return point
