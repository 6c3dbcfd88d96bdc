"""Adhesion, voltages and search of tips against the laws, closed forms and limits."""

import math

import numpy as np
import pytest

from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage
from iswarm_mj.gripper.tips import shapes
from iswarm_mj.gripper.tips.adhesion import adhesion_radius, pull_ratio
from iswarm_mj.gripper.tips.forces import solve
from iswarm_mj.gripper.tips.search import Limits, cost_of, profile_of, search
from iswarm_mj.gripper.tips.voltages import Conditions, forces_of, misplaced, voltages_of

BALL = 20e-6
USUAL = Conditions(
    radius=BALL,
    density=7400.0,
    work_tool=1.41e-3,
    work_plate=14.7e-3,
    contact_gap=0.2e-6,
    reach=0.2e-6,
)
FLAT = shapes.flat(13e-6)


@pytest.mark.parametrize("curvature_radius", [13e-6, 30e-6, 100e-6])
def test_a_rounded_tip_adheres_by_its_curvature(curvature_radius):
    """2 pi W / (1 / R + 1 / R_c), as `iswarm grasp --tip-curvature` has it."""
    tip = shapes.rounded(13e-6, curvature_radius)
    expected = 1 / (1 / BALL + 1 / curvature_radius)
    assert adhesion_radius(tip, BALL, 1e-9) == pytest.approx(expected, rel=1e-3)
    assert adhesion_radius(tip, BALL, 0.2e-6) == pytest.approx(expected, rel=0.03)


def test_a_cup_adheres_more_by_its_curvature():
    tip = shapes.cup(16e-6, 40e-6, 1e-6)
    assert adhesion_radius(tip, BALL, 1e-9) == pytest.approx(1 / (1 / 20e-6 - 1 / 40e-6), rel=2e-3)


def test_a_ring_adheres_as_a_line_contact():
    """(3 pi / 4) W sqrt(2 r / z0) per length, times 2 pi r_c and the cosine of the normal."""
    tip = shapes.ring(13e-6, 6e-6, 5e-6, 2e-6)
    reach = 0.3e-9
    angle = math.asin(8 / 22)
    both = 1 / (1 / 20e-6 + 1 / 2e-6)
    per_length = 3 * math.pi / 4 * math.sqrt(2 * both / reach)
    force = per_length * 2 * math.pi * BALL * math.sin(angle) * math.cos(angle)
    assert 2 * math.pi * adhesion_radius(tip, BALL, reach) == pytest.approx(force, rel=0.01)


def test_a_flat_tip_has_the_voltages_of_the_laws():
    voltages = voltages_of(forces_of(FLAT, USUAL, 5e-6), USUAL)
    assert voltages.grasp == pytest.approx(grasp_voltage(BALL), rel=1e-3)
    assert voltages.release == pytest.approx(release_voltage(BALL), rel=1e-3)
    assert voltages.holds == pytest.approx(72.8, rel=0.01)


def test_adhesion_or_weight_alone_need_no_voltage():
    forces = forces_of(FLAT, USUAL, 5e-6, halvings=0)
    assert voltages_of(forces, USUAL._replace(work_plate=1e-6)).grasp == 0
    assert voltages_of(forces, USUAL._replace(work_tool=1e-6)).release == 0


def test_a_misplaced_ball_at_a_flat_tip_is_as_on_its_axis():
    forces = forces_of(FLAT, USUAL, 5e-6, halvings=0)
    beside = misplaced(FLAT, forces, USUAL, 2e-6)
    assert beside.adhesion_radius == pytest.approx(forces.adhesion_radius, rel=1e-3)
    assert beside.pick.force == pytest.approx(forces.pick.force, rel=2e-3)


def test_misplacements_that_vanish_change_nothing():
    tip = shapes.ring(13e-6, 6e-6, 5e-6, 2e-6)
    assert pull_ratio(tip, BALL, 0.2e-6, 1e-9) == pytest.approx(1, rel=5e-3)
    on_axis = adhesion_radius(tip, BALL, 0.2e-6)
    assert adhesion_radius(tip, BALL, 0.2e-6, 1e-9) == pytest.approx(on_axis, rel=5e-3)


def test_a_ball_beside_the_axis_of_a_sphere_has_the_gaps_of_two_spheres():
    """Beside the axis a sphere touches a sphere of another direction: adhesion is the same."""
    tip = shapes.rounded(13e-6, 30e-6)
    on_axis = adhesion_radius(tip, BALL, 0.05e-6)
    tilt = math.cos(math.asin(2 / 50))
    assert adhesion_radius(tip, BALL, 0.05e-6, 2e-6) == pytest.approx(on_axis * tilt, rel=2e-3)


