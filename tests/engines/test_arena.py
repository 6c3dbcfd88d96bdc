"""The MJCF models: names, sizes and masses, dynamics with and without the visual parts, and one picture."""

import os
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

MODELS = Path(__file__).resolve().parents[2] / "models"
RD = 2 * np.sqrt(2.0)  # mm
SPEED = 0.5 * RD  # mm/s
OUTWARD = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)  # sides 0 to 3


def load(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(MODELS / name))


def forwarded(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = load(name)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def compose(robots: list[tuple[float, float, float]], balls: int = 0, visual: bool = True) -> mujoco.MjModel:
    """The arena with robots at (x, y, heading in degrees) and balls."""
    arena = mujoco.MjSpec.from_file(str(MODELS / "arena.xml"))
    for i, (x, y, heading) in enumerate(robots):
        robot = mujoco.MjSpec.from_file(str(MODELS / "robot.xml"))
        if not visual:
            robot.delete(robot.body("visual"))
        frame = arena.worldbody.add_frame(pos=[x, y, 0], euler=[0, 0, heading])
        frame.attach_body(robot.body("robot"), f"robot{i}/", "")
    for i in range(balls):
        ball = mujoco.MjSpec.from_file(str(MODELS / "ball.xml"))
        frame = arena.worldbody.add_frame(pos=[-16 * RD + i, 0, 0])
        frame.attach_body(ball.body("ball"), f"ball{i}/", "")
    return arena.compile()


@pytest.mark.parametrize("name", ["robot.xml", "ball.xml", "arena.xml"])
class TestEveryModel:
    def test_is_in_mm_mg_s(self, name):
        model = load(name)
        np.testing.assert_array_equal(model.opt.gravity, [0, 0, -9810])
        assert model.opt.timestep == 0.1
        assert "Units: mm, mg, s." in (MODELS / name).read_text()

    def test_leaves_no_default_in_metres(self, name):
        model, metric = load(name), mujoco.MjModel.from_xml_string("<mujoco/>")
        assert model.opt.sleep_tolerance != metric.opt.sleep_tolerance
        assert model.opt.ccd_tolerance != metric.opt.ccd_tolerance
        assert (model.geom_solref != [0.02, 1]).any(axis=1).all()
        assert (model.geom_solimp[:, 2] != 0.001).all()
        assert (model.jnt_solref != [0.02, 1]).any(axis=1).all()

    def test_has_a_material_on_every_geom(self, name):
        assert (load(name).geom_matid >= 0).all()

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


class TestArena:
    def test_is_49_rd_wide_between_its_walls(self):
        model = load("arena.xml")
        width = 49 * RD
        assert width == pytest.approx(138.593, abs=1e-3)
        np.testing.assert_allclose(model.geom("floor").size[:2], 24.5 * RD, atol=1e-5)
        for name, direction in zip(("east", "north", "west", "south"), OUTWARD, strict=True):
            wall = model.geom(f"wall_{name}")
            panel = model.geom(f"panel_{name}")
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
        assert names == {"wall_east", "wall_north", "wall_west", "wall_south"}

    def test_has_cameras_light_and_a_large_framebuffer(self):
        model = load("arena.xml")
        assert model.camera("above").name and model.camera("oblique").name
        assert model.nlight == 1
        assert min(model.vis.global_.offwidth, model.vis.global_.offheight) >= 1280


class TestComposed:
    def test_fifty_robots_and_ten_balls_attach_and_step(self, recwarn):
        rng = np.random.default_rng(0)
        robots = [(x * 2 * RD, y * 2 * RD, rng.uniform(0, 360)) for x in range(10) for y in range(2, 7)]
        model = compose(robots, balls=10)
        assert [str(w.message) for w in recwarn] == []  # no conflict of options
        assert (model.nv, model.nmocap) == (150, 10)
        assert model.body_mass[model.body("robot49/robot").id] == pytest.approx(10)
        assert model.opt.timestep == 0.1
        data = mujoco.MjData(model)
        for _ in range(50):
            data.qfrc_applied[:] = model.dof_damping * rng.uniform(-SPEED, SPEED, model.nv)
            mujoco.mj_step(model, data)
        assert np.isfinite(data.qpos).all() and np.abs(data.qvel).max() < 3 * SPEED
        assert data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number == 0

    @pytest.mark.parametrize("turned, passes", [(0, False), (20, True), (-35, True)])
    def test_two_robots_driven_together_neither_bounce_nor_sink_in(self, turned, passes):
        model = compose([(-2, 0, turned), (2, 0, 0)], visual=False)
        data = mujoco.MjData(model)
        # The slides turn with the frame: drive along the world's x.
        data.qfrc_applied[:2] = 100 * SPEED * np.array([np.cos(np.radians(turned)), -np.sin(np.radians(turned))])
        data.qfrc_applied[3] = -100 * SPEED
        depths, speeds = [], []
        for _ in range(100):
            mujoco.mj_step(model, data)
            depths.append(max((-contact.dist for contact in data.contact), default=0.0))
            speeds.append(np.abs(data.qvel[[0, 1, 3, 4]]).max())
        assert max(depths) <= 2 * SPEED * 0.1 + 0.01  # one step's approach, before the solver sees it
        assert max(speeds) <= 1.5 * SPEED
        assert depths[-1] <= 0.05
        if passes:  # without friction, corners glide off each other
            assert data.ncon == 0
        else:
            assert data.ncon > 0 and speeds[-1] < 0.05

    def test_a_queue_driven_at_a_wall_does_not_sink_in(self):
        wall = 24.5 * RD
        model = compose([(wall - 2 - 2.3 * i, 0, 0) for i in range(8)], visual=False)
        data = mujoco.MjData(model)
        data.qfrc_applied[0::3] = 100 * SPEED
        for _ in range(100):
            mujoco.mj_step(model, data)
        assert max(-contact.dist for contact in data.contact) <= 0.05
        assert data.ncon >= 8

    def test_a_steady_push_balances_the_contact(self):
        model = compose([(-1.01, 0, 0), (1.01, 0, 0)], visual=False)
        data = mujoco.MjData(model)
        data.qfrc_applied[[0, 3]] = [100.0, -100.0]
        for _ in range(100):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_constraint[[0, 3]], [-100, 100], rtol=1e-3)


