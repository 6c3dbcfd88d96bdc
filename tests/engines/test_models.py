"""MJCF models of robot, ball and arena: names, sizes, masses, and dynamics without visual parts."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from support.small import SMALL

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.robot_file import without_visual

MODELS = Path(__file__).resolve().parents[2] / "models"
RD = 2 * np.sqrt(2.0)
"""Robot diameter [mm]."""
GRAVITY = 9810
"""Acceleration of gravity [mm/s^2]."""
OUTWARD = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)
"""Outward normals of the walls, 0 to 3."""


def load(name: str) -> mujoco.MjModel:
    """Return the model of a file."""
    return mujoco.MjModel.from_xml_path(str(MODELS / name))


def forwarded(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the model of a file, with positions of its parts in the world."""
    model = load(name)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("name", ["robot.xml", "ball.xml", "arena.xml"])
class TestEveryModel:
    def test_is_in_mm_mg_s(self, name):
        model = load(name)
        np.testing.assert_array_equal(model.opt.gravity, [0, 0, -GRAVITY])
        assert model.opt.timestep == 0.05

    def test_leaves_no_default_in_metres(self, name):
        model = load(name)
        metric = mujoco.MjModel.from_xml_string("<mujoco/>")
        assert model.opt.sleep_tolerance != metric.opt.sleep_tolerance
        assert model.opt.ccd_tolerance != metric.opt.ccd_tolerance
        assert (model.geom_solref != [0.02, 1]).any(axis=1).all()
        assert (model.geom_solimp[:, 2] != 0.001).all()
        assert (model.jnt_solref != [0.02, 1]).any(axis=1).all()

    def test_compiles_without_warnings(self, name, recwarn):
        load(name)
        assert [str(warning.message) for warning in recwarn] == []


@pytest.mark.parametrize("name", ["robot.xml", "robot6.xml", "arena.xml"])
def test_contacts_in_files_are_those_of_the_default_drive(name):
    model = load(name)
    arena = compile_arena(SwarmConfig(), 1, np.zeros(0)).model
    collides = model.geom_contype > 0
    for attribute in ("geom_solref", "geom_solimp", "geom_margin"):
        in_file = getattr(model, attribute)[collides]
        in_arena = getattr(arena, attribute)[arena.geom_contype > 0]
        np.testing.assert_allclose(in_file, in_arena[: len(in_file)], rtol=1e-4)


class TestRobot:
    def test_has_the_names_that_robots_files_need(self):
        model = load("robot.xml")
        optics = [f"led{side}" for side in range(4)]
        optics += [f"photodiode{side}{which}" for side in range(4) for which in "ab"]
        seen = ["substrate", "leg0", "leg1", "leg2", "chip", "solar_cell", "probe", *optics]
        for body in ["robot", "visual", *seen]:
            assert model.body(body).name == body
        for site in ["probe_tip", *optics]:
            assert model.site(site).bodyid == model.body("robot").id
        for geom in ["hull", *seen]:
            assert model.geom(geom).name == geom
        assert [model.joint(index).name for index in range(model.njnt)] == ["x", "y", "yaw"]

    def test_hull_alone_collides(self):
        model = load("robot.xml")
        colliding = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
        np.testing.assert_array_equal(colliding, [model.geom("hull").id])
        assert model.geom("hull").condim == 1
        assert model.geom("hull").group == 3
        visual = np.delete(np.arange(model.ngeom), colliding)
        assert (model.geom_group[visual] == 2).all()

    def test_drive_has_a_time_constant_of_one_time_step_on_every_axis(self):
        model = load("robot.xml")
        inertia = [10, 10, 20 / 3]
        np.testing.assert_allclose(inertia / model.dof_damping, model.opt.timestep)

    def test_probe_is_26_um_wide_and_ends_at_its_tip(self):
        model, data = forwarded("robot.xml")
        radius, half_length, _ = model.geom("probe").size
        assert radius == pytest.approx(0.013)
        end = data.geom("probe").xpos - [0, 0, half_length]
        np.testing.assert_allclose(data.site("probe_tip").xpos, end, atol=1e-12)

    def test_leg_is_what_the_script_makes(self, tmp_path):
        script = MODELS.parent / "tools" / "make" / "make_meshes.py"
        subprocess.run([sys.executable, str(script), str(tmp_path)], check=True, timeout=60)
        assert texts_in(tmp_path) == texts_in(MODELS / "meshes")


def texts_in(directory: Path) -> dict[str, str]:
    """Return contents of the files in a directory, by name."""
    return {path.name: path.read_text() for path in directory.iterdir()}


def trajectory(model: mujoco.MjModel) -> np.ndarray:
    """Return positions and velocities in ten steps under a constant force."""
    data = mujoco.MjData(model)
    data.qfrc_applied[:3] = [250.0, -80.0, 60.0]
    rows = []
    for _ in range(10):
        mujoco.mj_step(model, data)
        rows.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(rows)


