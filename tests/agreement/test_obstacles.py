"""Walls and obstacles in the files of a run. Units: mm, s."""

from dataclasses import replace

import numpy as np
from support.rrd import read
from support.small import SMALL

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.geometry.walls import beyond, in_mm
from iswarm_mj.output.loading import load
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.units import RD
from iswarm_mj.workflows.clean import run_swarm


def arena_with(*boxes, n_dust=2):
    return replace(SMALL.arena, obstacles=boxes, dust_area_size=2, dust_area_offset=5.5, n_dust=n_dust)


def test_recordings_show_walls_and_obstacles(tmp_path):
    outline, boxes = ((-7.0, -5.0), (1.0, -8.0), (8.0, -3.0), (6.0, 6.0), (-6.0, 6.0)), ((2.0, 3.0, 1.5, 0.3, 25.0),)
    config = SwarmConfig(replace(arena_with(*boxes), size=49.0, outline=outline, dust_area_offset=4, dust_area_size=1))
    run_swarm(Run(Scenario(config, robots=12, engine=PlanarSettings(1), steps=2)), tmp_path)
    saved, shown = load(tmp_path), read(tmp_path / "clean.rrd")
    assert saved.config == config
    np.testing.assert_allclose(saved.scene.corners, 1e-3 * RD * np.array(outline))
    middles, half = (np.array(shown["/world/arena/walls"][f"Boxes3D:{name}"]) for name in ("centers", "half_sizes"))
    np.testing.assert_allclose(beyond(middles[:, :2], in_mm(config.arena.walls)), half[:, 0], atol=1e-4)
    half = np.array(shown["/world/arena/obstacles"]["Boxes3D:half_sizes"])
    np.testing.assert_allclose(half[:, :2], RD * np.array(boxes)[:, 2:4], rtol=1e-6)
