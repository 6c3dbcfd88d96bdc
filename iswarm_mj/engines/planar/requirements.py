"""Requirements on a model that the planar engine simulates as MuJoCo does."""

from collections.abc import Iterator

import numpy as np

from iswarm_mj.engines.arena import ArenaModel
from iswarm_mj.utils.errors import UserError

MIN_HEIGHT = 0.7
"""Least height of robots [mm]; see `PlanarEngine`."""


def check_model(arena: ArenaModel) -> None:
    """Check what `read_robot` leaves open of the robots' files: masses and contacts.

    Raises:
        UserError: the model has features that the planar engine does not simulate.
    """
    for requirement, holds in [*_masses(arena), *_contacts(arena)]:
        if not holds:
            remedy = "change the model, or use the engine mujoco or mjx"
            raise UserError(f"the planar engine requires {requirement}; {remedy}.")


def _masses(arena: ArenaModel) -> Iterator[tuple[str, bool]]:
    """Yield each requirement on masses and heights, and whether the model meets it."""
    model = arena.model
    n_robots = arena.n_robots
    off_axis = model.body_ipos[arena.body[:n_robots], :2]
    yield "the centre of mass on the robots' axis", not off_axis.any()

    heights = 2 * model.geom_size[arena.hull, 2]
    reason = "since they overlap by up to that, and MuJoCo lifts lower ones then"
    is_high = bool((heights >= MIN_HEIGHT).all())
    yield f"robots at least {MIN_HEIGHT} mm high, {reason}", is_high

    mass_along_x, mass_along_y = model.dof_M0[arena.qpos[:n_robots, :2]].T
    yield (
        "the same mass of a robot along x and y",
        bool(np.isclose(mass_along_x, mass_along_y).all()),
    )


def _contacts(arena: ArenaModel) -> Iterator[tuple[str, bool]]:
    """Yield each requirement on contacts, and whether the model meets it."""
    model = arena.model
    hulls = arena.hull
    solids = np.concatenate([hulls, arena.walls])
    types = model.geom_contype[solids]
    affinities = model.geom_conaffinity[solids]
    collide = (types[:, None] & affinities) | (affinities[:, None] & types)
    yield "hulls that collide with each other and with walls", bool(collide[: len(hulls)].all())

    yield "contacts without friction, condim 1", bool((model.geom_condim[hulls] == 1).all())
    yield "contacts without gap", not model.geom_gap[solids].any()
    yield "contacts without adhesion", not model.geom_adhesion[hulls].any()

    # One law for all bodies, and one for bodies and solids.
    # MuJoCo replaces a solref of one positive and one negative number by its default.
    is_positive = model.geom_solref[solids] > 0
    has_one_format = bool((is_positive == is_positive[0, 0]).all())
    yield "a solref of two positive or of two negative numbers, one format for all", has_one_format
    for name in ("solref", "solimp", "solmix", "margin"):
        values = getattr(model, f"geom_{name}")[hulls[: arena.n_robots]]
        yield f"the same {name} for all hulls", bool((values == values[0]).all())
    yield "the same priority for hulls and walls", len(set(model.geom_priority[solids])) == 1
