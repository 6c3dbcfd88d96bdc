"""The arena: its model, arenas composed for any number of robots and balls, and one picture."""

import os
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers_models import MODELS, OUTWARD, RD, SPEED, load
from helpers_small import SMALL

from iswarm_mj.engines.arena import compile_arena


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
