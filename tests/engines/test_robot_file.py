"""What a robot's file must contain, and where its LEDs and photodiodes look; what cannot be run is refused."""

import os
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.robots import HALF, ROBOTS, Side, around, robot_file, robot_xml

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.planar.plane import read_kinds, read_plane
from iswarm_mj.engines.robot_file import models_directory, read_robot
from iswarm_mj.geometry.obstacles import distances, numbers
from iswarm_mj.geometry.robot import PAPER_SIDES
from iswarm_mj.tasks.layout import cell_of, free_cells, place_robots
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD


def written(directory, text):
    path = directory / "my_robot.xml"
    path.write_text(text)
    return path


def test_of_a_robot_with_six_sides(tmp_path):
    robot = read_robot(robot_file(tmp_path, "six"))
    turns = np.exp(1j * np.radians(np.arange(0, 360, 60)))
    for axes in (robot.sides.leds, robot.sides.photodiodes):
        np.testing.assert_allclose(np.array(axes) @ [1, 1j], turns, atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * np.array(robot.sides.led_bearings)), turns, atol=1e-12)
    corner = 0.8 / np.tan(np.radians(60))
    np.testing.assert_allclose(robot.leds[:3], [[1.2, 0], [corner, 0.8], [-corner, 0.8]], atol=1e-9)
    np.testing.assert_allclose(robot.photodiodes[0], [[1.2, 0.2], [1.2, -0.2]], atol=1e-9)
    assert robot.half_edges == (1.2, 0.8, 0.5) and robot.probe_tip == (1.1, 0.1)
    assert robot.sides.front == robot.sides.front_leds == (True, False, False, False, False, False)
    assert robot.sides.back_leds == (False, False, False, True, False, False)


def test_leds_and_photodiodes_of_one_side_may_look_differently(tmp_path):
    sides = read_robot(robot_file(tmp_path, "four askew")).sides
    np.testing.assert_allclose(np.degrees(sides.led_bearings), [20, 95, -170, -70], atol=1e-6)
    np.testing.assert_allclose(np.degrees(sides.bearings), [20, 80, -170, -60], atol=1e-6)


def test_sides_of_the_papers_robot_are_exact():
    assert read_robot().sides == PAPER_SIDES and PAPER_SIDES.is_regular
    assert PAPER_SIDES.bearings == tuple(k * (np.pi / 2) for k in range(4))
    assert PAPER_SIDES.front == PAPER_SIDES.front_leds == (True, False, False, False)
    assert PAPER_SIDES.back_leds == (False, False, True, False)


@pytest.mark.parametrize(
    ("angles", "front"), [((45, -45, 180), [0, 1]), ((30, -30, 60, 180), [0, 1]), ((70, -60, 200), [1])]
)
def test_front_sides_look_within_45_degrees_of_ahead_or_nearest_to_it(tmp_path, angles, front):
    sides = read_robot(written(tmp_path, robot_xml((1, 1), around((1, 1), angles, apart=0.01)))).sides
    assert np.flatnonzero(sides.front).tolist() == front


@pytest.mark.parametrize("name", ROBOTS)
def test_light_never_begins_farther_out_than_the_bound_says(tmp_path, name):
    robot = read_robot(robot_file(tmp_path, name))
    for x, y in (*robot.leds, *robot.receivers):
        assert np.hypot(x, y) <= robot.optical_offset + 1e-12


def test_large_robots_start_on_larger_cells(tmp_path):
    robot = read_robot(written(tmp_path, robot_xml((2.5, 1.5), around((2.5, 1.5), range(0, 360, 90)))))
    assert cell_of(robot) == pytest.approx(np.hypot(5, 3) / RD) and cell_of(read_robot()) == 1.0
    arena = replace(SwarmConfig().arena, obstacles=((9.0, 9.0, 1.0, 2.0, 30.0),))
    poses = place_robots(arena, 200, np.random.default_rng(0), cell_of(robot))
    apart = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=-1) + 1e9 * np.eye(200)
    assert apart.min() >= 2 * robot.circumradius - 1e-9
    assert np.abs(poses[:, :2]).max() + robot.circumradius <= arena.size / 2 * RD + 1e-9
    cells = free_cells(arena, cell_of(robot))
    assert len(cells) < len(free_cells(arena)) < 2376
    assert distances(cells, numbers(arena.obstacles, RD)).min() >= robot.circumradius - 1e-9


