"""Kinds of bodies, and what all bodies share, read from MuJoCo's model as plain numbers."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.engines.planar.requirements import check_model
from iswarm_mj.geometry.obstacles import Obstacle, numbers, with_poses
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import RD

_MIN_VALUE = mujoco.mjMINVAL
_IMPEDANCE_LIMITS = (mujoco.mjMINIMP, mujoco.mjMAXIMP)

FINEST = 2e-5
"""Finest tolerance of the contact solver [mm/s].

With it, robots in jams end a control step within 0.0001 mm of where more sweeps put them. 32-bit
floats reach a fifth of it."""


class Kind(NamedTuple):
    """Kind of a body: its hull, mass, drive and friction on the floor. Units: mm, mg, s."""

    half_x: float
    """Half the length of the hull."""
    half_y: float
    """Half the width of the hull."""
    radius: float
    """Radius of the hull's circumcircle."""
    inverse_mass: float
    """Inverse mass [1/mg]."""
    inverse_inertia: float
    """Inverse inertia about the vertical axis [1/(mg mm^2)]."""
    inverse_weight: float
    """Translational `invweight0`, MuJoCo's estimate of J M^-1 J^T [1/mg]."""
    drive_x: float
    """Share of the difference to its set point by which the drive changes a velocity in a step.

    It is 0 without a drive."""
    drive_y: float
    """Share along y."""
    drive_yaw: float
    """Share about the vertical axis."""
    friction_impulse: float
    """Largest impulse of the floor's friction in a step, 0 without friction [mg mm/s].

    It is the incircle's radius of the octagon in `contact_rows.floor_friction`."""
    friction_angular_impulse: float
    """Largest angular impulse of the floor's friction in a step [mg mm^2/s]."""
    first_point: int
    """First row of a robot's kind in `reception.points_of`; 0 for boxes."""


FIXED = Kind(*[0.0] * 11, first_point=0)
"""Walls, obstacles and floor, as one body."""


class Plane(NamedTuple):
    """Arena: what bodies that slide and turn in the plane between walls share. Units: mm, mg, s."""

    largest_radius: float
    """Radius of the largest robot's circumcircle."""
    half_extent: float
    """Half the edge of the square around the walls, into whose cells robots are sorted."""
    n_walls: int
    """Number W of walls; see `solids_of`."""
    timestep: float
    """Time step of this engine [s]."""
    refinement: int
    """Number of its time steps in a physics step of the drive's configuration."""
    law_of_bodies: ContactLaw
    """Law of the contacts of robots and boxes with each other."""
    law_of_solids: ContactLaw
    """Law of their contacts with walls and obstacles."""
    corners_collide: bool = True
    """Bodies whose nearest features are corners have a contact, which they have not in MuJoCo."""
    tolerance: float = FINEST
    """Largest change of a velocity by a contact in the last sweep of the contact solver [mm/s]."""
    max_sweeps: int = 20_000
    """Number of sweeps after which the contact solver has failed."""


def read_plane(arena: ArenaModel, tolerance: float = FINEST) -> Plane:
    """Read what the bodies of a compiled arena share.

    Args:
        arena: compiled; one robot of each kind stands for all.
        tolerance: tolerance of the contact solver, raised to `FINEST` if it is less [mm/s].

    Raises:
        UserError: the model has features that this engine does not simulate.
    """
    check_model(arena)
    model = arena.model
    hull = arena.hull[0]
    return Plane(
        largest_radius=arena.robot.circumradius,
        half_extent=float(arena.half_extent),
        n_walls=len(arena.walls),
        timestep=float(model.opt.timestep),
        refinement=arena.refinement,
        law_of_bodies=_law(model, hull, hull),
        law_of_solids=_law(model, hull, arena.walls[0]),
        tolerance=max(tolerance, FINEST),
    )


def plane_in_parts(plane: Plane, parts: int) -> Plane:
    """Return the plane with a shorter time step, in which contacts are as quick in steps.

    Args:
        plane: the plane with its own time step.
        parts: number of short time steps in it.
    """
    if parts == 1:
        return plane

    def in_parts(law: ContactLaw) -> ContactLaw:
        return law._replace(stiffness=law.stiffness * parts**2, damping=law.damping * parts)

    return plane._replace(
        timestep=plane.timestep / parts,
        law_of_bodies=in_parts(plane.law_of_bodies),
        law_of_solids=in_parts(plane.law_of_solids),
    )


def kinds_in_parts(kinds: tuple[Kind, ...], parts: int) -> tuple[Kind, ...]:
    """Return kinds for a time step in parts, in which drives still reach their set points."""
    return tuple(
        kind._replace(
            friction_impulse=kind.friction_impulse / parts,
            friction_angular_impulse=kind.friction_angular_impulse / parts,
        )
        for kind in kinds
    )


def read_kinds(arena: ArenaModel) -> tuple[Kind, ...]:
    """Read the kinds of a compiled arena: those of its robots, and one of each box."""
    kind_of_body = arena.kind.tolist()
    first_robots = [kind_of_body.index(kind) for kind in range(len(arena.robot.kinds))]
    boxes = range(arena.n_robots, len(arena.hull))
    return tuple(_kind(arena, body, number) for number, body in enumerate([*first_robots, *boxes]))


