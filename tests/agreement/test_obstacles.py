"""Walls and obstacles in the files of a run."""

from dataclasses import replace

import numpy as np
import pytest
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

OUTLINE = ((-7.0, -5.0), (1.0, -8.0), (8.0, -3.0), (6.0, 6.0), (-6.0, 6.0))
OBSTACLES = ((2.0, 3.0, 1.5, 0.3, 25.0),)
"""x, y, half edges [rd] and yaw [deg]."""
CONFIG = SwarmConfig(
    replace(
        SMALL.arena,
        size=49.0,
        outline=OUTLINE,
        obstacles=OBSTACLES,
        dust_area_offset=4,
        dust_area_size=1,
        n_dust=2,
    )
)


@pytest.mark.slow
def test_recordings_show_walls_and_obstacles(tmp_path):
    scenario = Scenario(CONFIG, robots=12, engine=PlanarSettings(1), steps=2)
    run_swarm(Run(scenario), tmp_path)
    saved = load(tmp_path)
    shown = read(tmp_path / "clean.rrd")
    assert saved.config == CONFIG
    np.testing.assert_allclose(saved.scene.corners, 1e-3 * RD * np.array(OUTLINE))

    # Slabs whose inner sides are the walls.
    walls = shown["/world/arena/walls"]
    centres = np.array(walls["Boxes3D:centers"])
    half_sizes = np.array(walls["Boxes3D:half_sizes"])
    distances = beyond(centres[:, :2], in_mm(CONFIG.arena.walls))
    np.testing.assert_allclose(distances, half_sizes[:, 0], atol=1e-4)

    half_sizes = np.array(shown["/world/arena/obstacles"]["Boxes3D:half_sizes"])
    half_edges = RD * np.array(OBSTACLES)[:, 2:4]
    np.testing.assert_allclose(half_sizes[:, :2], half_edges, rtol=1e-6)
