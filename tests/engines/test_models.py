"""The MJCF models of robot and ball: names, sizes and masses, dynamics with and without the visual parts."""

import subprocess
import sys

import mujoco
import numpy as np
import pytest
from helpers_models import MODELS, OUTWARD, forwarded, load


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

    def test_has_no_actuator_and_no_sensor(self, name):
        model = load(name)
        assert model.nu == 0
        assert model.nsensor == 0


class TestRobot:
    def test_has_the_names_of_the_contract(self):
        model = load("robot.xml")
        sides = [f"{part}{i}{s}" for i in range(4) for part, s in [("led", ""), *[("photodiode", k) for k in "ab"]]]
        for body in [
            "robot",
            "visual",
            "substrate",
            "leg0",
            "leg1",
            "leg2",
            "chip",
            "solar_cell",
            "probe",
            *sides,
        ]:
            assert model.body(body).name == body
        for site in ["probe_tip", *sides]:
            assert model.site(site).bodyid == model.body("robot").id
        for geom in ["hull", "substrate", "leg0", "leg1", "leg2", "chip", "solar_cell", "probe", *sides]:
            assert model.geom(geom).name == geom
        assert [model.joint(i).name for i in range(model.njnt)] == ["x", "y", "yaw"]

    def test_hull_is_2_x_2_x_1_mm_on_the_floor(self):
        model = load("robot.xml")
        hull = model.geom("hull")
        assert hull.type == mujoco.mjtGeom.mjGEOM_BOX
        np.testing.assert_array_equal(hull.size, [1, 1, 0.5])
        np.testing.assert_allclose(model.body("robot").pos + hull.pos, [0, 0, 0.5])
        assert hull.group == 3

    def test_hull_alone_collides(self):
        model = load("robot.xml")
        colliding = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
        np.testing.assert_array_equal(colliding, [model.geom("hull").id])
        assert model.geom("hull").condim == 1
        others = np.delete(np.arange(model.ngeom), colliding)
        assert (model.geom_group[others] == 2).all()

    def test_visual_parts_stay_inside_the_hull(self):
        model, data = forwarded("robot.xml")
        lowest, highest = np.full(3, np.inf), np.full(3, -np.inf)
        for i in np.flatnonzero(model.geom_group == 2):
            centre, half = model.geom_aabb[i, :3], model.geom_aabb[i, 3:]
            corners = centre + half * np.stack(np.meshgrid(*3 * [[-1, 1]]), axis=-1).reshape(-1, 3)
            placed = data.geom_xpos[i] + corners @ data.geom_xmat[i].reshape(3, 3).T
            lowest, highest = np.minimum(lowest, placed.min(axis=0)), np.maximum(highest, placed.max(axis=0))
        # The legs' boxes lie along their axes of inertia, hence a little slack below.
        np.testing.assert_allclose(lowest, [-1, -1, 0], atol=0.08)
        np.testing.assert_allclose(highest, [1, 1, 1], atol=1e-9)

    def test_weighs_10_mg_as_a_homogeneous_box(self):
        model = load("robot.xml")
        body = model.body("robot")
        assert model.body_mass.sum() == pytest.approx(10)
        assert body.mass[0] == pytest.approx(10)
        np.testing.assert_allclose(np.sort(body.inertia), 10 / 12 * np.array([5, 5, 8]))
        np.testing.assert_allclose(body.pos + body.ipos, [0, 0, 0.5])

    def test_drive_has_a_time_constant_of_one_time_step_on_every_axis(self):
        model = load("robot.xml")
        inertia = [10, 10, 20 / 3]
        np.testing.assert_allclose(inertia / model.dof_damping, model.opt.timestep)

    @pytest.mark.parametrize("dof", [0, 1, 2])
    def test_drive_reaches_its_set_point(self, dof):
        model = load("robot.xml")
        data = mujoco.MjData(model)
        data.qfrc_applied[dof] = model.dof_damping[dof] * 1.2
        errors = []
        for _ in range(12):
            mujoco.mj_step(model, data)
            errors.append(1.2 - data.qvel[dof])
        # Explicit, at the gain m / h: there after one step, and it stays.
        np.testing.assert_allclose(errors, 0.0, atol=1e-9)

    @pytest.mark.parametrize("side", range(4))
    def test_led_is_at_the_middle_of_its_side_and_looks_outward(self, side):
        _, data = forwarded("robot.xml")
        led = data.site(f"led{side}")
        np.testing.assert_allclose(led.xpos, OUTWARD[side] + [0, 0, 0.5], atol=0.002)
        np.testing.assert_allclose(led.xmat.reshape(3, 3)[:, 0], OUTWARD[side], atol=1e-12)
        np.testing.assert_allclose(led.xmat.reshape(3, 3)[:, 2], [0, 0, 1], atol=1e-12)

    @pytest.mark.parametrize("side", range(4))
    def test_photodiodes_stand_left_and_right_of_the_led(self, side):
        _, data = forwarded("robot.xml")
        led = data.site(f"led{side}")
        leftward = led.xmat.reshape(3, 3)[:, 1]
        for name, sign in (("a", 1), ("b", -1)):
            photodiode = data.site(f"photodiode{side}{name}")
            np.testing.assert_allclose(photodiode.xpos - led.xpos, sign * 0.36 * leftward, atol=1e-12)
            np.testing.assert_allclose(photodiode.xmat, led.xmat, atol=1e-12)
            drawn = data.geom(f"photodiode{side}{name}").xpos - photodiode.xpos
            assert np.linalg.norm(drawn) < 0.12

    @pytest.mark.parametrize("side", range(4))
    def test_ray_from_a_site_misses_its_own_hull(self, side):
        model, data = forwarded("robot.xml")
        hit = np.full(1, -1, dtype=np.int32)
        hulls = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8)
        for site in (f"led{side}", f"photodiode{side}a", f"photodiode{side}b"):
            mujoco.mj_ray(model, data, data.site(site).xpos, OUTWARD[side], hulls, 1, -1, hit)
            assert hit[0] == -1

    def test_probe_is_26_um_wide_and_clears_the_largest_ball(self):
        model, data = forwarded("robot.xml")
        probe, tip = model.geom("probe"), data.site("probe_tip").xpos
        assert probe.size[0] == pytest.approx(0.013)
        end = data.geom("probe").xpos - [0, 0, probe.size[1]]
        np.testing.assert_allclose(tip, end, atol=1e-12)
        assert tip[2] == pytest.approx(0.055)
        assert tip[0] == pytest.approx(0.9)

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


def _without_visual_body() -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(MODELS / "robot.xml"))
    spec.delete(spec.body("visual"))
    return spec.compile()


def _with_discardvisual() -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(MODELS / "robot.xml"))
    spec.compiler.discardvisual = True
    return spec.compile()


@pytest.mark.parametrize("strip", [_without_visual_body, _with_discardvisual])
def test_stripping_the_visual_parts_leaves_the_dynamics(strip):
    full, bare = load("robot.xml"), strip()
    assert bare.ngeom == 1
    assert bare.nsite == full.nsite == 13
    robot = bare.body("robot").id
    assert bare.body_mass.sum() == full.body_mass.sum()
    np.testing.assert_array_equal(bare.body_inertia[robot], full.body("robot").inertia)
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
