"""Contact points of rectangles, against MuJoCo's, closed forms and brute force. Units: mm."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.distance import pdist

from iswarm_mj.engines.contact_geometry import rectangle_contact, separation, wall_contact
from iswarm_mj.engines.planar.near_pairs import near_pairs

WALL_X = 8.0
"""Place of the wall."""
SEARCH_RADIUS = 4.0
"""Distance of two centres up to which they are near."""
UNIT_SQUARES = (1.0, 1.0, 1.0, 1.0)
"""Half edges of two squares."""

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
  <geom type="box" size="{half_x} {half_y} 0.5" condim="1"/>
</body>
"""
WALL = f'<geom type="plane" size="0 0 1" pos="{WALL_X} 0 0" zaxis="-1 0 0" condim="1"/>'


class Scene:
    """Boxes 1 mm high with these half edges, and a wall, in MuJoCo."""

    def __init__(self, *boxes):
        bodies = [BODY.format(half_x=half_x, half_y=half_y) for half_x, half_y in boxes]
        world = f"<mujoco><worldbody>{WALL}{''.join(bodies)}</worldbody></mujoco>"
        self.model = mujoco.MjModel.from_xml_string(world)
        self.data = mujoco.MjData(self.model)

    def contacts(self, *poses):
        """Rows x, y, distance of all contacts, sorted, and the normal of the first."""
        self.data.qpos[:] = np.concatenate(poses)
        mujoco.mj_forward(self.model, self.data)
        rows = [rounded(*contact.pos[:2], contact.dist) for contact in self.data.contact]
        normal = self.data.contact[0].frame[:2] if rows else None
        return np.array(sorted(rows)).reshape(-1, 3), normal


def rounded(x, y, distance):
    """Numbers of a contact that sort alike whatever their last digits."""
    return tuple(np.round((x, y, distance), 9))


def at_both_rims(centre, points):
    """Points that touch, once for each rim, from the world's origin, sorted.

    Args:
        centre: x and y from which points are seen.
        points: x, y and distance of one point, then of the other.
    """
    rows = []
    for x, y, distance in (points[:3], points[3:]):
        if distance < 0:
            rows += [rounded(centre[0] + x, centre[1] + y, distance)] * 2
    return np.array(sorted(rows)).reshape(-1, 3)


def heading(yaw):
    """Cosine and sine of a yaw."""
    return np.cos(yaw), np.sin(yaw)


@pytest.mark.parametrize("second_half_edges", [None, (2.5, 0.3)], ids=["alike", "different"])
@shapes
def test_rectangles_touch_where_mujoco_says(half_edges, second_half_edges):
    """Every tenth pair is parallel."""
    second_half_edges = second_half_edges or half_edges
    scene = Scene(half_edges, second_half_edges)
    rng = np.random.default_rng(1)
    first = np.array([0.3, -0.2])
    n_touching = 0
    for trial in range(3000):
        second = rng.uniform(-2.5, 2.5, 2)
        yaw1, yaw2 = rng.uniform(-np.pi, np.pi, 2)
        if trial % 10 == 0:
            yaw2 = yaw1 + rng.integers(4) * np.pi / 2
        headings = *heading(yaw1), *heading(yaw2)
        pair = (*(second - first), *headings, *half_edges, *second_half_edges)
        gap, _ = separation(*pair)
        if gap < -0.95:
            continue  # deeper than the boxes are high, MuJoCo pushes them apart vertically

        expected, normal = scene.contacts([*first, yaw1], [*second, yaw2])
        assert (gap < 0) == (len(expected) > 0)
        if gap < 0:
            n_touching += 1
            normal_x, normal_y, *points = rectangle_contact(*pair)
            np.testing.assert_allclose((normal_x, normal_y), normal, atol=1e-9)
            np.testing.assert_allclose(at_both_rims(first, points), expected, atol=1e-7)
    assert n_touching > 500


@shapes
def test_rectangles_touch_walls_where_mujoco_says(half_edges):
    """Every tenth rectangle is parallel to the wall."""
    scene = Scene(half_edges, half_edges)
    far_away = [-30, 0, 0]
    rng = np.random.default_rng(2)
    for trial in range(500):
        centre = rng.uniform(6, 8.3), -0.2
        is_turned = trial % 10 > 0
        yaw = rng.uniform(-np.pi, np.pi) if is_turned else rng.integers(4) * np.pi / 2
        points = wall_contact(WALL_X - centre[0], -1.0, 0.0, *heading(yaw), *half_edges)
        expected, _ = scene.contacts([*centre, yaw], far_away)
        np.testing.assert_allclose(at_both_rims(centre, points), expected, atol=1e-7)


def test_gaps_by_hand():
    """Two squares side by side, one turned by 45 degrees, and two that overlap."""
    ahead = (1, 0)
    left = (0, 1)
    diagonal = (np.sqrt(0.5), np.sqrt(0.5))
    assert separation(2.5, 0.3, *ahead, *ahead, *UNIT_SQUARES) == (0.5, 0)
    gap, _ = separation(0, 3, *ahead, *diagonal, *UNIT_SQUARES)
    np.testing.assert_allclose(gap, 2 - np.sqrt(2))
    gap, _ = separation(0.2, 1.9, *ahead, *left, *UNIT_SQUARES)
    assert gap == pytest.approx(-0.1)


def test_sides_that_meet_flat_touch_at_the_ends_of_their_overlap():
    ahead = (1.0, 0.0)
    normal_x, normal_y, *points = rectangle_contact(1.9, 0.6, *ahead, *ahead, *UNIT_SQUARES)
    assert (normal_x, normal_y) == (1, 0)
    ends = sorted([points[:3], points[3:]])
    np.testing.assert_allclose(ends, [(0.95, -0.4, -0.1), (0.95, 1.0, -0.1)])


@pytest.mark.parametrize(("n_robots", "edge"), [(1, 20.0), (2, 5.0), (150, 20.0), (150, 400.0)])
def test_near_pairs_are_all_pairs_within_the_radius(n_robots, edge):
    rng = np.random.default_rng(n_robots)
    poses = np.column_stack([rng.uniform(-22, 22, (n_robots, 2)), np.zeros(n_robots)])
    pairs = near_pairs(poses, np.ones(n_robots, bool), SEARCH_RADIUS, edge)

    all_pairs = np.column_stack(np.triu_indices(n_robots, 1))
    is_near = np.zeros(0, bool)
    if n_robots > 1:
        is_near = pdist(poses[:, :2]) < SEARCH_RADIUS
    assert sorted(pairs.tolist()) == all_pairs[is_near].tolist()


def test_near_pairs_of_a_heap_are_all_pairs():
    """A hundred robots at one point: more pairs than the first array has places for."""
    pairs = near_pairs(np.zeros((100, 3)), np.ones(100, bool), SEARCH_RADIUS, 20.0)
    assert len(pairs) == 100 * 99 // 2


def test_near_pairs_leave_out_who_is_absent_or_not_finite():
    poses = np.zeros((4, 3))
    poses[3, 0] = np.nan
    is_present = np.array([True, False, True, True])
    pairs = near_pairs(poses, is_present, SEARCH_RADIUS, 20.0)
    assert pairs.tolist() == [[0, 2]]