def test_a_copy_elsewhere_takes_the_meshes_from_the_package(tmp_path):
    path = written(tmp_path, (models_directory() / "robot.xml").read_text())
    assert read_robot(path) == read_robot()
    arena = compile_arena(SwarmConfig(), 2, np.zeros(0), visual=True, robot_file=path)
    assert arena.model.nmesh == compile_arena(SwarmConfig(), 2, np.zeros(0), visual=True).model.nmesh > 0


PAPER = (models_directory() / "robot.xml").read_text()
RING = around(HALF, range(0, 360, 40), apart=0.01)


def without(kind, name):
    """The paper's file without the element of this name."""
    return PAPER.replace(f'<{kind} name="{name}"', f'<{kind} name="another"')


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<mujoco", "cannot be read as MJCF"),
        ("<mujoco/>", "lacks body robot, body visual, joint x, .* geom hull, .* site probe_tip, site led0"),
        (without("body", "visual"), "lacks body visual"),
        (without("site", "photodiode2b"), "lacks site photodiode2b"),
        (PAPER.replace('size="1 1 0.5" mass="10"', 'size="1 1 0.5" mass="0"'), "cannot be compiled"),
        (PAPER.replace('name="x" class="drive"', 'name="x" class="drive" ref="1"'), "joints without ref"),
        (PAPER.replace('"drive" axis="1 0 0"', '"drive" axis="0 0 1"'), "the joints x and"),
        (PAPER.replace('class="hull" size="1 1 0.5"', 'class="hull" type="ellipsoid" size="1 1 0.5"'), "a box as hull"),
        (PAPER.replace('class="hull" size', 'class="hull" euler="0 0 5" size'), "not turned"),
        (PAPER.replace('name="robot" pos="0 0 0.5"', 'name="robot" pos="0 0 0.5" euler="0 0 5"'), "not turned"),
        (PAPER.replace('type="hinge"', 'type="hinge" pos="0.1 0 0"'), "a hinge about z"),
        (PAPER.replace('pos="0.9 0 -0.445"', 'pos="0.9 0 -0.5"'), "tip is above the floor"),
        (PAPER.replace("<!-- The tip", '<geom name="tail" size="0.1" mass="1"/><!-- The tip'), "no geoms but `hull`"),
        (PAPER.replace("<!-- The tip", '<body name="tail"/><!-- The tip'), "no bodies but `robot`"),
        (PAPER.replace('"led0" class="optics" pos="1.001 0 0" xyaxes="1 0 0 0 1 0"',
                       '"led0" class="optics" pos="1.001 0 0" xyaxes="1 0 1 0 1 0"'), "along the floor"),
        (PAPER.replace('name="robot" pos="0 0 0.5"', 'name="robot" pos="0 0 0.6"'), "must stand on the floor"),
        (PAPER.replace('class="hull" size', 'class="hull" pos="0.1 0 0" size'), "must stand on the floor"),
        (robot_xml(HALF, [Side(1.2, 0.0, 0)]), "lacks site led1"),
        (robot_xml(HALF, RING), "2 to 8 LEDs, .* three bits .* number 8"),
        (robot_xml(HALF, [Side(1.2, 0.0, 10), Side(1.2, 0.4, 10)]), "LEDs 0 and 1 .* look the same way"),
        (robot_xml(HALF, [Side(1.2, 0.0, 10), Side(1.2, 0.4, 40), Side(1.2, 0.2, 20, 20)]),
         "pairs of photodiodes 1 and 2 .* look the same way"),
        (robot_xml(HALF, [Side(1.2, 0.0, 0), Side(-1.2, 0.0, 20)]), "led1 .* look away from it"),
        (robot_xml(HALF, [Side(1.2, 0.0, 0), Side(1.3, 1.0, -10)]), "led1 .* look away from it"),
        (PAPER.replace('a" class="optics" pos="1.001 0.36 0" xyaxes="1 0 0 0 1 0"',
                       'a" class="optics" pos="1.001 0.36 0" xyaxes="1 1 0 -1 1 0"'), "must look the same way"),
    ],
)  # fmt: skip
def test_what_cannot_be_run_is_refused_in_a_sentence(tmp_path, text, reason):
    path = written(tmp_path, text)
    with pytest.raises(UserError, match=reason) as refused:
        read_robot(path)
    assert str(path) in str(refused.value) or "2 to 8" in str(refused.value)
    assert "\n" not in str(refused.value)


def appended(section):
    """The paper's file with one more section at its end."""
    return PAPER.replace("</mujoco>", section + "</mujoco>")


