"""What the solver needs of a contact, and one step of the solver at it: for one pair of bodies. Units: mm, mg, s, rad.

Each of one or two rows is a contact point. There the surfaces separate with velocity J v = n (v2 - v1) + lever w2 - arm
w1; arm and lever are the vector products of the point's position, seen from the first and the second centre, with the
normal n. H = J M^-1 J^T + R.
"""

import math
from typing import NamedTuple

from iswarm_mj.engines.contact_geometry import rectangle_contact, separation, wall_contact
from iswarm_mj.engines.planar.contact_law import ContactLaw, impedance, offset, regularisation, two_impulses
from iswarm_mj.engines.planar.kinds import Place, Table, Velocity, shared
from iswarm_mj.engines.planar.plane import Kind


class Touch(NamedTuple):
    """Two points where bodies may touch; a first body that does not move has no arms."""

    nx: float
    """Of the normal, from the first to the second body."""
    ny: float
    arm1: float
    arm2: float
    lever1: float
    lever2: float
    distance1: float
    """Of the surfaces at the first point, negative where they overlap."""
    distance2: float


class Rows(NamedTuple):
    """Rows of a contact, those that touch first; zero for others."""

    n_rows: int
    nx: float
    ny: float
    arm1: float
    arm2: float
    lever1: float
    lever2: float
    offset1: float
    offset2: float
    softness1: float
    """R of the first row."""
    softness2: float
    depth: float
    """Overlap at the deeper point."""


@shared
def gap_to_wall(p: Place, wall: int, solids: Table) -> float:
    """Distance of a robot's centre from a wall."""
    return solids[wall, 2] - solids[wall, 0] * p[0] - solids[wall, 1] * p[1]


@shared
def meets_wall(p: Place, wall: int, solids: Table, kind: Kind) -> bool:
    """Whether a body reaches beyond a wall."""
    gap = gap_to_wall(p, wall, solids)
    if gap >= kind.radius:
        return False
    nx, ny = solids[wall, 0], solids[wall, 1]
    return gap < kind.half_x * abs(p[2] * nx + p[3] * ny) + kind.half_y * abs(p[2] * ny - p[3] * nx)


@shared
def overlaps(p: Place, hx: float, hy: float, radius: float, q: Place, kind: Kind) -> bool:
    """Whether a body at q overlaps a rectangle at p with half edges (hx, hy), `radius` that of its circumcircle."""
    dx, dy = q[0] - p[0], q[1] - p[1]
    if dx * dx + dy * dy >= (radius + kind.radius) * (radius + kind.radius):
        return False
    gap, _ = separation(dx, dy, p[2], p[3], q[2], q[3], hx, hy, kind.half_x, kind.half_y)
    return gap < 0.0


@shared
def touch_wall(p: Place, wall: int, solids: Table, kind: Kind) -> Touch:
    """How a body touches a wall."""
    nx, ny = -solids[wall, 0], -solids[wall, 1]
    gap = gap_to_wall(p, wall, solids)
    x1, y1, d1, x2, y2, d2 = wall_contact(gap, nx, ny, p[2], p[3], kind.half_x, kind.half_y)
    return Touch(nx, ny, 0.0, 0.0, x1 * ny - y1 * nx, x2 * ny - y2 * nx, d1, d2)


@shared
def touch_box(p: Place, hx: float, hy: float, is_fixed: bool, q: Place, kind: Kind) -> Touch:
    """How a body at q touches another one, or an obstacle that is fixed, at p with half edges (hx, hy)."""
    dx, dy = q[0] - p[0], q[1] - p[1]
    nx, ny, x1, y1, d1, x2, y2, d2 = rectangle_contact(dx, dy, p[2], p[3], q[2], q[3], hx, hy, kind.half_x, kind.half_y)
    arm1, arm2 = x1 * ny - y1 * nx, x2 * ny - y2 * nx
    if is_fixed:
        arm1, arm2 = 0.0, 0.0
    return Touch(nx, ny, arm1, arm2, (x1 - dx) * ny - (y1 - dy) * nx, (x2 - dx) * ny - (y2 - dy) * nx, d1, d2)


