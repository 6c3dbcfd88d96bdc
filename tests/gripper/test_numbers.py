"""Functions of numbers, compiled by numba, traced by JAX and run by Python: the same results from one source."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.gripper import contact
from iswarm_mj.gripper.laws import spline
from iswarm_mj.gripper.laws.capacitance import tables
from iswarm_mj.gripper.laws.numbers import in_arrays, numbers_of
from iswarm_mj.gripper.laws.probe_table import probe_factor
from iswarm_mj.gripper.native.fields import compiled

SPLINES, AXES = tables()
CASES = {
    "adhesion_force": lambda r: (r(0.01, 0.02), r(0, 1e-19, True), r(1e-5, 3e-5), r(-1e-9, 1e-8)),
    "rebound_ratio": lambda r: (
        *(r(0.01, 0.2), r(7e3, 8e3), r(1e-5, 3e-5), r(1e-3, 2e-2)),
        *(r(0, 1), r(0, 1e8, True), r(0, 5e10, True)),
    ),
    "speed_at_contact": lambda r: (r(-0.1, 0.1), r(-0.1, 0.1), r(0, 90), r(0, 90)),
    "rebounds_on": lambda r: (r(-1, 1) > 0, float(r(-1, 1) > 0), r(-0.01, 0.04), r(-0.01, 0.04)),
    "ball_voltage": lambda r: (r(-1, 1) > 0, r(-9, 9), float(r(-1, 1) > 0), r(0, 60), (r(1, 9), r(1, 9)), r(-1, 1)),
    "is_broken": lambda r: (r(-90, 90), r(-0.1, 0.4), float(r(-1, 1) > 0), 0.2, 70.0),
    "relaxed_charge": lambda r: (
        *(r(-9, 9), r(0, 60), r(0, 60)),
        (r(1, 9), r(1, 9)),
        r(0, 9, True),
        r(0, 9, True),
        1e-3,
    ),
    "next_potential": lambda r: (
        *(r(-1, 1) > 0, float(r(-1, 1) > 0), r(-60, 60), r(-60, 60)),
        *((r(-0.1, 0.4), r(-1, 1)), 0.2, 1.0),
    ),
}
"""Arguments of each function of `contact`, drawn by a function of limits; some are zero now and then."""


@pytest.mark.parametrize("name", CASES)
def test_contacts_are_the_same_in_every_compiler(name):
    random = np.random.default_rng(0)

    def draw(low, high, is_sometimes_zero=False):
        return 0.0 if is_sometimes_zero and random.random() < 0.3 else float(random.uniform(low, high))

    in_numba, in_jax = numbers_of(contact, {}, compiled), in_arrays(contact, jnp)
    rows = [CASES[name](draw) for _ in range(200)]
    by_python = [float(getattr(contact, name)(*row)) for row in rows]
    by_numba = [float(getattr(in_numba, name)(*row)) for row in rows]
    with jax.enable_x64(True):
        columns = jax.tree.map(lambda *values: jnp.array(values), *rows)
        by_jax = jax.vmap(getattr(in_jax, name))(*columns)
    np.testing.assert_allclose(by_numba, by_python, rtol=1e-13)
    np.testing.assert_allclose(by_jax, by_python, rtol=1e-12)
    assert len(np.unique(by_python)) > 1


@pytest.mark.parametrize("task", [0, 1])
def test_shapes_are_those_of_the_laws(task):
    """Whose capacitances broadcast; the gap may be below the least one, and beyond the table's edge."""
    random = np.random.default_rng(1)
    gaps, probe = random.uniform(-0.1, 20, 50), random.uniform(2, 60, 50)
    in_numba = numbers_of(spline, {}, compiled)
    found = [in_numba.shape_of(task, 20.0, gap, 0.2, r, SPLINES, AXES) for gap, r in zip(gaps, probe, strict=True)]
    law = in_arrays(spline, np).shape_of(task, 20.0, gaps, 0.2, probe, SPLINES, AXES)
    np.testing.assert_allclose(np.array(found), np.transpose(law), rtol=1e-12)
    factor = probe_factor(("pick", "release")[task], np.maximum(gaps, 0.2) / 20, probe / 20)
    np.testing.assert_allclose(law[0], factor, rtol=1e-12)
    far, edge = (spline.shape_of(task, 20.0, gap, 0.2, 13.0, SPLINES, AXES)[0] for gap in (1e3, 80.0))
    assert far == pytest.approx(edge, rel=1e-12)
