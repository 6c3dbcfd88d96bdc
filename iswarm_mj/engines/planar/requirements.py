"""Which models the planar engine simulates as MuJoCo does."""

from collections.abc import Iterator

import mujoco
import numpy as np

from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.utils.errors import UserError

MIN_HEIGHT = 0.7
"""Of robots [mm]; see `PlanarEngine`."""
_NEEDED = ("CONSTRAINT", "CONTACT", "REFSAFE", "DAMPER")  # features that must not be disabled
_UNKNOWN = ("OVERRIDE", "DIAGEXACT", "IPC", "SLEEP")  # those that must not be enabled


def check_model(arena: ArenaModel) -> None:
    """Check what `read_robot` leaves open: options of the model, masses, contacts and walls.

    Raises:
        UserError: something is not simulated here.
    """
    for requirement, holds in [*_options(arena), *_robots(arena), *_contacts(arena), *_walls(arena)]:
        if not holds:
            raise UserError(
                f"the planar engine requires {requirement}; change the model, or use the engine mujoco or mjx."
            )


def _options(arena: ArenaModel) -> Iterator[tuple[str, bool]]:
    option = arena.model.opt
    disabled = {n for n in _NEEDED if option.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{n}")}
    enabled = {n for n in _UNKNOWN if option.enableflags & getattr(mujoco.mjtEnableBit, f"mjENBL_{n}")}
    yield "the Euler integrator", option.integrator == mujoco.mjtIntegrator.mjINT_EULER
    yield "explicit damping, with eulerdamp disabled", bool(option.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    yield f"the feature {', '.join(disabled).lower()} to be enabled", not disabled
    yield f"the feature {', '.join(enabled).lower()} to be disabled", not enabled
    yield (
        "no density, viscosity or horizontal gravity",
        not any([option.density, option.viscosity, *option.gravity[:2]]),
    )


def _robots(arena: ArenaModel) -> Iterator[tuple[str, bool]]:
    model, n = arena.model, arena.n_robots
    dofs, size = model.dof_M0[arena.qpos[:n]], model.geom_size[arena.hull[:n]]
    first = np.searchsorted(arena.kind, arena.kind)  # robot of each one's kind
    yield "the centre of mass on the robots' axis", not model.body_ipos[arena.body[:n], :2].any()
    yield (
        f"robots at least {MIN_HEIGHT} mm high, since they overlap by up to that, and MuJoCo lifts lower ones then",
        bool((2 * model.geom_size[arena.hull, 2] >= MIN_HEIGHT).all()),
    )
    alike = np.allclose(dofs, dofs[first]) and np.isclose(dofs[:, 0], dofs[:, 1]).all()
    yield "one size, mass and inertia of all robots of a kind", bool(alike and (size == size[first]).all())


def _contacts(arena: ArenaModel) -> Iterator[tuple[str, bool]]:
    model, hulls, n = arena.model, arena.hull, arena.n_robots
    solid = np.concatenate([hulls, arena.walls, arena.obstacles])
    collides = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    yield "contacts of hulls, boxes, walls and obstacles alone", set(collides) == set(solid)
    types, affinities = model.geom_contype[solid], model.geom_conaffinity[solid]
    meet = (types[:, None] & affinities) | (affinities[:, None] & types)
    yield "hulls that collide with each other and with walls", bool(meet[: len(hulls)].all())
    yield "contacts without friction, condim 1", bool((model.geom_condim[solid] == 1).all())
    yield "contacts without margin and gap", not (model.geom_margin[solid].any() or model.geom_gap[solid].any())
    yield "contacts without adhesion", not model.geom_adhesion[solid].any()
    yield "a positive solref, time constant and damping ratio", bool((model.geom_solref[solid] > 0).all())
    for same in (hulls[:n], arena.walls):
        for name in ("solref", "solimp", "solmix", "priority"):
            values = getattr(model, f"geom_{name}")[same]
            yield f"the same {name} for all hulls and for all walls", bool((values == values[0]).all())
    for name in ("solref", "solimp", "solmix"):
        values = getattr(model, f"geom_{name}")[np.concatenate([arena.walls[:1], arena.obstacles])]
        yield f"the same {name} for walls and obstacles", bool((values == values[0]).all())
    yield "the same priority for hulls and walls", len(set(model.geom_priority[solid])) == 1


def _walls(arena: ArenaModel) -> Iterator[tuple[str, bool]]:
    model, walls = arena.model, arena.walls
    matrix = np.empty((len(walls), 9))
    for row, wall in zip(matrix, walls, strict=True):
        mujoco.mju_quat2Mat(row, model.geom_quat[wall])
    inward = np.pad(-arena.planes[:, :2], ((0, 0), (0, 1)))
    distance = -(model.geom_pos[walls] * inward).sum(axis=1)
    yield "planes as walls", bool((model.geom_type[walls] == mujoco.mjtGeom.mjGEOM_PLANE).all())
    yield (
        "walls where the configuration has them",
        bool(np.allclose(matrix[:, 2::3], inward) and np.allclose(distance, arena.planes[:, 2])),
    )
