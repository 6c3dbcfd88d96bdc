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

MM_PER_RD = 1e3 * RD


@pytest.fixture(scope="module")
def run(small):
    """Two recorded worlds of different genomes, seeds and dumps, with steps of half a second."""
    config = replace(small, drive=replace(small.drive, control_period=0.5))
    smaller_dump = replace(config, arena=replace(config.arena, dump_size=2.0))
    worlds = [
        World(PRESETS["type1"], N, 0, 3),
        World(PRESETS["type2"], N, 1, 4, config=smaller_dump),
    ]
    return run_of(config, worlds=worlds)


def test_each_world_has_its_own_scene(run):
    scenes = [RecordedWorld.of_run(run, index).scene for index in (0, 1)]

    assert [(scene.is_scout.sum(), scene.world) for scene in scenes] == [(2, 3), (8, 4)]
    for scene, start in zip(scenes, run.starts, strict=True):
        np.testing.assert_array_equal(scene.ball_radius, start.task.radius)
    assert (scenes[0].ball_radius != scenes[1].ball_radius).all()
    assert scenes[1].dump[2] == pytest.approx(RD) != pytest.approx(scenes[0].dump[2])


def test_obstacles_and_boxes_are_in_metres_radians_and_kilograms(run):
    run = copy(run)
    obstacle = (4.0, -4.0, 0.8, 0.5, 30.0)  # x, y, half edges [rd], yaw [deg]
    box = (-4.0, 4.0, 0.7, 0.4, 20.0, 2e-5, 0.3)  # and mass [kg], friction
    arena = replace(run.config.arena, obstacles=(obstacle,), boxes=(box,))
    run.config = replace(run.config, arena=arena)

    scene = RecordedWorld.of_run(run, 0).scene
    obstacle_in_si = [4 * RD, -4 * RD, 0.8 * RD, 0.5 * RD, np.pi / 6]
    np.testing.assert_allclose(scene.obstacles, [obstacle_in_si])
    np.testing.assert_allclose(scene.boxes, [[0.7 * RD, 0.4 * RD, 2e-5, 0.3]])


@pytest.fixture
def five_walls(run):
    """The run in an arena of five walls with an obstacle, and the corners of the arena [mm]."""
    corners = ((-7.0, -5.0), (1.0, -8.0), (8.0, -3.0), (6.0, 6.0), (-6.0, 6.0))
    arena = replace(
        run.config.arena, size=49.0, outline=corners, dust_area_offset=4, dust_area_size=1
    )
    obstacle = (2.0, 3.0, 1.5, 0.3, 30.0)
    outlined = copy(run)
    outlined.config = replace(run.config, arena=replace(arena, obstacles=(obstacle,)))
    return outlined, MM_PER_RD * np.array(corners)


def boxes_of(scene):
    """Places of what stands in a scene, by name."""
    return {boxes.name: boxes.places for boxes in shapes.arena_boxes(scene)}


def test_walls_are_drawn_around_the_floor(five_walls):
    """Their inner faces touch the outline, and each reaches beyond its corners by its thickness."""
    run, corners = five_walls
    scene = RecordedWorld.of_run(run, 0).scene
    np.testing.assert_allclose(shapes.outline(scene), corners)

    walls = boxes_of(scene)["walls"]
    centre, half_thickness, half_length, yaw = np.split(walls, [2, 3, 4], axis=1)
    distance = beyond(centre, in_mm(run.config.arena.walls))
    np.testing.assert_allclose(distance, half_thickness[:, 0])

    edges = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(edges[:, 0], edges[:, 1])
    np.testing.assert_allclose((half_length - 2 * half_thickness)[:, 0], length / 2)
    inner_face = centre - half_thickness * np.hstack([np.cos(yaw), np.sin(yaw)])
    np.testing.assert_allclose(inner_face, corners + edges / 2)


def test_obstacles_are_drawn_where_they_stand(five_walls):
    run, _ = five_walls
    obstacles = boxes_of(RecordedWorld.of_run(run, 0).scene)["obstacles"]
    in_rd = np.array([2, 3, 1.5, 0.3])
    np.testing.assert_allclose(obstacles, [[*(MM_PER_RD * in_rd), np.pi / 6]])


def test_an_arena_without_corners_is_a_square(run):
    scene = RecordedWorld.of_run(copy(run), 1).scene._replace(corners=())
    square = shapes.outline(scene)
    half_edge = run.config.arena.size / 2 * MM_PER_RD
    assert square.max() == pytest.approx(half_edge) == pytest.approx(-square.min())


def test_areas_and_metrics_of_many_steps_are_read_in_blocks(small, monkeypatch):
    monkeypatch.setattr(frames, "BLOCK_FRAMES", 5)
    n_steps = 13
    is_east = np.random.default_rng(0).random((n_steps, 4)) < 0.5
    read = frames.task_reader(Eastward(2.0), small)

    arrays = read({"is_east": is_east, "steps": np.arange(n_steps)})

    assert arrays["metric_steps"].tolist() == list(range(n_steps))
    np.testing.assert_allclose(arrays["metric_share"], is_east.mean(axis=1))
    np.testing.assert_allclose(arrays["area_east"], [[[7e-3, 0, 5e-3]]] * n_steps)
