"""Drawings of a swarm: outlines, vectors and links where they belong."""

import numpy as np
import pytest
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from PIL import Image

from iswarm_mj.output.palette import EMPTY, LOADED, SCOUT
from iswarm_mj.output.plot_swarm import draw_swarm, links, outlines, vector_lines

QUARTER = np.pi / 2


def test_hulls_turn_with_their_robots():
    """One of 2.4 x 1.6 mm looks along y."""
    corners = outlines(np.array([[1.0, 2.0, QUARTER]]), np.array([2.4, 1.6]))[0]
    assert corners == pytest.approx(np.array([[0.2, 3.2], [0.2, 0.8], [1.8, 0.8], [1.8, 3.2]]))


def test_vectors_start_at_their_robots_in_their_own_frames():
    """Ahead of a robot that looks along y is up; to its left is to the west."""
    pose = np.array([[0.0, 0.0, QUARTER], [5.0, 5.0, QUARTER]])
    found = vector_lines(pose, np.array([[3.0, 0.0], [0.0, 2.0]]))
    assert found == pytest.approx(np.array([[[0, 0], [0, 3]], [[5, 5], [3, 5]]]))


def test_each_pair_has_one_link():
    """0 and 1 hear each other, 2 hears 1; what is not valid does not count."""
    frames = {
        "pose": np.array([[[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]]),
        "link_sender": np.array([[[1, 2], [0, 2], [1, 0]]]),
        "link_valid": np.array([[[True, False], [True, False], [True, False]]]),
    }
    assert links(frames, 0).tolist() == [[[0, 0], [1, 0]], [[1, 0], [2, 0]]]


FRAMES = {
    "scene_arena_size": np.array(0.04),
    "scene_dump": np.array([-1.0, -2.0, 1.0, 2.0]) * 1e-3,
    "scene_dust_areas": np.array([[10.0, -1.0, 13.0, 3.0]]) * 1e-3,
    "scene_robot_size": np.array([[2.0, 2.0, 1.0], [2.4, 1.6, 1.0]])[[0, 1, 0, 1]] * 1e-3,
    "scene_is_scout": np.array([False, False, True, True]),
    "is_loaded": np.array([[False] * 4, [False, True, False, True]]),
    "pose": np.array([[[0.0, 0, 0]] * 4, [[-0.015, 0.01, 0.4], [0, 0.01, 0], [0.015, 0.01, 1], [0, -0.01, 2]]]),
    "link_sender": np.array([[[0]] * 4, [[2], [0], [1], [1]]]),
    "link_valid": np.array([[[True]] * 4, [[True], [False], [False], [True]]]),
    "dust_known": np.array([[False] * 4, [True] * 4]),
    "dust_vector": np.full((2, 4, 2), (-3e-3, 5e-3)),
    "dump_known": np.array([[True] * 4, [True, True, True, False]]),
    "dump_vector": np.full((2, 4, 2), (2e-3, -4e-3)),
    "ball_position": np.array([[[0.0, 0, 0]] * 3, [[1, 2, 0.02], [3, 4, 0.02], [5, 6, 0.02]]]) * 1e-3,
    "ball_state": np.array([[0, 0, 0], [2, 0, 1]]),
}
"""Two steps, of which the second is drawn."""


def test_a_step_is_drawn_in_millimetres(tmp_path, monkeypatch):
    """Empty workers follow their vectors to dust, loaded robots those to the dump; scouts follow neither."""
    shown, save = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *args, **more: (shown.append(self), save(self, *args, **more)))
    draw_swarm(FRAMES, 1, "four robots", tmp_path / "a")
    (axes,) = shown[0].axes
    *lines, bodies = axes.collections
    pose = FRAMES["pose"][1] * [1e3, 1e3, 1]
    np.testing.assert_allclose(
        [path.vertices[:4] for path in bodies.get_paths()], outlines(pose, 1e3 * FRAMES["scene_robot_size"][:, :2])
    )
    np.testing.assert_allclose(bodies.get_facecolors(), to_rgba_array([EMPTY, LOADED, SCOUT, LOADED]))
    wanted = [
        [pose[[0, 2], :2], pose[[1, 3], :2]],
        vector_lines(pose[:1], np.array([[-3.0, 5.0]])),
        vector_lines(pose[1:2], np.array([[2.0, -4.0]])),
    ]
    for drawn, segments in zip(lines, wanted, strict=True):
        np.testing.assert_allclose(drawn.get_segments(), segments)
    lying, scale = axes.lines
    assert lying.get_xydata().tolist() == [[3, 4]] and scale.get_xydata().tolist() == [[-20, -21], [-15, -21]]
    assert [text.get_text() for text in axes.texts] == ["5 mm"]
    dump, dust, walls = axes.patches
    np.testing.assert_allclose([dump.get_bbox().extents, dust.get_bbox().extents], [[-1, -2, 1, 2], [10, -1, 13, 3]])
    np.testing.assert_allclose(walls.get_xy()[:4], [[20, -20], [20, 20], [-20, 20], [-20, -20]])
    with Image.open(tmp_path / "a.png") as image:
        pixels = np.asarray(image.convert("L"))
    assert min(pixels[:8].min(), pixels[-8:].min()) == 255, "the title or the legend is cut"
