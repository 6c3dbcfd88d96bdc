"""MuJoCo's contact law: its own numbers, and what complementarity demands. Units: mm, mg, s."""

import itertools

import mujoco
import numpy as np
import pytest

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.planar.contact_law import impedance, offset, regularisation, two_impulses, velocity_change
from iswarm_mj.engines.planar.plane import read_kinds, read_plane

SOFTNESS = {
    "as the robots'": ([0.2, 1.0], [0.99, 0.99, 0.01, 0.5, 2.0]),
    "time constant below two steps": ([0.01, 0.7], [0.95, 0.95, 0.0, 0.5, 2.0]),
    "impedance that grows": ([0.3, 1.3], [0.6, 0.97, 0.3, 0.3, 3.0]),
    "linearly": ([0.25, 1.0], [0.5, 0.9, 0.2, 0.5, 1.0]),
}


@pytest.mark.parametrize(("solref", "solimp"), SOFTNESS.values(), ids=SOFTNESS.keys())
@pytest.mark.parametrize("overlap", [0.003, 0.07, 0.25])
def test_rows_are_those_of_mujoco(solref, solimp, overlap):
    """Two robots and a wall; the walls keep their own softness, with which the robots' is mixed."""

    def tune(spec):
        for geom in spec.geoms:
            if geom.name.endswith("hull"):
                geom.solref, geom.solimp, geom.solmix = solref, solimp, 3.0

    arena = compile_arena(SwarmConfig(), 2, np.zeros(0), tune=tune)
    plane, model, weight = read_plane(arena), arena.model, read_kinds(arena)[0].inverse_weight
    data = mujoco.MjData(model)
    data.qpos[arena.qpos] = [(plane.edge - 1 + overlap, 0, 0), (plane.edge - 3 + 2 * overlap, 0.3, 0)]
    data.qvel[arena.qpos] = [(0.8, 0.1, 0.4), (1.3, -0.2, -0.3)]
    mujoco.mj_forward(model, data)
    assert data.ncon == 8
    velocity = np.zeros(data.nefc)
    mujoco.mj_mulJacVec(model, data, velocity, data.qvel)
    for contact in data.contact:
        is_at_wall = contact.geom[0] in arena.walls
        row, law = contact.efc_address, plane.at_walls if is_at_wall else plane.between_robots
        d, distance = impedance(contact.dist, law), contact.dist
        np.testing.assert_allclose(d, data.efc_KBIP[row, 2], rtol=1e-12)
        np.testing.assert_allclose(
            regularisation(d, weight if is_at_wall else 2 * weight), data.efc_R[row] / 2, rtol=1e-9
        )
        shift = offset(d, distance, velocity[row], law, plane.timestep)
        np.testing.assert_allclose(shift, -(velocity[row] + plane.timestep * data.efc_aref[row]), rtol=1e-9, atol=1e-12)


def test_two_rows_are_solved_exactly():
    """Of all four sets of rows that may push, the one that contradicts nothing."""
    rng = np.random.default_rng(3)
    pushing = set()
    for _ in range(500):
        root, w = rng.normal(size=(2, 2)), rng.normal(size=2)
        matrix = root @ root.T + 0.01 * np.eye(2)
        before = rng.exponential(size=2) * rng.integers(0, 2, size=2)
        p = np.array(two_impulses(*before, *(w + matrix @ before), matrix[0, 0], matrix[0, 1], matrix[1, 1], True))
        left = w + matrix @ p
        assert (p >= 0).all() and (left >= -1e-9).all()
        np.testing.assert_allclose(p * left, 0, atol=1e-9)
        pushing.add(tuple((p > 0).tolist()))
    assert pushing == set(itertools.product([False, True], repeat=2))


def test_velocity_changes_by_hand():
    """Of points on the circumcircles of bodies with other masses and arms: the fastest of them, somewhere around."""
    rng, around = np.random.default_rng(4), np.exp(1j * np.linspace(0, 2 * np.pi, 3601))
    first_is_faster = []
    for _ in range(100):
        impulses, arms, levers = rng.normal(size=(3, 2))
        changes, given = [], []
        for arm in (arms, levers):
            mass, inertia, radius = rng.uniform(0.1, 2.0, 3)
            changes.append(np.abs(mass * impulses.sum() + 1j * inertia * radius * (arm @ impulses) * around).max())
            given += [mass, inertia * radius]
        first_is_faster.append(changes[0] > changes[1])
        assert velocity_change(*impulses, *arms, *levers, *given) == pytest.approx(max(changes), rel=1e-5)
    assert 20 < sum(first_is_faster) < 80


@pytest.mark.parametrize(("w", "impulse"), [(-3.0, 3.5), (1.0, 1.5), (5.0, 0.0)])
def test_one_row_is_solved_whatever_the_second_says(w, impulse):
    """w + 2 (q - 2) = 0, unless the impulse q would be negative."""
    assert two_impulses(2.0, 0.0, w, -7.0, 2.0, 0.3, 1.0, False) == (impulse, 0.0)