def of_bodies(kinds: tuple[Kind, ...], robot: Robots, n_robots: int) -> list[Kind]:
    """Return the kinds (N + M + 1,) of N robots, of M boxes and of all that is fixed."""
    robots = [kinds[kind] for kind in robot.kind_of(n_robots).tolist()]
    boxes = kinds[len(robot.kinds) :]
    return [*robots, *boxes, FIXED]


@lru_cache(maxsize=16)  # each step needs it
def table_of(kinds: tuple[Kind, ...], robot: Robots, n_robots: int, parts: int = 1) -> np.ndarray:
    """Return `of_bodies` for a time step in parts as records, which must not be changed."""
    bodies = of_bodies(kinds_in_parts(kinds, parts), robot, n_robots)
    return np.array([tuple(kind) for kind in bodies], KIND)


_DTYPES = {float: np.float64, int: np.int64}
KIND = np.dtype([(name, _DTYPES[field]) for name, field in Kind.__annotations__.items()])
"""Record of a `Kind`."""


def _kind(arena: ArenaModel, body: int, number: int) -> Kind:
    """Read the kind of a robot or a box; `number` is its index in `read_kinds`."""
    model = arena.model
    timestep = model.opt.timestep
    dofs = arena.qpos[body]
    inertia = model.dof_M0[dofs]
    half_x, half_y, _ = model.geom_size[arena.hull[body]].tolist()
    drive_x, drive_y, drive_yaw = (arena.servo_gain[body] * timestep / inertia).tolist()

    # Along each axis or diagonal, the joint there and the two at 45 degrees to it add up.
    friction, _, yaw_friction = (model.dof_frictionloss[dofs] * timestep).tolist()
    return Kind(
        half_x=half_x,
        half_y=half_y,
        radius=math.sqrt(half_x * half_x + half_y * half_y),
        inverse_mass=float(1 / inertia[0]),
        inverse_inertia=float(1 / inertia[2]),
        inverse_weight=float(model.body_invweight0[arena.body[body], 0]),
        drive_x=drive_x,
        drive_y=drive_y,
        drive_yaw=drive_yaw,
        friction_impulse=friction * (1.0 + math.sqrt(2.0)),
        friction_angular_impulse=yaw_friction,
        first_point=5 * len(arena.robot.sides) * number if body < arena.n_robots else 0,
    )


def solids_of(arena: ArenaModel, obstacles: Sequence[Obstacle]) -> Float[np.ndarray, "WM 6"]:
    """Return what stands still: walls, then obstacles [mm].

    See `geometry.walls.half_planes` and `geometry.obstacles.numbers`.
    `kinds.wall_of` and `kinds.obstacle_of` read its rows.
    """
    walls = np.pad(arena.planes, ((0, 0), (0, 3)))
    return np.vstack([walls, numbers(obstacles, RD)])


def solids_with(
    solids: Array, poses: Float[Array, "B M 3"], kinds: tuple[Kind, ...], robot: Robots
) -> Float[Array, "B WOM 6"]:
    """Return what light meets in B worlds beside robots: walls, obstacles and boxes.

    Args:
        solids: (W + O, 6) walls and obstacles, see `solids_of`.
        poses: x, y [mm] and yaw [rad] of the boxes.
        kinds: kinds of the robots and of each box, see `read_kinds`.
        robot: geometry of the robots.
    """
    boxes = kinds[len(robot.kinds) :]
    half_edges = np.reshape([(box.half_x, box.half_y) for box in boxes], (-1, 2))
    return with_poses(solids, poses, half_edges)


def _law(model: mujoco.MjModel, first: int, second: int) -> ContactLaw:
    """Return the law of two geoms, whose impedances and time constants MuJoCo mixes by `solmix`."""
    solmix = model.geom_solmix[[first, second]]
    share = solmix[0] / solmix.sum() if solmix.sum() > 0 else 0.5
    solimp = share * model.geom_solimp[first] + (1 - share) * model.geom_solimp[second]
    low, high, midpoint = np.clip(solimp[[0, 1, 3]], *_IMPEDANCE_LIMITS).tolist()
    solrefs = model.geom_solref[[first, second]]
    if (solrefs > 0).all():
        time_constant, damping_ratio = share * solrefs[0] + (1 - share) * solrefs[1]
        time_constant = max(time_constant, 2 * model.opt.timestep)  # MuJoCo's flag refsafe
        stiffness = 1 / max(_MIN_VALUE, (high * time_constant * damping_ratio) ** 2)
        damping = 2 / max(_MIN_VALUE, high * time_constant)
    else:
        # Of two solrefs of negative numbers MuJoCo takes the lesser ones.
        stiffness, damping = -solrefs.min(axis=0) / [high**2, high]
    return ContactLaw(
        stiffness=float(stiffness),
        damping=float(damping),
        margin=float(model.geom_margin[[first, second]].sum()),
        min_impedance=low,
        max_impedance=high,
        width=float(max(0.0, solimp[2])),
        midpoint=midpoint,
        power=float(max(1.0, solimp[4])),
    )
