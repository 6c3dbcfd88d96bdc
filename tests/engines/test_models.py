"""The MJCF models of robot, ball and arena: names, sizes and masses, dynamics with and without the visual parts."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.small import SMALL

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.robot_file import without_visual

MODELS = Path(__file__).resolve().parents[2] / "models"
RD = 2 * np.sqrt(2.0)  # mm
OUTWARD = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)  # sides 0 to 3


def load(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(MODELS / name))


def forwarded(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = load(name)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("name", ["robot.xml", "ball.xml", "arena.xml"])
class TestEveryModel:
    def test_is_in_mm_mg_s(self, name):
        model = load(name)
        np.testing.assert_array_equal(model.opt.gravity, [0, 0, -9810])
        assert model.opt.timestep == 0.1

    def test_leaves_no_default_in_metres(self, name):
        model, metric = load(name), mujoco.MjModel.from_xml_string("<mujoco/>")
        assert model.opt.sleep_tolerance != metric.opt.sleep_tolerance
        assert model.opt.ccd_tolerance != metric.opt.ccd_tolerance
        assert (model.geom_solref != [0.02, 1]).any(axis=1).all()
        assert (model.geom_solimp[:, 2] != 0.001).all()
        assert (model.jnt_solref != [0.02, 1]).any(axis=1).all()

    def test_compiles_without_warnings(self, name, recwarn):
        load(name)
        assert [str(w.message) for w in recwarn] == []


class TestRobot:
    def test_has_the_names_of_the_contract(self):
        model = load("robot.xml")
        sides = [f"{part}{i}{s}" for i in range(4) for part, s in [("led", ""), *[("photodiode", k) for k in "ab"]]]
        seen = ["substrate", "leg0", "leg1", "leg2", "chip", "solar_cell", "probe", *sides]
        for body in ["robot", "visual", *seen]:
            assert model.body(body).name == body
        for site in ["probe_tip", *sides]:
            assert model.site(site).bodyid == model.body("robot").id
        for geom in ["hull", *seen]:
            assert model.geom(geom).name == geom
        assert [model.joint(i).name for i in range(model.njnt)] == ["x", "y", "yaw"]

    def test_hull_alone_collides(self):
        model = load("robot.xml")
        colliding = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
        np.testing.assert_array_equal(colliding, [model.geom("hull").id])
        assert model.geom("hull").condim == 1 and model.geom("hull").group == 3
        others = np.delete(np.arange(model.ngeom), colliding)
        assert (model.geom_group[others] == 2).all()

    def test_drive_has_a_time_constant_of_one_time_step_on_every_axis(self):
        model = load("robot.xml")
        np.testing.assert_allclose([10, 10, 20 / 3] / model.dof_damping, model.opt.timestep)

    def test_probe_is_26_um_wide_and_ends_at_its_tip(self):
        model, data = forwarded("robot.xml")
        probe, tip = model.geom("probe"), data.site("probe_tip").xpos
        assert probe.size[0] == pytest.approx(0.013)
        end = data.geom("probe").xpos - [0, 0, probe.size[1]]
        np.testing.assert_allclose(tip, end, atol=1e-12)

    def test_leg_is_what_the_script_makes(self, tmp_path):
        script = MODELS.parent / "tools" / "make_meshes.py"
        subprocess.run([sys.executable, str(script), str(tmp_path)], check=True, timeout=60)
        made = {path.name: path.read_text() for path in tmp_path.iterdir()}
        assert made == {path.name: path.read_text() for path in (MODELS / "meshes").iterdir()}


def _trajectory(model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qfrc_applied[:3] = [250.0, -80.0, 60.0]
    rows = []
    for _ in range(10):
        mujoco.mj_step(model, data)
        rows.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(rows)


def test_stripping_the_visual_parts_leaves_the_dynamics():
    spec = without_visual(mujoco.MjSpec.from_file(str(MODELS / "robot.xml")))
    full, bare = load("robot.xml"), spec.compile()
    assert bare.ngeom == 1 and bare.nsite == full.nsite == 13
    np.testing.assert_array_equal(_trajectory(bare), _trajectory(full))


class TestBall:
    def test_is_a_solder_ball(self):
        model = load("ball.xml")
        ball = model.geom("ball")
        assert model.body("ball").mocapid[0] == 0
        assert ball.type == mujoco.mjtGeom.mjGEOM_SPHERE
        assert ball.size[0] == pytest.approx(0.02)
        assert (ball.contype, ball.conaffinity, ball.group) == (0, 0, 1)

    @pytest.mark.parametrize("radius, weight", [(0.015, 1.02), (0.020, 2.42), (0.025, 4.72)])
    def test_weight_in_nN(self, radius, weight):
        spec = mujoco.MjSpec.from_file(str(MODELS / "ball.xml"))
        spec.geom("ball").size[0] = radius
        model = spec.compile()
        # 7.4 mg/mm^3 against the 7400 kg/m^3 of which the table gives three figures.
        assert model.body("ball").mass[0] * 9810 == pytest.approx(weight, rel=0.01)


class TestArena:
    def test_only_walls_collide(self):
        model = load("arena.xml")
        names = {model.geom(i).name for i in np.flatnonzero(model.geom_contype | model.geom_conaffinity)}
        assert names == {f"wall{k}" for k in range(4)}

    def test_has_cameras_light_and_a_large_framebuffer(self):
        model = load("arena.xml")
        assert model.camera("above").name and model.camera("oblique").name
        assert model.nlight == 1
        assert min(model.vis.global_.offwidth, model.vis.global_.offheight) >= 1280


def test_floor_markings_balls_and_cameras_follow_the_configuration():
    """An arena four times as long as wide, off the middle; the file's is a square of 49 rd."""
    corners = np.array([(-4.0, -4.0), (6.0, -4.0), (6.0, 36.0), (-4.0, 36.0)])
    own = {"size": 49.0, "outline": tuple(map(tuple, corners)), "dust_area_size": 1.5, "dust_area_offset": 2.6}
    arena = replace(SMALL.arena, **own)
    made, file = compile_arena(replace(SMALL, arena=arena), 1, np.array([20e-6, 30e-6])), load("arena.xml")
    model, floor = made.model, made.model.geom("floor")
    np.testing.assert_allclose(floor.pos[:2] - floor.size[:2], RD * corners[0])
    np.testing.assert_allclose(floor.pos[:2] + floor.size[:2], RD * corners[2])
    np.testing.assert_allclose(model.material("floor").texrepeat, [5, 20])  # cells of 1 rd, two in a picture
    np.testing.assert_allclose(model.geom("dump").size[:2], 1.5 * RD)
    for name, x in (("dust_west", -2.6), ("dust_east", 2.6)):
        area = model.geom(name)
        np.testing.assert_allclose([area.pos[0], *area.size[:2]], RD * np.array([x, 0.75, 0.75]))
    np.testing.assert_allclose([model.geom(f"ball{k}/ball").size[0] for k in range(2)], [0.02, 0.03])
    assert made.mocap.tolist() == [model.body(f"ball{k}/ball").mocapid[0] for k in range(2)] == [0, 1]
    for camera in ("above", "oblique"):
        np.testing.assert_allclose(model.camera(camera).pos / arena.size, file.camera(camera).pos / 49)


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
