"""What the robots of a model have in common, read from MuJoCo's model as plain numbers."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.engines.planar.contact_law import ContactLaw
from iswarm_mj.engines.planar.requirements import check_model
from iswarm_mj.utils.obstacles import Obstacle, numbers
from iswarm_mj.utils.units import RD

_MIN_VALUE = mujoco.mjMINVAL
_IMPEDANCE = (mujoco.mjMINIMP, mujoco.mjMAXIMP)


FINEST = 2e-5
"""Tolerance with which robots end a control step in jams within 0.0001 mm of where more sweeps put them [mm/s]. 32-bit
floats reach a fifth of it."""


class Plane(NamedTuple):
    """Robots that slide and turn in the plane between walls. Units: mm, mg, s."""

    half_x: float
    """Half the length of a robot's hull."""
    half_y: float
    """Half its width."""
    radius: float
    """Of its circumcircle."""
    inverse_mass: float
    inverse_inertia: float
    """About the vertical axis [1/(mg mm^2)]."""
    servo: tuple[float, float, float]
    """Share of the difference to its set point by which the servo of x, y or yaw changes a velocity in a step."""
    edge: float
    """Half the edge of the square around the walls, whose cells robots are sorted into."""
    n_walls: int
    """Number of walls, W; see `solids_of`."""
    timestep: float
    """Of this engine [s]."""
    refinement: int
    """Its time steps in a physics step of the drive's configuration."""
    between_robots: ContactLaw
    at_walls: ContactLaw
    tolerance: float = FINEST
    """Largest change of a velocity by a contact in the last sweep of the contact solver [mm/s]."""
    max_sweeps: int = 20_000
    """Sweeps after which the contact solver has failed."""


def read_plane(arena: ArenaModel, tolerance: float = FINEST) -> Plane:
    """Read what moves the robots of a compiled arena and keeps them apart.

    Args:
        arena: compiled; any number of its robots stands for all.
        tolerance: of the contact solver [mm/s]; `FINEST` at least.

    Raises:
        UserError: the model has features that this engine does not simulate.
    """
    check_model(arena)
    model, body, hull = arena.model, arena.body[0], arena.hull[0]
    inertia, h = model.dof_M0[arena.qpos[0]], model.opt.timestep
    weight = float(model.body_invweight0[body, 0])
    gain_x, gain_y, gain_yaw = (arena.servo_gain * h / inertia).tolist()
    half_x, half_y, _ = model.geom_size[hull].tolist()
    return Plane(
        half_x=half_x,
        half_y=half_y,
        radius=math.sqrt(half_x * half_x + half_y * half_y),
        inverse_mass=float(1 / inertia[0]),
        inverse_inertia=float(1 / inertia[2]),
        servo=(gain_x, gain_y, gain_yaw),
        edge=float(arena.extent),
        n_walls=len(arena.walls),
        timestep=float(h),
        refinement=arena.refinement,
        between_robots=_law(model, hull, hull, 2 * weight),
        at_walls=_law(model, hull, arena.walls[0], weight),
        tolerance=max(tolerance, FINEST),
    )


def solids_of(arena: ArenaModel, obstacles: Sequence[Obstacle]) -> Float[np.ndarray, "WM 6"]:
    """Return what stands still: walls, see `utils.walls.half_planes`, and then obstacles, see `numbers` [mm]."""
    return np.vstack([np.pad(arena.planes, ((0, 0), (0, 3))), numbers(obstacles, RD)])


def _law(model: mujoco.MjModel, first: int, second: int, inverse_weight: float) -> ContactLaw:
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
        inverse_weight=inverse_weight,
    )
