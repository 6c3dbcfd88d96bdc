"""Obstacles from pictures: they cover what is dark, and nothing else."""

import os

import numpy as np
import pytest
from PIL import Image
from support.systems import needs_named_pipes

from iswarm_mj.commands.main import parse
from iswarm_mj.geometry.obstacle_picture import boxes_of_picture, rectangles
from iswarm_mj.geometry.obstacles import distances, numbers
from iswarm_mj.utils.errors import UserError


@pytest.mark.parametrize("seed", range(4))
def test_rectangles_cover_what_is_dark_once(seed):
    dark = np.random.default_rng(seed).random((13, 17)) < 0.4
    count = np.zeros(dark.shape, int)
    for left, top, right, bottom in rectangles(dark):
        count[top:bottom, left:right] += 1
    np.testing.assert_array_equal(count, dark)


def test_straight_walls_are_one_rectangle():
    dark = np.zeros((9, 9), bool)
    dark[2, 1:8] = dark[4:9, 3] = True
    assert sorted(map(tuple, rectangles(dark).tolist())) == [(1, 2, 8, 3), (3, 4, 4, 9)]


def test_pixels_are_where_they_are_seen(tmp_path):
    """Upwards is north; what is transparent is white."""
    pixels = np.full((10, 20, 4), 255, np.uint8)
    pixels[0, 0:2, :3] = 0
    pixels[9, 19, :3] = 100
    pixels[5, 5] = 0
    Image.fromarray(pixels).save(tmp_path / "map.png")
    boxes = boxes_of_picture(tmp_path / "map.png", 40.0, 10.0)
    assert sorted(boxes) == [(-18.0, 4.5, 2.0, 0.5, 0.0), (19.0, -4.5, 1.0, 0.5, 0.0)]
    assert (distances(np.array([[-19.9, 4.9], [19.9, -4.9]]), numbers(boxes)) == 0).all()


def test_commands_take_a_maze(tmp_path):
    pixels = np.full((7, 7), 255, np.uint8)
    pixels[1, 1] = 0
    Image.fromarray(pixels).save(tmp_path / "map.png")
    config = parse(
        ["clean", "--maze", str(tmp_path / "map.png"), "--arena.outline", "49", "70"]
    ).config
    assert config.arena.obstacles == ((-14.0, 20.0, 3.5, 5.0, 0.0),)


@pytest.mark.parametrize(
    ("pixels", "says"),
    [
        (np.full((4, 4), 255, np.uint8), "draw walls in black"),
        (np.uint8(255 * (np.indices((80, 80)).sum(axis=0) % 2)), "with fewer pixels"),
        (None, "must be a picture"),
    ],
)
def test_what_is_no_maze_is_refused(pixels, says, tmp_path):
    path = tmp_path / "map.png"
    path.write_text("no picture") if pixels is None else Image.fromarray(pixels).save(path)
    with pytest.raises(UserError, match=says):
        boxes_of_picture(path, 49.0, 49.0)
    with pytest.raises(UserError, match="must be a picture"):
        boxes_of_picture(tmp_path / "none.png", 49.0, 49.0)


@needs_named_pipes
def test_a_pipe_is_no_maze(tmp_path):
    os.mkfifo(tmp_path / "map.png")
    with pytest.raises(UserError, match=r"must be a picture.*a pipe or a device"):
        boxes_of_picture(tmp_path / "map.png", 49.0, 49.0)
