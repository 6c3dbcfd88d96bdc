"""Forces of tips of any profile against closed forms, finite elements and limits."""

from itertools import pairwise

import numpy as np
import pytest
from support import finite_elements

from iswarm_mj.gripper.tips import shapes
from iswarm_mj.gripper.tips.forces import extrapolated_force, shape_factor, solve
from iswarm_mj.gripper.tips.profile import Profile, polyline
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY

BALL = 20e-6
TIPS = {
    "rounded": shapes.rounded(13e-6, 30e-6),
    "cone": shapes.cone(13e-6, 8e-6, np.radians(60)),
    "cup": shapes.cup(16e-6, 30e-6, 2e-6),
}
CASES = {"pick": 0.1, "release": 0.25}
"""Gap of each task, in radii of the ball."""
QUICK = {("rounded", "pick"), ("cone", "release"), ("cup", "pick"), ("ring", "release")}
"""Tips and tasks that are tested every day."""


def each_task(*names):
    """Return the parameters of a test: tips with both tasks."""
    pairs = [(name, task) for name in names for task in CASES]
    return [
        pytest.param(*pair, marks=[] if pair in QUICK else [pytest.mark.slow]) for pair in pairs
    ]


@pytest.mark.parametrize(("name", "task"), each_task(*TIPS))
def test_finite_elements_agree_to_one_percent(name, task):
    gap = CASES[task]
    upwards, n_triangles = finite_elements.force(TIPS[name], BALL, gap, task)
    force = upwards if task == "pick" else -upwards
    by_elements = extrapolated_force(TIPS[name], BALL, gap * BALL, task) / VACUUM_PERMITTIVITY
    assert n_triangles > 3000
    assert force == pytest.approx(by_elements, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("task", CASES)
def test_finite_elements_agree_for_a_flat_tip_at_small_gaps(task):
    tip = shapes.flat(13e-6)
    gap = CASES[task] / 5
    upwards, _ = finite_elements.force(tip, BALL, gap, task)
    by_elements = extrapolated_force(tip, BALL, gap * BALL, task) / VACUUM_PERMITTIVITY
    assert abs(upwards) == pytest.approx(by_elements, rel=0.01)


@pytest.mark.parametrize(("name", "task"), each_task(*TIPS, "ring"))
def test_extrapolated_forces_are_within_five_parts_in_ten_thousand(name, task):
    """Halving the elements once more changes 1 % at most, and the extrapolation 5e-4."""
    tip = TIPS.get(name) or shapes.ring(13e-6, 6e-6, 5e-6, 1e-6)
    gap = 0.2e-6 if task == "pick" else 5e-6
    forces = [solve(tip, BALL, gap, task, halvings).force for halvings in (0, 1, 2)]
    assert forces[0] == pytest.approx(forces[2], rel=0.01)
    coarse, fine = ((4 * b - a) / 3 for a, b in pairwise(forces))
    assert coarse == pytest.approx(fine, rel=5e-4)


def test_a_rounded_tip_attracts_like_two_spheres_at_small_gaps():
    """Derjaguin's limit: the factor on Eq. 2 tends to R_c / (R + R_c), from below."""
    factors = [shape_factor(TIPS["rounded"], BALL, gap * BALL, "pick") for gap in (4e-3, 1e-3)]
    limit = 30 / (20 + 30)
    assert abs(factors[1] / limit - 1) < abs(factors[0] / limit - 1) < 0.03
    assert factors[1] == pytest.approx(limit, rel=0.01)


def test_forces_depend_on_ratios_of_lengths_only():
    scaled = shapes.rounded(26e-6, 60e-6)
    for task, gap in CASES.items():
        force = solve(TIPS["rounded"], BALL, gap * BALL, task).force
        assert solve(scaled, 2 * BALL, gap * 2 * BALL, task).force == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize("task", CASES)
def test_lines_through_many_points_are_the_curve(task):
    tip = TIPS["rounded"]
    r, z = tip.face.at(np.linspace(0, tip.face.total, 300))
    r[0] = 0.0
    through_points = Profile("points", polyline(r, z), tip.apex_curvature)
    gap = CASES[task] * BALL
    force = solve(tip, BALL, gap, task, 1).force
    assert solve(through_points, BALL, gap, task, 1).force == pytest.approx(force, rel=1e-3)


def test_the_field_in_a_narrow_gap_is_the_voltage_over_the_gap():
    solution = solve(shapes.flat(13e-6), BALL, 0.2e-6, "pick", 1)
    assert solution.ball_field == pytest.approx(1 / 0.2e-6, rel=0.01)
    assert solution.tip_field == pytest.approx(1 / 0.2e-6, rel=0.01)