RENDER = """
import sys
import mujoco
import numpy as np
sys.path.insert(0, sys.argv[1])
from test_arena import RD, compose
robots = [(-20.0, 30.0, 0.0), (25.0, -40.0, 30.0)]
model = compose(robots)
model.geom("robot1/substrate").rgba[:] = [0.12, 0.28, 0.9, 1]
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
size = 800
with mujoco.Renderer(model, size, size) as renderer:
    renderer.update_scene(data, "above")
    image = renderer.render()
camera = model.camera("above")
focal = size / 2 / np.tan(np.radians(camera.fovy[0]) / 2)
corners = (("red", -20 + 0.7, 30 + 0.7, 0.4), ("blue", 25, -40 + 0.99, 0.4))
spots = [("dump", 0, 0, 0), ("dust", -16 * RD, 0, 0), ("dust", 16 * RD, 0, 0), ("floor", 0, 40, 0), *corners]
for name, x, y, z in spots:
    scale = focal / (camera.pos[2] - z)
    row, column = int(size / 2 - y * scale), int(size / 2 + x * scale)
    print("PIXEL", name, *image[row, column])
print("SPREAD", image.std())
"""


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_picture_from_above_shows_what_lies_where(backend):
    command = [sys.executable, "-c", RENDER, str(Path(__file__).parent)]
    run = subprocess.run(command, env={**os.environ, "MUJOCO_GL": backend}, capture_output=True, text=True, timeout=60)
    if "SPREAD" not in run.stdout:
        reason = run.stderr.strip().splitlines()[-1] if run.stderr else "no output"
        pytest.skip(f"no off-screen rendering with {backend}: {reason}")
    assert float(re.search(r"SPREAD (\S+)", run.stdout)[1]) > 10
    seen = [(m[1], *map(int, m[2].split())) for m in re.finditer(r"PIXEL (\w+) (.*)", run.stdout)]
    assert len(seen) == 6
    for name, red, green, blue in seen:
        hue = {
            "dump": min(red, green) > blue + 80,
            "dust": blue > green > red and blue > red + 80,
            "floor": max(red, green, blue) - min(red, green, blue) < 15 and red > 150,
            "red": red > 2 * max(green, blue),
            "blue": blue > 2 * red and blue > 1.5 * green,
        }
        assert hue[name], f"{name} looks like {(red, green, blue)}"