def test_stripping_the_visual_parts_leaves_the_dynamics():
    full = load("robot.xml")
    spec = mujoco.MjSpec.from_file(str(MODELS / "robot.xml"))
    stripped = without_visual(spec).compile()
    assert stripped.ngeom == 1
    assert stripped.nsite == full.nsite == 13
    np.testing.assert_array_equal(trajectory(stripped), trajectory(full))


class TestBall:
    def test_is_a_solder_ball(self):
        model = load("ball.xml")
        ball = model.geom("ball")
        assert model.body("ball").mocapid[0] == 0
        assert ball.type == mujoco.mjtGeom.mjGEOM_SPHERE
        assert ball.size[0] == pytest.approx(0.02)
        assert (ball.contype, ball.conaffinity, ball.group) == (0, 0, 1)

    @pytest.mark.parametrize("radius, weight", [(0.015, 1.02), (0.020, 2.42), (0.025, 4.72)])
    def test_weight_in_nanonewtons(self, radius, weight):
        spec = mujoco.MjSpec.from_file(str(MODELS / "ball.xml"))
        spec.geom("ball").size[0] = radius
        model = spec.compile()
        # 7.4 mg/mm^3 against the 7400 kg/m^3 of which the table gives three figures.
        assert model.body("ball").mass[0] * GRAVITY == pytest.approx(weight, rel=0.01)


class TestArena:
    def test_only_walls_collide(self):
        model = load("arena.xml")
        colliding = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
        assert {model.geom(geom).name for geom in colliding} == {f"wall{k}" for k in range(4)}

    def test_has_cameras_light_and_a_large_framebuffer(self):
        model = load("arena.xml")
        assert {model.camera(index).name for index in range(model.ncam)} == {"above", "oblique"}
        assert model.nlight == 1
        assert min(model.vis.global_.offwidth, model.vis.global_.offheight) >= 1280


def test_floor_markings_balls_and_cameras_follow_the_configuration():
    """An arena four times as long as wide, off the middle; the file's is a square of 49 rd."""
    corners = ((-4.0, -4.0), (6.0, -4.0), (6.0, 36.0), (-4.0, 36.0))
    long_arena = replace(
        SMALL.arena,
        size=49.0,
        outline=corners,
        dust_area_size=1.5,
        dust_area_offset=2.6,
    )
    config = replace(SMALL, arena=long_arena)
    ball_radius = np.array([20e-6, 30e-6])
    arena = compile_arena(config, 1, ball_radius)
    model = arena.model

    # The floor has cells of 1 rd, two by two in a picture.
    floor = model.geom("floor")
    south_west = RD * np.array(corners[0])
    north_east = RD * np.array(corners[2])
    np.testing.assert_allclose(floor.pos[:2] - floor.size[:2], south_west)
    np.testing.assert_allclose(floor.pos[:2] + floor.size[:2], north_east)
    np.testing.assert_allclose(model.material("floor").texrepeat, [5, 20])

    np.testing.assert_allclose(model.geom("dump").size[:2], 1.5 * RD)
    for name, x in (("dust_west", -2.6), ("dust_east", 2.6)):
        area = model.geom(name)
        assert area.pos[0] == pytest.approx(x * RD)
        np.testing.assert_allclose(area.size[:2], 0.75 * RD)

    balls = [model.geom(f"ball{k}/ball") for k in range(2)]
    np.testing.assert_allclose([ball.size[0] for ball in balls], [0.02, 0.03])
    mocap = [model.body(f"ball{k}/ball").mocapid[0] for k in range(2)]
    assert arena.mocap.tolist() == mocap == [0, 1]

    size = config.arena.size
    file = load("arena.xml")
    for camera in ("above", "oblique"):
        distance_per_size = model.camera(camera).pos / size
        np.testing.assert_allclose(distance_per_size, file.camera(camera).pos / 49)


def test_panels_of_a_small_arena_stand_behind_its_walls():
    """Their inner faces at the walls, from corner to corner, so that a picture shows no gap."""
    model = compile_arena(SMALL, 1, np.zeros(0)).model
    edge = SMALL.arena.size / 2 * RD
    thickness = 2 * min(model.geom("panel0").size[:2])
    for k, outward in enumerate(OUTWARD):
        panel = model.geom(f"panel{k}")
        half_thickness, half_length, _ = panel.size
        along_wall = np.abs(outward[[1, 0, 2]])
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, panel.quat)

        assert model.geom(f"wall{k}").pos @ outward == pytest.approx(edge)
        assert panel.pos @ outward - half_thickness == pytest.approx(edge)
        np.testing.assert_allclose(rotation.reshape(3, 3)[:, 0], outward, atol=1e-12)
        assert half_thickness == pytest.approx(thickness / 2)
        assert half_length == pytest.approx(edge + thickness)
        assert panel.pos @ along_wall == 0


@pytest.mark.parametrize("k", range(4))
def test_walls_face_inwards(k):
    """MuJoCo's planes stop what comes from the side of their normal, the z axis."""
    wall = compile_arena(SMALL, 1, np.zeros(0)).model.geom(f"wall{k}")
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, wall.quat)
    np.testing.assert_allclose(rotation.reshape(3, 3)[:, 2], -OUTWARD[k], atol=1e-12)
