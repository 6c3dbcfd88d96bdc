"""Drawings of a swarm: outlines, vectors and links where they belong."""

import numpy as np
import pytest
from PIL import Image

from iswarm_mj.output.palette import EMPTY, LOADED, SCOUT, rgb
from iswarm_mj.output.plot_swarm import draw_swarm, links, outlines, vectors

QUARTER = np.pi / 2


def test_squares_turn_with_their_robots():
    corners = outlines(np.array([[1.0, 2.0, QUARTER / 2]]), np.array([2.0, 2.0]))[0]
    reach = np.sqrt(2)
    assert corners == pytest.approx(np.array([[1, 2 + reach], [1 - reach, 2], [1, 2 - reach], [1 + reach, 2]]))


def test_vectors_start_at_their_robots_in_their_own_frames():
    """Ahead of a robot that looks along y is up; to its left is to the west."""
    pose = np.array([[0.0, 0.0, QUARTER], [5.0, 5.0, QUARTER]])
    found = vectors(pose, np.array([[3.0, 0.0], [0.0, 2.0]]))
    assert found == pytest.approx(np.array([[[0, 0], [0, 3]], [[5, 5], [3, 5]]]))


def test_each_pair_has_one_link():
    """0 and 1 hear each other, 2 hears 1; what is not valid does not count."""
    frames = {
        "pose": np.array([[[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]]),
        "link_sender": np.array([[[1, 2], [0, 2], [1, 0]]]),
        "link_valid": np.array([[[True, False], [True, False], [True, False]]]),
    }
    assert links(frames, 0).tolist() == [[[0, 0], [1, 0]], [[1, 0], [2, 0]]]


def test_robots_have_the_colours_of_their_states(tmp_path):
    """One robot of each kind on bare floor: as much of each colour."""
    frames = {
        "scene_arena_size": np.array(0.04),
        "scene_dump": np.array([-0.001, -0.001, 0.001, 0.001]),
        "scene_dust_areas": np.array([[0.01, -0.001, 0.012, 0.001]]),
        "scene_robot_size": np.array([2e-3, 2e-3, 1e-3]),
        "scene_is_scout": np.array([False, False, True]),
        "is_loaded": np.array([[False, True, False]]),
        "pose": np.array([[[-0.015, 0.01, 0], [0.0, 0.01, 0], [0.015, 0.01, 0]]]),
        "link_sender": np.zeros((1, 3, 1), int),
        "link_valid": np.zeros((1, 3, 1), bool),
        "dust_known": np.array([[True, True, True]]),
        "dust_vector": np.full((1, 3, 2), -0.005),
        "dump_known": np.zeros((1, 3), bool),
        "dump_vector": np.zeros((1, 3, 2)),
        "ball_position": np.zeros((1, 1, 3)),
        "ball_state": np.array([[2]]),
    }
    draw_swarm(frames, 0, "three robots", tmp_path / "a")
    with Image.open(tmp_path / "a.png") as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    band = pixels[: len(pixels) // 2]  # the dump and the legend are lower
    counts = [(np.abs(band - rgb(colour)).max(axis=-1) < 30).sum() for colour in (EMPTY, LOADED, SCOUT)]
    assert min(counts) > 500 and max(counts) < 1.3 * min(counts)
    edge = np.concatenate([pixels[:8].reshape(-1, 3), pixels[-8:].reshape(-1, 3)])
    assert edge.min() == 255, "the title or the legend is cut"