def joint_x(attributes):
    """The paper's file with these attributes of the joint x."""
    return PAPER.replace('name="x" class="drive"', f'name="x" class="drive" {attributes}')


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (appended('<equality><weld body1="robot"/></equality>'), "equality constraints"),
        (appended('<tendon><fixed><joint joint="x" coef="1"/></fixed></tendon>'), "tendons"),
        (appended('<actuator><position joint="x" kp="1"/></actuator>'), "actuators"),
        (appended('<contact><pair geom1="hull" geom2="hull"/></contact>'), "contact pairs"),
        (appended('<contact><exclude body1="robot" body2="world"/></contact>'), "contact exclusions"),
        (joint_x('limited="true" range="-1 1"'), "joint limits"),
        (joint_x('stiffness="1e6"'), "joint stiffness"),
        (joint_x('damping="100 1"'), "damping that grows with speed"),
        (joint_x('frictionloss="1e9"'), "friction loss"),
    ],
)
def test_what_no_engine_simulates_is_refused_by_name(tmp_path, text, part):
    path = written(tmp_path, text)
    assert text != PAPER
    with pytest.raises(UserError, match=f"has {part}; .* remove") as refused:
        compile_arena(SwarmConfig(), 2, np.zeros(0), robot_file=path)
    assert str(path) in str(refused.value) and "\n" not in str(refused.value)


BODY = '<body name="robot"'
ENDLESS = {
    "replicate": (BODY, '<replicate count="2000000000" offset="1 0 0"><site/></replicate>' + BODY),
    "hfield": ("<asset>", '<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/>'),
    "include": ("<asset>", '<include file="pipe"/><asset>'),
    "DOCTYPE": ("<mujoco ", '<!DOCTYPE a [<!ENTITY b "c">]><mujoco '),
    "nkey": ('nkey="0"', 'nkey="2000000000"'),
    "width": ("<asset>", '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="8"/>'),
    "height": ("<asset>", '<asset><texture name="t" type="2d" builtin="flat" width="8" height="4097"/>'),
    **{part: (BODY, f"<{part}/>{BODY}") for part in ("composite", "flexcomp", "attach", "model")},
}


@pytest.mark.parametrize(("names", "change"), ENDLESS.items(), ids=ENDLESS.keys())
def test_small_files_of_huge_robots_are_refused_before_mujoco_parses_them(tmp_path, monkeypatch, names, change):
    os.mkfifo(tmp_path / "pipe")
    path = written(tmp_path, PAPER.replace(*change))
    assert path.read_text() != PAPER
    monkeypatch.setattr(mujoco, "MjSpec", None)
    with pytest.raises(UserError, match=f"{names}.* line [0-9]+[ ;].*: (write the parts out|lower it)") as refused:
        read_robot(path)
    assert str(path) in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize("asset", ['texture name="t" type="2d"', 'mesh name="m"', 'skin name="s"'])
def test_files_that_a_robot_names_must_be_files(tmp_path, asset):
    """MuJoCo would wait for a pipe's end."""
    os.mkfifo(tmp_path / "pipe")
    path = written(tmp_path, PAPER.replace("<asset>", f'<asset><{asset} file="{tmp_path}/pipe"/>'))
    with pytest.raises(UserError, match=r"cannot be read as MJCF \(it is a pipe or a device"):
        read_robot(path)


def test_counts_up_to_the_limit_are_read(tmp_path):
    path = written(tmp_path, PAPER.replace('nkey="0"', 'nkey="0" nuser_site="16" memory="1M"'))
    assert read_robot(path) == read_robot()


def test_a_file_that_mujoco_warns_of_leaves_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mujoco.set_mju_user_warning(None)
    path = written(tmp_path, PAPER.replace('size="1 1 0.5"', 'size="nan nan 0.5"'))
    with pytest.raises(UserError, match="cannot be compiled"):
        read_robot(path)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


@pytest.mark.parametrize(("height", "runs"), [(0.7, True), (0.69, False)])
def test_the_planar_engine_refuses_flat_robots(tmp_path, height, runs):
    text = robot_xml(HALF, ROBOTS["three"], height=height).replace('0 -0.445"', f'0 {0.055 - height / 2}"')
    text = text.replace('pos="0.9 0.0 -0.445"', f'pos="0.9 0 {0.055 - height / 2}"')
    arena = compile_arena(SwarmConfig(), 1, np.zeros(0), robot_file=written(tmp_path, text))
    if runs:
        assert read_kinds(arena)[0].half_y == 0.8
    else:
        with pytest.raises(UserError, match=r"at least 0\.7 mm high"):
            read_plane(arena)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(UserError, match=r"none.xml cannot be read as MJCF \(there is none\); give a copy of"):
        read_robot(tmp_path / "none.xml")
