"""Contact points of rectangles, against MuJoCo's and closed forms. Units: mm."""

import mujoco
import numpy as np
import pytest
from support.overlaps import corners_of

from iswarm_mj.engines.contact_geometry import (
    APART,
    X_OF_FIRST,
    Rectangle,
    rectangle_contact,
    separation,
    wall_contact,
)

MARGIN = 0.4
"""Distance of the surfaces below which MuJoCo has contacts, half of it the margin of each geom."""
WALL_X = 8.0
"""Place of the wall."""
SQUARE = Rectangle(x=0.0, y=0.0, cos=1.0, sin=0.0, half_x=1.0, half_y=1.0)

shapes = pytest.mark.parametrize(
    "half_edges",
    [(1.0, 1.0), (1.4, 0.6)],
    ids=["square", "long"],
)

BODY = """
<body pos="0 0 0.5">
  <joint type="slide" axis="1 0 0"/>
  <joint type="slide" axis="0 1 0"/>
  <joint type="hinge" axis="0 0 1"/>
  <geom type="box" size="{half_x} {half_y} 0.5"/>
</body>
"""
WALL = f'<geom type="plane" size="0 0 1" pos="{WALL_X} 0 0" zaxis="-1 0 0"/>'
DEFAULT = f'<default><geom condim="1" margin="{MARGIN / 2}"/></default>'


class Scene:
    """Boxes 1 mm high with these half edges, and a wall, in MuJoCo."""

    def __init__(self, *boxes):
        bodies = [BODY.format(half_x=half_x, half_y=half_y) for half_x, half_y in boxes]
        world = f"<worldbody>{WALL}{''.join(bodies)}</worldbody>"
        world = f"<mujoco>{DEFAULT}{world}</mujoco>"
        self.model = mujoco.MjModel.from_xml_string(world)
        self.data = mujoco.MjData(self.model)

    def contacts(self, *poses):
        """Return rows x, y, distance of all contacts, sorted, and the normal of the first."""
        self.data.qpos[:] = np.concatenate(poses)
        mujoco.mj_forward(self.model, self.data)
        rows = [rounded(*contact.pos[:2], contact.dist) for contact in self.data.contact]
        normal = self.data.contact[0].frame[:2] if rows else None
        return np.array(sorted(rows)).reshape(-1, 3), normal


def rounded(x, y, distance):
    """Return numbers of a contact that sort alike whatever their last digits."""
    return tuple(np.round((x, y, distance), 9))


def at_both_rims(centre, points):
    """Return points within the margin, once for each rim, from the world's origin, sorted.

    Args:
        centre: x and y from which points are seen.
        points: x, y and distance of one point, then of the other.
    """
    rows = []
    for x, y, distance in (points[:3], points[3:]):
        if distance < MARGIN:
            rows += [rounded(centre[0] + x, centre[1] + y, distance)] * 2
    return np.array(sorted(rows)).reshape(-1, 3)


def rectangle(centre, yaw, half_edges):
    """Return the rectangle with this yaw."""
    return Rectangle(*centre, np.cos(yaw), np.sin(yaw), *half_edges)


@pytest.mark.parametrize("second_half_edges", [None, (2.5, 0.3)], ids=["alike", "different"])
@shapes
def test_contacts_of_rectangles_are_those_of_mujoco(half_edges, second_half_edges):
    """They overlap, or are apart by less than the margin; every tenth pair is parallel.

    MuJoCo has none between corners, and pushes boxes apart vertically that are deeper in each other than they are high.
    """
    second_half_edges = second_half_edges or half_edges
    scene = Scene(half_edges, second_half_edges)
    rng = np.random.default_rng(1)
    first = np.array([0.3, -0.2])
    n_overlapping = 0
    n_apart = 0
    n_at_corners = 0
    for trial in range(3000):
        second = rng.uniform(-2.8, 2.8, 2)
        first_yaw, second_yaw = rng.uniform(-np.pi, np.pi, 2)
        if trial % 10 == 0:
            second_yaw = first_yaw + rng.integers(4) * np.pi / 2
        first_hull = rectangle(first, first_yaw, half_edges)
        second_hull = rectangle(second, second_yaw, second_half_edges)
        gap, _ = separation(first_hull, second_hull)
        if gap < -0.95:
            continue

        expected, normal = scene.contacts([*first, first_yaw], [*second, second_yaw])
        normal_x, normal_y, *points = rectangle_contact(first_hull, second_hull)
        if points[-1] == APART:
            n_at_corners += 1
            assert len(expected) == 0
            continue

        actual = at_both_rims(first, points)
        assert len(actual) == len(expected)
        if len(expected):
            np.testing.assert_allclose((normal_x, normal_y), normal, atol=1e-9)
            np.testing.assert_allclose(actual, expected, atol=1e-7)
            n_overlapping += gap < 0
            n_apart += gap > 0
    assert n_overlapping > 500
    assert n_apart > 100
    assert n_at_corners > 5


