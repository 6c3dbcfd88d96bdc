"""Numbers that the planar engine reads from a model, and models that it refuses."""

import math

import numpy as np
import pytest

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.planar.plane import Kind, read_kinds, read_plane
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

PAPERS_ROBOT = Kind(
    half_x=1,
    half_y=1,
    radius=math.sqrt(2),
    inverse_mass=0.1,
    inverse_inertia=0.15,
    inverse_weight=1 / 15,
    drive_x=1,
    drive_y=1,
    drive_yaw=1,
    friction_impulse=0,
    friction_angular_impulse=0,
    first_point=0,
)


def arena_with(change=None, n_robots=2):
    """Return a compiled arena whose model a function has changed."""
    arena = compile_arena(SwarmConfig(), n_robots, np.zeros(0))
    if change is not None:
        change(arena.model, arena)
    return arena


def test_numbers_are_those_of_the_robot():
    arena = arena_with()
    plane = read_plane(arena)
    assert read_kinds(arena) == (pytest.approx(PAPERS_ROBOT),)
    assert plane.largest_radius == pytest.approx(math.sqrt(2))
    assert plane.half_extent == pytest.approx(24.5 * RD)
    assert plane.timestep == pytest.approx(0.05)


@pytest.mark.parametrize("read", [read_plane, read_kinds])
def test_one_robot_stands_for_all_of_its_kind(read):
    of_one = np.hstack(read(arena_with(n_robots=1)))
    of_five = np.hstack(read(arena_with(n_robots=5)))
    np.testing.assert_allclose(of_one, of_five, rtol=1e-12)


def set_array(name, value, index_in):
    """Return a change of an array of the model, at an index that a function finds in the arena."""

    def change(model, arena):
        getattr(model, name)[index_in(arena)] = value

    return change


def second_hull(arena):
    """Return the geom of the second robot's hull."""
    return arena.hull[1]


def second_body(arena):
    """Return the body of the second robot."""
    return arena.body[1]


def second_slide_along_x(arena):
    """Return the address of the second robot's joint x."""
    return arena.qpos[1, 0]


def third_wall(arena):
    """Return the geom of the third wall."""
    return arena.walls[2]


REFUSED = {
    "condim 1": set_array("geom_condim", 3, second_hull),
    "same margin": set_array("geom_margin", 0.1, second_hull),
    "gap": set_array("geom_gap", 0.1, second_hull),
    "two positive or of two negative numbers": set_array("geom_solref", 0.2, second_hull),
    "same solref": set_array("geom_solref", -100.0, second_hull),
    "same solimp": set_array("geom_solimp", 0.5, second_hull),
    "same solmix": set_array("geom_solmix", 2.0, second_hull),
    "same priority": set_array("geom_priority", 1, third_wall),
    "adhesion": set_array("geom_adhesion", 1.0, second_hull),
    "centre of mass": set_array("body_ipos", 0.1, second_body),
    "same mass of a robot along x and y": set_array("dof_M0", 20.0, second_slide_along_x),
    "collide with each other": set_array("geom_contype", 0, second_hull),
}
"""Changes of a model, by the requirement that they break."""


@pytest.mark.parametrize(("requirement", "change"), REFUSED.items(), ids=REFUSED.keys())
def test_models_that_it_cannot_simulate_are_refused(requirement, change):
    message = f"planar engine requires .*{requirement}.*; .* engine mujoco or mjx"
    with pytest.raises(UserError, match=message):
        read_plane(arena_with(change))
