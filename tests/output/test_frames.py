"""Frames of a trajectory from the records of a run."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from helpers_runs import N, run_of

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
    scenes = [RecordedWorld.of(run, index).scene for index in (0, 1)]
    assert [(scene.is_scout.sum(), scene.world) for scene in scenes] == [(2, 3), (8, 4)]
    for scene, start in zip(scenes, run.starts, strict=True):
        np.testing.assert_array_equal(scene.ball_radius, start.task.radius)
    assert (scenes[0].ball_radius != scenes[1].ball_radius).all()
    assert scenes[1].dump[2] == pytest.approx(RD) != pytest.approx(scenes[0].dump[2])


def test_obstacles_are_in_metres_and_radians(run):
    run = copy(run)
    run.config = replace(run.config, arena=replace(run.config.arena, obstacles=((4.0, -4.0, 0.8, 0.5, 30.0),)))
    scene = RecordedWorld.of(run, 0).scene
    np.testing.assert_allclose(scene.obstacles, [[4 * RD, -4 * RD, 0.8 * RD, 0.5 * RD, np.pi / 6]])
