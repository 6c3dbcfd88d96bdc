"""What the planar engine reads from a model, and which models it refuses."""

import math

import numpy as np
import pytest

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.planar.plane import read_kinds, read_plane
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD


def arena_with(change=None, n_robots=2):
    arena = compile_arena(SwarmConfig(), n_robots, np.zeros(0))
    if change is not None:
        change(arena.model, arena)
    return arena


def test_numbers_are_those_of_the_robot():
    plane, kinds = read_plane(arena_with()), read_kinds(arena_with())
    assert kinds == (pytest.approx((1, 1, math.sqrt(2), 0.1, 0.15, 1 / 15, 1, 1, 1, 0, 0, 0)),)
    assert (plane.radius, plane.edge, plane.timestep) == pytest.approx((math.sqrt(2), 24.5 * RD, 0.1))


def test_one_robot_stands_for_all():
    """Of each kind."""
    for read in (read_plane, read_kinds):
        one, five = (np.hstack(read(arena_with(n_robots=n))) for n in (1, 5))
        np.testing.assert_allclose(one, five, rtol=1e-12)


def set_array(name, value, which):
    def change(model, arena):
        getattr(model, name)[which(arena)] = value

    return change


def hull(arena):
    return arena.hull[1]


def joint(arena):
    return arena.qpos[1, 0]


REFUSED = {
    "condim 1": set_array("geom_condim", 3, hull),
    "margin": set_array("geom_margin", 0.1, hull),
    "gap": set_array("geom_gap", 0.1, hull),
    "positive solref": set_array("geom_solref", -100.0, hull),
    "same solimp": set_array("geom_solimp", 0.5, hull),
    "same solmix": set_array("geom_solmix", 2.0, hull),
    "same priority": set_array("geom_priority", 1, lambda arena: arena.walls[2]),
    "adhesion": set_array("geom_adhesion", 1.0, hull),
    "centre of mass": set_array("body_ipos", 0.1, lambda arena: arena.body[1]),
    "same mass of a robot along x and y": set_array("dof_M0", 20.0, joint),
    "collide with each other": set_array("geom_contype", 0, hull),
}


@pytest.mark.parametrize(("says", "change"), REFUSED.items(), ids=REFUSED.keys())
def test_models_that_it_cannot_simulate_are_refused(says, change):
    with pytest.raises(UserError, match=f"planar engine requires .*{says}.*; .* engine mujoco or mjx"):
        read_plane(arena_with(change))
