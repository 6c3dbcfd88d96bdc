"""The kinds of bodies of a model, and what they have in common, read from MuJoCo's model as plain numbers."""

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
_IMPEDANCE = (mujoco.mjMINIMP, mujoco.mjMAXIMP)


FINEST = 2e-5
"""Tolerance with which robots end a control step in jams within 0.0001 mm of where more sweeps put them [mm/s]. 32-bit
floats reach a fifth of it."""


class Kind(NamedTuple):
    """What a body is: its hull, its mass, how it is driven, how it rubs on the floor. Units: mm, mg, s."""

    half_x: float
    """Half the length of its hull."""
    half_y: float
    """Half its width."""
    radius: float
    """Of its circumcircle."""
    inverse_mass: float
    inverse_inertia: float
    """About the vertical axis [1/(mg mm^2)]."""
    inverse_weight: float
    """Its translational `invweight0`, MuJoCo's estimate of J M^-1 J^T [1/mg]."""
    drive_x: float
    """Share of the difference to its set point by which its drive changes a velocity in a step; 0 without a drive."""
    drive_y: float
    drive_yaw: float
    grip: float
    """Largest impulse of the floor's friction in a step [mg mm/s], see `contact_rows.held`; 0 without friction."""
    twist: float
    """Its largest moment of momentum [mg mm^2/s]."""
    points: int
    """Of a robot, the row in `reception.points_of` at which the places of its LEDs begin."""


FIXED = Kind(*[0.0] * 11, points=0)
"""Walls, obstacles and floor, as one body."""


class Plane(NamedTuple):
    """What bodies that slide and turn in the plane between walls have in common. Units: mm, mg, s."""

    radius: float
    """Of the circumcircle of the largest robot."""
    edge: float
    """Half the edge of the square around the walls, whose cells robots are sorted into."""
    n_walls: int
    """Number of walls, W; see `solids_of`."""
    timestep: float
    """Of this engine [s]."""
    refinement: int
    """Its time steps in a physics step of the drive's configuration."""
    between_robots: ContactLaw
    """Of robots and boxes with each other."""
    at_walls: ContactLaw
    tolerance: float = FINEST
    """Largest change of a velocity by a contact in the last sweep of the contact solver [mm/s]."""
    max_sweeps: int = 20_000
    """Sweeps after which the contact solver has failed."""


def read_plane(arena: ArenaModel, tolerance: float = FINEST) -> Plane:
    """Read what keeps the bodies of a compiled arena apart.

    Args:
        arena: compiled; one robot of each kind stands for all.
        tolerance: of the contact solver [mm/s]; `FINEST` at least.

    Raises:
        UserError: the model has features that this engine does not simulate.
    """
    check_model(arena)
    model, hull = arena.model, arena.hull[0]
    return Plane(
        radius=arena.robot.circumradius,
        edge=float(arena.extent),
        n_walls=len(arena.walls),
        timestep=float(model.opt.timestep),
        refinement=arena.refinement,
        between_robots=_law(model, hull, hull),
        at_walls=_law(model, hull, arena.walls[0]),
        tolerance=max(tolerance, FINEST),
    )


def read_kinds(arena: ArenaModel) -> tuple[Kind, ...]:
    """Read the kinds of a compiled arena: those of its robots, and of each box."""
    first = [arena.kind.tolist().index(kind) for kind in range(len(arena.robot.kinds))]
    bodies = [*first, *range(arena.n_robots, len(arena.hull))]
    return tuple(_kind(arena, body, number) for number, body in enumerate(bodies))


def of_bodies(kinds: tuple[Kind, ...], robot: Robots, n_robots: int) -> list[Kind]:
    """Return the kinds (N + M + 1,) of N robots, of the boxes and of all that is fixed."""
    robots = [kinds[kind] for kind in robot.kind_of(n_robots).tolist()]
    return [*robots, *kinds[len(robot.kinds) :], FIXED]


@lru_cache(maxsize=16)  # each step needs it
def table_of(kinds: tuple[Kind, ...], robot: Robots, n_robots: int) -> np.ndarray:
    """Return `of_bodies` as records, not to be changed."""
    return np.array([tuple(kind) for kind in of_bodies(kinds, robot, n_robots)], KIND)


KIND = np.dtype([(name, {float: np.float64, int: np.int64}[kind]) for name, kind in Kind.__annotations__.items()])


def _kind(arena: ArenaModel, body: int, number: int) -> Kind:
    """Kind of a robot or a box, by its number in `read_kinds`."""
    model, dofs, h = arena.model, arena.qpos[body], arena.model.opt.timestep
    inertia, (half_x, half_y, _) = model.dof_M0[dofs], model.geom_size[arena.hull[body]].tolist()
    radius = math.sqrt(half_x * half_x + half_y * half_y)
    drive = (arena.servo_gain[body] * h / inertia).tolist()
    along, _, about = (model.dof_frictionloss[dofs] * h).tolist()
    return Kind(
        half_x=half_x,
        half_y=half_y,
        radius=radius,
        inverse_mass=float(1 / inertia[0]),
        inverse_inertia=float(1 / inertia[2]),
        inverse_weight=float(model.body_invweight0[arena.body[body], 0]),
        drive_x=drive[0],
        drive_y=drive[1],
        drive_yaw=drive[2],
        grip=along * (1.0 + math.sqrt(2.0)),
        twist=about,
        points=5 * len(arena.robot.sides) * number if body < arena.n_robots else 0,
    )


def solids_of(arena: ArenaModel, obstacles: Sequence[Obstacle]) -> Float[np.ndarray, "WM 6"]:
    """Return what stands still: walls, see `utils.walls.half_planes`, and then obstacles, see `numbers` [mm]."""
    return np.vstack([np.pad(arena.planes, ((0, 0), (0, 3))), numbers(obstacles, RD)])


def solids_with(
    solids: Array, poses: Float[Array, "B M 3"], kinds: tuple[Kind, ...], robot: Robots
) -> Float[Array, "B WOM 6"]:
    """Return what light meets beside robots in B worlds: walls and obstacles (W + O, 6), and boxes at these poses."""
    halves = np.reshape([kind[:2] for kind in kinds[len(robot.kinds) :]], (-1, 2))
    return with_poses(solids, poses, halves)


def _law(model: mujoco.MjModel, first: int, second: int) -> ContactLaw:
    """Law of the contacts of two geoms whose solver parameters MuJoCo mixes by `solmix`."""
    solmix = model.geom_solmix[[first, second]]
    share = solmix[0] / solmix.sum() if solmix.sum() > 0 else 0.5
    time_constant, damping_ratio = share * model.geom_solref[first] + (1 - share) * model.geom_solref[second]
    solimp = share * model.geom_solimp[first] + (1 - share) * model.geom_solimp[second]
    low, high, midpoint = np.clip(solimp[[0, 1, 3]], *_IMPEDANCE).tolist()
    time_constant = max(time_constant, 2 * model.opt.timestep)  # refsafe
    return ContactLaw(
        stiffness=float(1 / max(_MIN_VALUE, (high * time_constant * damping_ratio) ** 2)),
        damping=float(2 / max(_MIN_VALUE, high * time_constant)),
        min_impedance=low,
        max_impedance=high,
        width=float(max(0.0, solimp[2])),
        midpoint=midpoint,
        power=float(max(1.0, solimp[4])),
    )
