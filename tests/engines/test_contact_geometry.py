"""Contact points of rectangles: MuJoCo's, closed forms and brute force. Units: mm."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.distance import pdist

from iswarm_mj.engines.contact_geometry import rectangle_contact, separation, wall_contact
from iswarm_mj.engines.planar.near_pairs import near_pairs

WALL_AT = 8.0
SHAPES = pytest.mark.parametrize("half_edges", [(1.0, 1.0), (1.4, 0.6)], ids=["square", "long"])


def scene(*boxes):
    """Two boxes 1 mm high with these half edges, and a wall at x = 8 mm."""
    bodies = [
        f"""
      <body pos="0 0 0.5">
        <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>
        <geom type="box" size="{hx} {hy} 0.5" condim="1"/>
      </body>"""
        for hx, hy in boxes
    ]
    wall = f'<geom name="wall" type="plane" size="0 0 1" pos="{WALL_AT} 0 0" zaxis="-1 0 0" condim="1"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{wall}{''.join(bodies)}</worldbody></mujoco>")
    return model, mujoco.MjData(model)


def points_of_mujoco(model, data, qpos):
    """Rows x, y, distance of all contacts, sorted, and the normal of the first."""
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    points = sorted(tuple(np.round((*contact.pos[:2], contact.dist), 9)) for contact in data.contact)
    return np.array(points).reshape(-1, 3), data.contact[0].frame[:2] if points else None


def twice_sorted(centre, *points):
    """Points that touch, once for each rim, seen from the world's origin."""
    touching = [tuple(np.round((centre[0] + x, centre[1] + y, d), 9)) for x, y, d in points if d < 0]
    return np.array(sorted(touching * 2)).reshape(-1, 3)


@pytest.mark.parametrize("other", [None, (2.5, 0.3)], ids=["alike", "different"])
@SHAPES
def test_rectangles_touch_where_mujoco_says(half_edges, other):
    other = other or half_edges
    model, data = scene(half_edges, other)
    rng = np.random.default_rng(1)
    n_touching = 0
    for trial in range(3000):
        first, second = np.array([0.3, -0.2]), rng.uniform(-2.5, 2.5, 2)
        yaw = rng.uniform(-np.pi, np.pi, 2)
        if trial % 10 == 0:
            yaw[1] = yaw[0] + rng.integers(4) * np.pi / 2
        pair = (*(second - first), np.cos(yaw[0]), np.sin(yaw[0]), np.cos(yaw[1]), np.sin(yaw[1]), *half_edges, *other)
        gap, _ = separation(*pair)
        if gap < -0.95:
            continue  # deeper than the boxes are high, MuJoCo pushes them apart vertically
        expected, normal = points_of_mujoco(model, data, [*first, yaw[0], *second, yaw[1]])
        assert (gap < 0) == (len(expected) > 0)
        if gap < 0:
            n_touching += 1
            nx, ny, *points = rectangle_contact(*pair)
            np.testing.assert_allclose((nx, ny), normal, atol=1e-9)
            np.testing.assert_allclose(twice_sorted(first, points[:3], points[3:]), expected, atol=1e-7)
    assert n_touching > 500


@SHAPES
def test_rectangles_touch_walls_where_mujoco_says(half_edges):
    model, data = scene(half_edges, half_edges)
    rng = np.random.default_rng(2)
    for trial in range(500):
        x, yaw = rng.uniform(6, 8.3), rng.uniform(-np.pi, np.pi) if trial % 10 else rng.integers(4) * np.pi / 2
        points = wall_contact(WALL_AT - x, -1.0, 0.0, np.cos(yaw), np.sin(yaw), *half_edges)
        expected, _ = points_of_mujoco(model, data, [x, -0.2, yaw, -30, 0, 0])
        np.testing.assert_allclose(twice_sorted((x, -0.2), points[:3], points[3:]), expected, atol=1e-7)


def test_gaps_by_hand():
    c = np.sqrt(0.5)
    assert separation(2.5, 0.3, 1, 0, 1, 0, 1, 1, 1, 1) == (0.5, 0)
    np.testing.assert_allclose(separation(0, 3, 1, 0, c, c, 1, 1, 1, 1)[0], 2 - np.sqrt(2))
    assert separation(0.2, 1.9, 1, 0, 0, 1, 1, 1, 1, 1)[0] == pytest.approx(-0.1)


def test_sides_that_meet_flat_touch_at_the_ends_of_their_overlap():
    nx, ny, x1, y1, d1, x2, y2, d2 = rectangle_contact(1.9, 0.6, 1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0)
    assert (nx, ny) == (1, 0)
    np.testing.assert_allclose(sorted([(x1, y1, d1), (x2, y2, d2)]), [(0.95, -0.4, -0.1), (0.95, 1.0, -0.1)])


@pytest.mark.parametrize(("n", "edge"), [(1, 20.0), (2, 5.0), (150, 20.0), (150, 400.0)])
def test_near_pairs_are_all_pairs_within_the_radius(n, edge):
    rng = np.random.default_rng(n)
    poses, radius = np.column_stack([rng.uniform(-22, 22, (n, 2)), np.zeros(n)]), 4.0
    pairs = near_pairs(poses, np.ones(n, bool), radius, edge)
    first, second = np.triu_indices(n, 1)
    near = pdist(poses[:, :2]) < radius if n > 1 else np.zeros(0, bool)
    assert sorted(map(tuple, pairs.tolist())) == list(zip(first[near].tolist(), second[near].tolist(), strict=True))


def test_near_pairs_of_a_heap_are_all_pairs():
    """Hundred robots at one point: more pairs than the first array has places for."""
    assert len(near_pairs(np.zeros((100, 3)), np.ones(100, bool), 4.0, 20.0)) == 100 * 99 // 2


def test_near_pairs_leave_out_who_is_absent_or_not_finite():
    poses = np.zeros((4, 3))
    poses[3, 0] = np.nan
    pairs = near_pairs(poses, np.array([True, False, True, True]), 4.0, 20.0)
    assert pairs.tolist() == [[0, 2]]