def test_the_plane_capacitor_ratio_is_that_of_boundary_elements_between_two_tips():
    """Where both apply, on the axis: the pulls of a rounded and a flat tip differ alike."""
    rounded = shapes.rounded(13e-6, 30e-6)
    by_elements = (
        solve(rounded, BALL, 0.2e-6, "pick", 1).force / solve(FLAT, BALL, 0.2e-6, "pick", 1).force
    )
    by_curvature = 30 / 50
    assert by_elements == pytest.approx(by_curvature, rel=0.05)


def random_profiles(limits, count=60):
    rng = np.random.default_rng(3)
    return [profile_of(rng.uniform(0, 1, 2 * limits.arcs), limits) for _ in range(count)]


@pytest.mark.parametrize(
    "limits", [Limits(), Limits(curvature_radius=0.5e-6, radius=25e-6, arcs=8)]
)
def test_all_profiles_of_the_search_keep_the_limits_of_manufacture(limits):
    for profile in random_profiles(limits):
        r, _ = profile.points
        assert np.all(np.diff(r) >= -1e-15)
        assert r[-1] <= limits.radius * (1 + 1e-6)
        assert np.abs(profile.face.curvature).max() <= 1 / limits.curvature_radius * (1 + 1e-9)
        assert profile.face.end_heading[-1] == pytest.approx(math.pi / 2)
        jumps = profile.face.heading[1:] - profile.face.end_heading[:-1]
        assert np.abs(jumps).max() < 1e-9


def test_a_profile_that_ends_a_nanometre_before_the_greatest_radius_stays_within_it():
    limits = Limits(arcs=2)
    first_length = limits.radius - limits.curvature_radius - 1e-9
    length_number = math.log(first_length / 0.3e-6) / math.log(12 / 0.3)
    profile = profile_of(np.array([0.5, 0.5, length_number, 1.0]), limits)
    assert profile.radius == pytest.approx(limits.radius - 1e-9, rel=1e-9)


LEVEL = (0.5,) * 10
"""Numbers of a level profile, with a rounded edge of 2 um."""
RISING = (0.6,) * 10
"""Numbers of a profile that rises."""


@pytest.mark.parametrize("share", [0.5, 0.999])
def test_a_profile_above_the_greatest_height_costs_more_than_any_within(share):
    height = profile_of(np.array(RISING), Limits()).height
    weak = USUAL._replace(
        work_tool=1e-6
    )  # which costs 200 V for each time 8 that the hold is short
    makeable = cost_of(LEVEL, (weak,), 5e-6, Limits())
    assert makeable.cost > 2000
    too_high = cost_of(RISING, (USUAL,), 5e-6, Limits(height=share * height))
    assert too_high.cost > makeable.cost


def test_a_tip_that_never_releases_costs_less_than_one_that_cannot_be_made(monkeypatch):
    def endless(forces, conditions):
        voltages = voltages_of(forces, conditions)
        return voltages._replace(release=math.inf, release_field=math.inf)

    monkeypatch.setattr("iswarm_mj.gripper.tips.search.voltages_of", endless)
    candidate = cost_of(LEVEL, (USUAL,), 5e-6, Limits())
    assert candidate.voltage == math.inf
    assert candidate.cost < cost_of(RISING, (USUAL,), 5e-6, Limits(height=0.5e-6)).cost < math.inf


def test_a_search_for_misplaced_balls_counts_their_voltages_too():
    drawn = np.random.default_rng(8).uniform(0.35, 0.65, (6, 10))
    excess = []
    for numbers in map(tuple, drawn):
        on_axis = cost_of(numbers, (USUAL,), 5e-6, Limits())
        beside = cost_of(numbers, (USUAL,), 5e-6, Limits(misplacement=2e-6))
        excess.append(beside.voltage - on_axis.voltage)
    assert min(excess) >= 0
    assert max(excess) > 1


@pytest.mark.slow
def test_a_short_search_finds_a_better_tip_than_the_flat_one_and_repeats():
    found = [
        search((USUAL,), 5e-6, Limits(), generations=3, population=6, seed=4, workers=1)
        for _ in range(2)
    ]
    assert found[0] == found[1]
    best, history = found[0]
    assert best.voltage < 40
    assert history == sorted(history, reverse=True)
    assert history[-1] == best.cost
