"""Drawings of a swarm: outlines, vectors and links where they belong."""

import numpy as np
import pytest
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from PIL import Image

from iswarm_mj.output.palette import EMPTY, LOADED, SCOUT
from iswarm_mj.output.plot_swarm import draw_swarm, links, outlines, vector_lines

QUARTER_TURN = np.pi / 2


def test_hulls_turn_with_their_robots():
    """A robot of 2.4 x 1.6 mm looks along y."""
    corners = outlines(np.array([[1.0, 2.0, QUARTER_TURN]]), np.array([2.4, 1.6]))[0]
    assert corners == pytest.approx(np.array([[0.2, 3.2], [0.2, 0.8], [1.8, 0.8], [1.8, 3.2]]))


def test_vectors_start_at_their_robots_in_their_own_frames():
    """Ahead of a robot that looks along y is up; to its left is to the west."""
    pose = np.array([[0.0, 0.0, QUARTER_TURN], [5.0, 5.0, QUARTER_TURN]])
    lines = vector_lines(pose, np.array([[3.0, 0.0], [0.0, 2.0]]))
    assert lines == pytest.approx(np.array([[[0, 0], [0, 3]], [[5, 5], [3, 5]]]))


def test_each_pair_has_one_link():
    """0 and 1 hear each other, 2 hears 1; links that are not valid do not count, nor do those to
    the dead robot 3."""
    frames = {
        "pose": np.array([[[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]]]),
        "is_alive": np.array([[True, True, True, False]]),
        "link_sender": np.array([[[1, 2], [0, 2], [1, 0], [2, 0]]]),
        "link_valid": np.array([[[True, False], [True, False], [True, False], [True, False]]]),
    }
    assert links(frames, 0).tolist() == [[[0, 0], [1, 0]], [[1, 0], [2, 0]]]


NOTHING = [[0.0, 0, 0]] * 4
POSES = [[-0.015, 0.01, 0.4], [0, 0.01, 0], [0.015, 0.01, 1], [0, -0.01, 2]]
BALLS = [[1, 2, 0.02], [3, 4, 0.02], [5, 6, 0.02]]
FRAMES = {
    "scene_arena_size": np.array(0.04),
    "scene_dump": np.array([-1.0, -2.0, 1.0, 2.0]) * 1e-3,
    "scene_dust_areas": np.array([[10.0, -1.0, 13.0, 3.0]]) * 1e-3,
    "scene_robot_size": np.array([[2.0, 2.0, 1.0], [2.4, 1.6, 1.0]])[[0, 1, 0, 1]] * 1e-3,
    "scene_is_scout": np.array([False, False, True, True]),
    "is_loaded": np.array([[False] * 4, [False, True, False, True]]),
    "pose": np.array([NOTHING, POSES]),
    "is_alive": np.ones((2, 4), bool),
    "link_sender": np.array([[[0]] * 4, [[2], [0], [1], [1]]]),
    "link_valid": np.array([[[True]] * 4, [[True], [False], [False], [True]]]),
    "dust_known": np.array([[False] * 4, [True] * 4]),
    "dust_vector": np.full((2, 4, 2), (-3e-3, 5e-3)),
    "dump_known": np.array([[True] * 4, [True, True, True, False]]),
    "dump_vector": np.full((2, 4, 2), (2e-3, -4e-3)),
    "ball_position": np.array([NOTHING[:3], BALLS]) * 1e-3,
    "ball_state": np.array([[0, 0, 0], [2, 0, 1]]),
}
"""Two steps, of which the second is drawn: two workers and two scouts, one of each loaded."""
POSES_IN_MM = FRAMES["pose"][1] * [1e3, 1e3, 1]


class TestDrawing:
    """The drawing of a step, in millimetres."""

    @pytest.fixture
    def axes(self, tmp_path, monkeypatch):
        """Axes of the drawing, which is written to a.png."""
        drawn = []
        save = Figure.savefig

        def keep_and_save(figure, *args, **more):
            drawn.append(figure)
            save(figure, *args, **more)

        monkeypatch.setattr(Figure, "savefig", keep_and_save)
        draw_swarm(FRAMES, 1, "four robots", tmp_path / "a")
        (axes,) = drawn[0].axes
        return axes

    def test_robots_have_their_size_and_the_colours_of_their_states(self, axes):
        *_, bodies = axes.collections
        hulls = outlines(POSES_IN_MM, 1e3 * FRAMES["scene_robot_size"][:, :2])
        np.testing.assert_allclose([path.vertices[:4] for path in bodies.get_paths()], hulls)
        colours = to_rgba_array([EMPTY, LOADED, SCOUT, LOADED])
        np.testing.assert_allclose(bodies.get_facecolors(), colours)

    def test_robots_show_links_and_the_vectors_that_they_follow(self, axes):
        """Empty workers follow vectors to the dust, loaded robots those to the dump."""
        pose = POSES_IN_MM
        expected = [
            [pose[[0, 2], :2], pose[[1, 3], :2]],
            vector_lines(pose[:1], np.array([[-3.0, 5.0]])),
            vector_lines(pose[1:2], np.array([[2.0, -4.0]])),
        ]
        *lines, _ = axes.collections
        for drawn, segments in zip(lines, expected, strict=True):
            np.testing.assert_allclose(drawn.get_segments(), segments)

    def test_balls_on_the_floor_and_a_scale_are_drawn(self, axes):
        balls, scale = axes.lines
        assert balls.get_xydata().tolist() == [[3, 4]]
        assert scale.get_xydata().tolist() == [[-20, -21], [-15, -21]]
        assert [text.get_text() for text in axes.texts] == ["5 mm"]

    def test_areas_and_walls_are_drawn(self, axes):
        dump, dust, walls = axes.patches
        np.testing.assert_allclose(dump.get_bbox().extents, [-1, -2, 1, 2])
        np.testing.assert_allclose(dust.get_bbox().extents, [10, -1, 13, 3])
        corners = [[20, -20], [20, 20], [-20, 20], [-20, -20]]
        np.testing.assert_allclose(walls.get_xy()[:4], corners)

    def test_title_and_legend_fit_on_the_picture(self, axes, tmp_path):
        with Image.open(tmp_path / "a.png") as image:
            pixels = np.asarray(image.convert("L"))
        assert pixels[:8].min() == pixels[-8:].min() == 255