@shapes
def test_contacts_with_walls_are_those_of_mujoco(half_edges):
    """Every tenth rectangle is parallel to the wall."""
    scene = Scene(half_edges, half_edges)
    far_away = [-30, 0, 0]
    rng = np.random.default_rng(2)
    for trial in range(500):
        centre = rng.uniform(6, 8.3), -0.2
        is_turned = trial % 10 > 0
        yaw = rng.uniform(-np.pi, np.pi) if is_turned else rng.integers(4) * np.pi / 2
        hull = rectangle(centre, yaw, half_edges)

        _, _, *points = wall_contact(WALL_X - centre[0], -1.0, 0.0, hull)
        expected, _ = scene.contacts([*centre, yaw], far_away)
        np.testing.assert_allclose(at_both_rims(centre, points), expected, atol=1e-7)


@shapes
def test_contacts_between_corners_are_at_the_nearest_points(half_edges):
    """Those of many points on both outlines; the normal leads from one to the other."""
    rng = np.random.default_rng(4)
    n_at_corners = 0
    for _ in range(3000):
        poses = rng.uniform([-1.9, -1.9, -4], [1.9, 1.9, 4], (2, 3))
        first, second = (rectangle(pose[:2], pose[2], half_edges) for pose in poses)
        contact = rectangle_contact(first, second)
        gap, _ = separation(first, second)
        if contact.distance2 != APART or gap < 0:
            continue

        n_at_corners += 1
        corners = np.array([corners_of(pose, half_edges) for pose in poses])
        between = corners[1][None] - corners[0][:, None]
        distances = np.hypot(between[..., 0], between[..., 1])
        i, j = np.unravel_index(distances.argmin(), distances.shape)
        nearest = between[i, j]
        assert contact.distance1 == pytest.approx(distances[i, j])
        normal = (contact.normal_x, contact.normal_y)
        np.testing.assert_allclose(normal, nearest / distances[i, j], atol=1e-9)
        middle = corners[0, i] + nearest / 2 - poses[0, :2]
        np.testing.assert_allclose((contact.x1, contact.y1), middle, atol=1e-9)

        # No side is nearer than the corners.
        edges = np.linspace(corners, np.roll(corners, 1, axis=1), 40)
        outlines = np.moveaxis(edges, 0, 1).reshape(2, -1, 2)
        apart = np.linalg.norm(outlines[0][:, None] - outlines[1][None], axis=-1)
        assert apart.min() > contact.distance1 - 1e-9
    assert n_at_corners > 20


@pytest.mark.parametrize(("x", "y"), [(2.0, 2.0), (-2.0, 2.0), (2.0, -2.0)])
def test_corners_that_coincide_have_the_normal_of_a_side(x, y):
    """Between points that coincide there is no direction, and a contact without one holds nothing."""
    contact = rectangle_contact(SQUARE, SQUARE._replace(x=x, y=y))
    assert contact.distance1 == 0.0
    assert {abs(contact.normal_x), abs(contact.normal_y)} == {0.0, 1.0}
    assert contact.normal_x * x + contact.normal_y * y == 2.0


def test_gaps_by_hand():
    """Two squares side by side, one turned by 45 degrees, and two that overlap."""
    c = np.sqrt(0.5)
    diagonal = SQUARE._replace(y=3, cos=c, sin=c)
    turned_left = SQUARE._replace(x=0.2, y=1.9, cos=0, sin=1)
    assert separation(SQUARE, SQUARE._replace(x=2.5, y=0.3)) == (0.5, X_OF_FIRST)
    gap, _ = separation(SQUARE, diagonal)
    np.testing.assert_allclose(gap, 2 - np.sqrt(2))
    gap, _ = separation(SQUARE, turned_left)
    assert gap == pytest.approx(-0.1)


def test_sides_that_meet_flat_touch_at_the_ends_of_their_overlap():
    normal_x, normal_y, *points = rectangle_contact(SQUARE, SQUARE._replace(x=1.9, y=0.6))
    assert (normal_x, normal_y) == (1, 0)
    ends = sorted([points[:3], points[3:]])
    np.testing.assert_allclose(ends, [(0.95, -0.4, -0.1), (0.95, 1.0, -0.1)])
