"""Frames of a trajectory from the records of a run."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from support.runs import N, run_of
from support.tasks import Eastward

from iswarm_mj.geometry.walls import beyond, in_mm
from iswarm_mj.output import frames, shapes
from iswarm_mj.output.frames import RecordedWorld
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.units import ROBOT_DIAMETER as RD


@pytest.fixture(scope="module")
def run(small):
    """Two worlds of different genomes, seeds and dumps, both recorded, of control steps of half a second."""
    config = replace(small, drive=replace(small.drive, control_period=0.5))
    other = replace(config, arena=replace(config.arena, dump_size=2.0))
    return run_of(config, worlds=[World(PRESETS["type1"], N, 0, 3), World(PRESETS["type2"], N, 1, 4, config=other)])


def test_each_world_has_its_own_scene(run):
    scenes = [RecordedWorld.of_run(run, index).scene for index in (0, 1)]
    assert [(scene.is_scout.sum(), scene.world) for scene in scenes] == [(2, 3), (8, 4)]
    for scene, start in zip(scenes, run.starts, strict=True):
        np.testing.assert_array_equal(scene.ball_radius, start.task.radius)
    assert (scenes[0].ball_radius != scenes[1].ball_radius).all()
    assert scenes[1].dump[2] == pytest.approx(RD) != pytest.approx(scenes[0].dump[2])


def test_obstacles_and_boxes_are_in_metres_radians_and_kilograms(run):
    run = copy(run)
    own = {"obstacles": ((4.0, -4.0, 0.8, 0.5, 30.0),), "boxes": ((-4.0, 4.0, 0.7, 0.4, 20.0, 2e-5, 0.3),)}
    run.config = replace(run.config, arena=replace(run.config.arena, **own))
    scene = RecordedWorld.of_run(run, 0).scene
    np.testing.assert_allclose(scene.obstacles, [[4 * RD, -4 * RD, 0.8 * RD, 0.5 * RD, np.pi / 6]])
    np.testing.assert_allclose(scene.boxes, [[0.7 * RD, 0.4 * RD, 2e-5, 0.3]])


def test_walls_are_drawn_around_the_floor_and_obstacles_where_they_stand(run):
    """Of five walls, whose inner faces touch the outline, and of a square."""
    run, arena = copy(run), run.config.arena
    corners = ((-7.0, -5.0), (1.0, -8.0), (8.0, -3.0), (6.0, 6.0), (-6.0, 6.0))
    outlined = replace(arena, size=49.0, outline=corners, dust_area_offset=4, dust_area_size=1)
    run.config = replace(run.config, arena=replace(outlined, obstacles=((2.0, 3.0, 1.5, 0.3, 30.0),)))
    scene = RecordedWorld.of_run(run, 0).scene
    np.testing.assert_allclose(shapes.outline(scene), 1e3 * RD * np.array(corners))
    boxes = {boxes.name: boxes.places for boxes in shapes.arena_boxes(scene)}
    walls = boxes["walls"]
    np.testing.assert_allclose(beyond(walls[:, :2], in_mm(run.config.arena.walls)), walls[:, 2])
    along = 1e3 * RD * (np.roll(corners, -1, axis=0) - corners)  # each wall, and twice its thickness at either end
    np.testing.assert_allclose(walls[:, 3] - 2 * walls[:, 2], np.hypot(*along.T) / 2)
    middle = walls[:, :2] - walls[:, 2:3] * np.column_stack([np.cos(walls[:, 4]), np.sin(walls[:, 4])])
    np.testing.assert_allclose(middle, 1e3 * RD * np.array(corners) + along / 2)
    rd = 1e3 * RD
    np.testing.assert_allclose(boxes["obstacles"], [[2 * rd, 3 * rd, 1.5 * rd, 0.3 * rd, np.pi / 6]])
    square = shapes.outline(RecordedWorld.of_run(copy(run), 1).scene._replace(corners=()))
    assert square.max() == pytest.approx(arena.size / 2 * rd) == pytest.approx(-square.min())


def test_areas_and_metrics_of_many_steps_are_read_in_blocks(small, monkeypatch):
    monkeypatch.setattr(frames, "BLOCK_FRAMES", 5)
    is_east = np.random.default_rng(0).random((13, 4)) < 0.5
    found = frames.task_reader(Eastward(2.0), small)({"is_east": is_east, "steps": np.arange(13)})
    assert found["metric_steps"].tolist() == list(range(13))
    np.testing.assert_allclose(found["metric_share"], is_east.mean(axis=1))
    np.testing.assert_allclose(found["area_east"], [[[7e-3, 0, 5e-3]]] * 13)
