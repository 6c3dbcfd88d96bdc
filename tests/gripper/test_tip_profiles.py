"""Profiles of tips: geometry, the ball's seat, named shapes and tables of points."""

import math

import numpy as np
import pytest

from iswarm_mj.gripper.tips import shapes
from iswarm_mj.gripper.tips.profile import chain_of, seat_of
from iswarm_mj.utils.errors import ConfigError, UserError

BALL = 20e-6


def test_distances_from_arcs_of_either_sign_and_lines():
    chain = chain_of([(math.pi / 2, 1.0), (1.0, 0.0), (math.pi, -1.0)])
    rng = np.random.default_rng(1)
    r, z = rng.uniform(0, 4, (2, 200))
    dense = np.linspace(0, chain.total, 200_001)
    curve_r, curve_z = chain.at(dense)
    expected = [np.hypot(curve_r - x, curve_z - y).min() for x, y in zip(r, z, strict=True)]
    distance, place = chain.nearest(r, z)
    np.testing.assert_allclose(distance, expected, atol=1e-5)
    foot_r, foot_z = chain.at(place)
    np.testing.assert_allclose(np.hypot(foot_r - r, foot_z - z), distance, atol=1e-9)


@pytest.mark.parametrize(
    ("tip", "radius", "height"),
    [
        (shapes.flat(13e-6), 13e-6, 0.0),
        (shapes.rounded(13e-6, 30e-6), 13e-6, 30e-6 - math.sqrt(30**2 - 13**2) * 1e-6),
        (shapes.cup(13e-6, 30e-6, 1e-6), 13e-6, None),
        (
            shapes.cone(13e-6, 5e-6, math.pi / 4),
            13e-6,
            (5 * (1 - 0.5**0.5) + 13 - 5 * 0.5**0.5) * 1e-6,
        ),
        (shapes.ring(13e-6, 6e-6, 5e-6, 1e-6), 13e-6, 5e-6),
    ],
    ids=shapes.SHAPES,
)
def test_named_shapes_have_the_sizes_that_were_asked_for(tip, radius, height):
    assert tip.radius == pytest.approx(radius)
    if height is not None:
        assert tip.height == pytest.approx(height, abs=1e-12)
    ends_upwards = tip.face.end_heading[-1]
    assert ends_upwards <= math.pi / 2 + 1e-9


def test_a_ball_touches_a_convex_tip_on_the_axis():
    for tip in (shapes.flat(13e-6), shapes.rounded(13e-6, 30e-6), shapes.cup(13e-6, 30e-6, 1e-6)):
        seat = seat_of(tip, BALL)
        assert seat.is_point
        assert seat.height == pytest.approx(-BALL)


def test_a_ball_touches_a_ring_along_a_circle():
    """The edge's centre is at r = 7 um, 1 um above the face; the ball is 21 um from it."""
    seat = seat_of(shapes.ring(13e-6, 6e-6, 5e-6, 1e-6), BALL)
    assert seat.radius == pytest.approx(7e-6 * 20 / 21, rel=1e-4)
    assert seat.height == pytest.approx(1e-6 - math.sqrt(21**2 - 7**2) * 1e-6, rel=1e-6)
    assert math.sin(seat.angle) == pytest.approx(7 / 21, rel=1e-4)


def test_a_cup_narrower_than_the_ball_touches_at_its_rim():
    assert not seat_of(shapes.cup(13e-6, 15e-6, 0.5e-6), BALL).is_point


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_of_points_may_have_any_unit(tmp_path):
    micrometres = shapes.read_profile(
        write(tmp_path / "a.csv", "r [um],z [um]\n0,0\n5,0.5\n13,4\n")
    )
    metres = shapes.read_profile(
        write(tmp_path / "b.csv", "z [m],r [mm]\n0,0\n5e-7,5e-3\n4e-6,0.013\n")
    )
    assert micrometres.name == "a"
    assert micrometres.radius == pytest.approx(13e-6)
    np.testing.assert_allclose(metres.points, micrometres.points, atol=1e-15)


def test_the_curvature_of_points_on_a_sphere_is_that_of_the_sphere(tmp_path):
    r = np.linspace(0, 13, 40)
    z = 30 - np.sqrt(30**2 - r**2)
    rows = "\n".join(f"{x},{y}" for x, y in zip(r, z, strict=True))
    tip = shapes.read_profile(write(tmp_path / "a.csv", f"r [um],z [um]\n{rows}\n"))
    assert tip.apex_curvature == pytest.approx(1 / 30e-6, rel=0.01)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("r,z\n0,0\n1,1\n", "must state the unit of r, one of m, mm, um"),
        ("r [um],y [um]\n0,0\n1,1\n", "must have columns r and z"),
        ("r [um],z [um]\n1,0\n2,1\n", "must begin on the axis"),
        ("r [um],z [um]\n0,0\n5,1\n4,2\n", "must not fall"),
        ("r [um],z [um]\n0,0\n0,0\n4,2\n", "must not be the same"),
        ("r [um],z [um]\n0,0\n0,1\n13,1\n", "only the first point of a profile may lie on"),
        ("r [um],z [um]\n0,0\n5,x\n", "row 3 of"),
        ("r [um],z [um]\n0,0\n5,nan\n", "row 3 of"),
        ("r [um],z [um]\n0,0\n", "2 to 500 points"),
        ("r [m],z [m]\n0,0\n5,1\n", "1 to 200 um wide"),
        ("", "2 to 500 points"),
    ],
)
def test_a_bad_table_is_refused_in_one_sentence(tmp_path, text, sentence):
    with pytest.raises(UserError, match=sentence.replace("[", r"\[")) as error:
        shapes.read_profile(write(tmp_path / "a.csv", text))
    assert "\n" not in str(error.value)


def test_a_missing_table_is_refused(tmp_path):
    with pytest.raises(UserError, match="cannot be read"):
        shapes.read_profile(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: shapes.rounded(13e-6, 5e-6), "tip_curvature"),
        (lambda: shapes.cone(13e-6, 30e-6, math.pi / 6), "tip_curvature"),
        (lambda: shapes.cup(13e-6, 10e-6, 1e-6), "cup_radius"),
        (lambda: shapes.ring(13e-6, 12e-6, 5e-6, 1e-6), "hole_radius"),
        (lambda: shapes.ring(13e-6, 6e-6, 0.5e-6, 1e-6), "hole_depth"),
    ],
)
def test_shapes_that_do_not_exist_are_refused(make, field):
    with pytest.raises(ConfigError) as error:
        make()
    assert error.value.field == field