@shared
def rows_of(touch: Touch, v1: Velocity, v2: Velocity, law: ContactLaw, inverse_weight: float, timestep: float) -> Rows:
    """Rows of a contact.

    Args:
        touch: where the bodies touch.
        v1: velocity of the first body before the step.
        v2: of the second one.
        law: of the contact.
        inverse_weight: see `regularisation` [1/mg].
        timestep: [s].
    """
    along = touch.nx * (v2[0] - v1[0]) + touch.ny * (v2[1] - v1[1])
    n_rows, depth = int(0), float(0.0)
    arm1, arm2, lever1, lever2 = float(0.0), float(0.0), float(0.0), float(0.0)
    offset1, offset2, softness1, softness2 = float(0.0), float(0.0), float(0.0), float(0.0)
    n_points = int(2)
    for point in range(n_points):  # at run time: unrolled, it would be the largest part of a GPU's program
        arm, lever, distance = float(touch.arm1), float(touch.lever1), float(touch.distance1)
        if point == 1:
            arm, lever, distance = float(touch.arm2), float(touch.lever2), float(touch.distance2)
        if distance < 0.0:
            depth = max(depth, -distance)
            d = impedance(distance, law)
            softness = regularisation(d, inverse_weight)
            shift = offset(d, distance, along + lever * v2[2] - arm * v1[2], law, timestep)
            if n_rows == 0:
                arm1, lever1, offset1, softness1 = arm, lever, shift, softness
            else:
                arm2, lever2, offset2, softness2 = arm, lever, shift, softness
            n_rows += 1
    return Rows(n_rows, touch.nx, touch.ny, arm1, arm2, lever1, lever2, offset1, offset2, softness1, softness2, depth)


_DIAGONAL, _EDGE = math.sqrt(0.5), math.sqrt(2.0) - 1.0
CREEP = 1e-4
"""Share of its free velocity with which a body creeps that MuJoCo's friction of a joint holds: (1 - d) / d of the
largest impedance d. In the plane four such rows share the load, which halves it."""


@shared
def held(kind: Kind, v: Velocity, x: float, y: float, turn: float) -> tuple[float, float, float]:
    """Impulses of the floor's friction on a body that stop it, as far as friction can [mg mm/s, mg mm^2/s].

    Those in the plane lie in a regular octagon, see `engines.arena`: if more would be needed, at its nearest point.

    Args:
        kind: of the body.
        v: its velocity with these impulses so far.
        x: impulse along x so far.
        y: along y.
        turn: about the vertical axis.
    """
    yields = 1.0 + 0.5 * CREEP
    ahead, left = (x - v[0] / kind.inverse_mass) / yields, (y - v[1] / kind.inverse_mass) / yields
    a, b, grip = abs(ahead), abs(left), float(kind.grip)
    slant = _DIAGONAL * (a + b)
    if max(a, b) <= slant and slant > grip:
        aside = min(max(_DIAGONAL * (b - a), -_EDGE * grip), _EDGE * grip)
        a, b = _DIAGONAL * (grip - aside), _DIAGONAL * (grip + aside)
    elif a > grip and a > slant:
        a, b = grip, min(b, _EDGE * grip)
    elif b > grip and b > slant:
        a, b = min(a, _EDGE * grip), grip
    if ahead < 0.0:
        a = -a
    if left < 0.0:
        b = -b
    turned = (turn - v[2] / kind.inverse_inertia) / (1.0 + CREEP)
    return a, b, min(max(turned, -kind.twist), kind.twist)


@shared
def matrix(rows: Rows, m1: float, i1: float, m2: float, i2: float) -> tuple[float, float, float]:
    """H: its first, mixed and second element [1/mg].

    Args:
        rows: of the contact.
        m1: inverse mass of the first body, 0 if it does not move.
        i1: inverse inertia of it.
        m2: likewise of the second body.
        i2: likewise.
    """
    return (
        m1 + m2 + i1 * rows.arm1 * rows.arm1 + i2 * rows.lever1 * rows.lever1 + rows.softness1,
        m1 + m2 + i1 * rows.arm1 * rows.arm2 + i2 * rows.lever1 * rows.lever2,
        m1 + m2 + i1 * rows.arm2 * rows.arm2 + i2 * rows.lever2 * rows.lever2 + rows.softness2,
    )


@shared
def relaxed(
    rows: Rows, h11: float, h12: float, h22: float, p1: float, p2: float, v1: Velocity, v2: Velocity
) -> tuple[float, float]:
    """Impulses of a contact that solve its own rows while all others stay [mg mm/s].

    Args:
        rows: of the contact.
        h11: of H, see `matrix`.
        h12: likewise.
        h22: likewise.
        p1: impulse of the first row so far.
        p2: of the second row.
        v1: velocity of the first body with the impulses so far.
        v2: of the second one.
    """
    along = rows.nx * (v2[0] - v1[0]) + rows.ny * (v2[1] - v1[1])
    w1 = along + rows.lever1 * v2[2] - rows.arm1 * v1[2] + rows.offset1 + rows.softness1 * p1
    w2 = along + rows.lever2 * v2[2] - rows.arm2 * v1[2] + rows.offset2 + rows.softness2 * p2
    return two_impulses(p1, p2, w1, w2, h11, h12, h22, rows.n_rows == 2)
