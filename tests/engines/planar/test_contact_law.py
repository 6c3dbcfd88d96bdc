"""MuJoCo's contact law: MuJoCo's own numbers, and complementarity. Units: mm, mg, s."""

import itertools

import mujoco
import numpy as np
import pytest

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.planar.contact_law import (
    impedance,
    offset,
    regularisation,
    two_impulses,
    velocity_change,
)
from iswarm_mj.engines.planar.plane import read_kinds, read_plane

SOFTNESS = {
    "as the robots'": ([-5.0, -9.9], [1e-4, 0.99, 0.35, 0.5, 2.0]),
    "constant": ([0.2, 1.0], [0.99, 0.99, 0.01, 0.5, 2.0]),
    "time constant below two steps": ([0.01, 0.7], [0.95, 0.95, 0.0, 0.5, 2.0]),
    "impedance that grows": ([0.3, 1.3], [0.6, 0.97, 0.3, 0.3, 3.0]),
    "linearly": ([-30.0, -2.0], [0.5, 0.9, 0.2, 0.5, 1.0]),
}
"""MuJoCo's `solref` and `solimp` of the robots."""
SOLREF_OF_WALLS = {True: [0.17, 0.9], False: [-7.0, -8.0]}
"""MuJoCo's `solref` of walls, by whether it is a time constant and a damping ratio."""
N_CONTACTS = 8
"""Contact points of MuJoCo at two pairs of sides that are near each other: four each."""


@pytest.mark.parametrize(("solref", "solimp"), SOFTNESS.values(), ids=SOFTNESS.keys())
@pytest.mark.parametrize("overlap", [-0.3, -0.06, 0.003, 0.07, 0.25])
def test_rows_are_those_of_mujoco(solref, solimp, overlap):
    """Two robots and a wall; walls keep their own softness, with which the robots' is mixed."""

    def tune(spec):
        for geom in spec.geoms:
            if geom.name.endswith("hull"):
                geom.solref = solref
                geom.solimp = solimp
                geom.solmix = 3.0
                geom.margin = 0.2
            elif geom.name.startswith("wall"):
                geom.solref = SOLREF_OF_WALLS[solref[0] > 0]

    arena = compile_arena(SwarmConfig(), 2, np.zeros(0), tune=tune)
    model = arena.model
    plane = read_plane(arena)
    inverse_weight = read_kinds(arena)[0].inverse_weight

    # One robot in the wall, the other one in the first.
    data = mujoco.MjData(model)
    wall = plane.half_extent
    data.qpos[arena.qpos] = [(wall - 1 + overlap, 0, 0), (wall - 3 + 2 * overlap, 0.3, 0)]
    data.qvel[arena.qpos] = [(0.8, 0.1, 0.4), (1.3, -0.2, -0.3)]
    mujoco.mj_forward(model, data)
    velocity = np.zeros(data.nefc)
    mujoco.mj_mulJacVec(model, data, velocity, data.qvel)
    assert data.ncon == N_CONTACTS

    for contact in data.contact:
        row = contact.efc_address
        is_at_wall = contact.geom[0] in arena.walls
        law = plane.law_of_solids if is_at_wall else plane.law_of_bodies
        d = impedance(contact.dist, law)
        np.testing.assert_allclose(d, data.efc_KBIP[row, 2], rtol=1e-12)

        # Each of our rows stands for two of MuJoCo's.
        weight = inverse_weight if is_at_wall else 2 * inverse_weight
        np.testing.assert_allclose(regularisation(d, weight), data.efc_R[row] / 2, rtol=1e-9)

        row_offset = offset(d, contact.dist, velocity[row], law, plane.timestep)
        expected = -(velocity[row] + plane.timestep * data.efc_aref[row])
        np.testing.assert_allclose(row_offset, expected, rtol=1e-9, atol=1e-12)


def test_two_rows_are_solved_exactly():
    """Impulses and velocities are complementary, for each of the four sets of rows that push."""
    rng = np.random.default_rng(3)
    pushing_sets = set()
    for _ in range(500):
        root = rng.normal(size=(2, 2))
        w = rng.normal(size=2)
        matrix = root @ root.T + 0.01 * np.eye(2)
        before = rng.exponential(size=2) * rng.integers(0, 2, size=2)
        w_before = w + matrix @ before
        elements = matrix[0, 0], matrix[0, 1], matrix[1, 1]
        impulses = np.array(two_impulses(*before, *w_before, *elements, True))

        left_side = w + matrix @ impulses
        assert (impulses >= 0).all()
        assert (left_side >= -1e-9).all()
        np.testing.assert_allclose(impulses * left_side, 0, atol=1e-9)
        pushing_sets.add(tuple((impulses > 0).tolist()))
    assert pushing_sets == set(itertools.product([False, True], repeat=2))


@pytest.mark.parametrize(("w", "impulse"), [(-3.0, 3.5), (1.0, 1.5), (5.0, 0.0)])
def test_one_row_is_solved_whatever_the_second_says(w, impulse):
    """w + 2 (q - 2) = 0, unless the impulse q would be negative."""
    assert two_impulses(2.0, 0.0, w, -7.0, 2.0, 0.3, 1.0, False) == (impulse, 0.0)


def test_velocity_changes_of_the_fastest_point():
    """It is the fastest of many points on the circumcircles of two bodies that push each other."""
    rng = np.random.default_rng(4)
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 3601))
    first_is_faster = []
    for _ in range(100):
        impulses, *arms_of_bodies = rng.normal(size=(3, 2))
        expected = []
        changes = []
        for arms in arms_of_bodies:
            inverse_mass, inverse_inertia, radius = rng.uniform(0.1, 2.0, 3)
            push = impulses.sum()
            moment = arms @ impulses
            turn = inverse_inertia * radius
            velocities = inverse_mass * push + 1j * turn * moment * circle
            expected.append(np.abs(velocities).max())
            changes.append(velocity_change(push, moment, inverse_mass, turn))

        first_is_faster.append(expected[0] > expected[1])
        assert max(changes) == pytest.approx(max(expected), rel=1e-5)
    assert 20 < sum(first_is_faster) < 80
