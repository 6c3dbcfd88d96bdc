"""Which robots the planar engine simulates as MuJoCo does."""

from collections.abc import Iterator

import numpy as np

from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.utils.errors import UserError

MIN_HEIGHT = 0.7
"""Of robots [mm]; see `PlanarEngine`."""


def check_model(arena: ArenaModel) -> None:
    """Check what `read_robot` leaves open of the robots' files: masses and contacts.

    Raises:
        UserError: something is not simulated here.
    """
    for requirement, holds in [*_masses(arena), *_contacts(arena)]:
        if not holds:
            raise UserError(
                f"the planar engine requires {requirement}; change the model, or use the engine mujoco or mjx."
            )


def _masses(arena: ArenaModel) -> Iterator[tuple[str, bool]]:
    model, n = arena.model, arena.n_robots
    yield "the centre of mass on the robots' axis", not model.body_ipos[arena.body[:n], :2].any()
    yield (
        f"robots at least {MIN_HEIGHT} mm high, since they overlap by up to that, and MuJoCo lifts lower ones then",
        bool((2 * model.geom_size[arena.hull, 2] >= MIN_HEIGHT).all()),
    )
    x, y = model.dof_M0[arena.qpos[:n, :2]].T
    yield "the same mass of a robot along x and y", bool(np.isclose(x, y).all())


def _contacts(arena: ArenaModel) -> Iterator[tuple[str, bool]]:
    model, hulls, n = arena.model, arena.hull, arena.n_robots
    solid = np.concatenate([hulls, arena.walls])
    types, affinities = model.geom_contype[solid], model.geom_conaffinity[solid]
    meet = (types[:, None] & affinities) | (affinities[:, None] & types)
    yield "hulls that collide with each other and with walls", bool(meet[: len(hulls)].all())
    yield "contacts without friction, condim 1", bool((model.geom_condim[hulls] == 1).all())
    yield "contacts without margin and gap", not (model.geom_margin[hulls].any() or model.geom_gap[hulls].any())
    yield "contacts without adhesion", not model.geom_adhesion[hulls].any()
    yield "a positive solref, time constant and damping ratio", bool((model.geom_solref[hulls] > 0).all())
    for name in ("solref", "solimp", "solmix"):
        values = getattr(model, f"geom_{name}")[hulls[:n]]
        yield f"the same {name} for all hulls", bool((values == values[0]).all())
    yield "the same priority for hulls and walls", len(set(model.geom_priority[solid])) == 1
