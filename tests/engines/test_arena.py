"""The arena: walls, areas, cameras."""

import mujoco
import numpy as np
import pytest
from helpers_models import OUTWARD, RD, load
from helpers_small import SMALL

from iswarm_mj.engines.arena import compile_arena


class TestArena:
    def test_is_49_rd_wide_between_its_walls(self):
        model = load("arena.xml")
        width = 49 * RD
        assert width == pytest.approx(138.593, abs=1e-3)
        np.testing.assert_allclose(model.geom("floor").size[:2], 24.5 * RD, atol=1e-5)
        for k, direction in enumerate(OUTWARD):
            wall, panel = model.geom(f"wall{k}"), model.geom(f"panel{k}")
            normal = np.zeros(3)
            mujoco.mju_rotVecQuat(normal, np.array([0.0, 0.0, 1.0]), wall.quat)
            np.testing.assert_allclose(normal, -np.asarray(direction), atol=1e-9)
            assert wall.pos @ direction == pytest.approx(24.5 * RD, abs=1e-5)
            assert panel.pos @ direction - panel.size @ np.abs(direction) == pytest.approx(24.5 * RD, abs=1e-5)
            assert panel.pos[2] == panel.size[2] == 1.5
            assert (wall.contype, wall.conaffinity, wall.condim, wall.group) == (1, 1, 1, 3)

    @pytest.mark.parametrize("name, x, width", [("dump", 0, 5), ("dust_west", -16, 6), ("dust_east", 16, 6)])
    def test_areas(self, name, x, width):
        area = load("arena.xml").geom(name)
        np.testing.assert_allclose(area.pos[:2], [x * RD, 0], atol=1e-5)
        np.testing.assert_allclose(2 * area.size[:2], width * RD, atol=1e-5)
        assert area.pos[2] + area.size[2] == pytest.approx(0, abs=1e-12)  # balls lie on z = 0

    def test_only_walls_collide(self):
        model = load("arena.xml")
        names = {model.geom(i).name for i in np.flatnonzero(model.geom_contype | model.geom_conaffinity)}
        assert names == {f"wall{k}" for k in range(4)}

    def test_has_cameras_light_and_a_large_framebuffer(self):
        model = load("arena.xml")
        assert model.camera("above").name and model.camera("oblique").name
        assert model.nlight == 1
        assert min(model.vis.global_.offwidth, model.vis.global_.offheight) >= 1280


def test_panels_of_a_small_arena_stand_behind_its_walls():
    """Their inner faces at the walls, from corner to corner, so that a picture shows no gap."""
    model = compile_arena(SMALL, 1, np.zeros(0)).model
    edge, thick = SMALL.arena.size / 2 * RD, 2 * min(model.geom("panel0").size[:2])
    for k, direction in enumerate(np.asarray(OUTWARD)):
        panel, across = model.geom(f"panel{k}"), np.abs(direction[[1, 0, 2]])
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, panel.quat)
        assert model.geom(f"wall{k}").pos @ direction == pytest.approx(edge)
        assert panel.pos @ direction - panel.size[0] == pytest.approx(edge)
        np.testing.assert_allclose(matrix.reshape(3, 3)[:, 0], direction, atol=1e-12)
        assert panel.size[0] == pytest.approx(thick / 2)
        assert panel.size[1] == pytest.approx(edge + thick) and panel.pos @ across == 0
