"""Robots' files: required parts, directions of LEDs and photodiodes, and refused files."""

import os
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.robots import HALF, ROBOTS, Side, around, robot_file, robot_xml
from support.systems import needs_named_pipes

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.planar.plane import read_kinds, read_plane
from iswarm_mj.engines.robot_file import models_directory, read_robot
from iswarm_mj.geometry.obstacles import distances, numbers
from iswarm_mj.geometry.robot import PAPER_SIDES
from iswarm_mj.tasks.layout import cell_of, free_cells, place_robots
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

PAPER = (models_directory() / "robot.xml").read_text()
"""File of the paper's robot."""


def write_file(directory, text):
    """Return the path of a robot's file with this text."""
    path = directory / "my_robot.xml"
    path.write_text(text)
    return path


def test_a_robot_with_six_sides(tmp_path):
    robot = read_robot(robot_file(tmp_path, "six"))
    assert robot.half_edges == (1.2, 0.8, 0.5)
    assert robot.probe_tip == (1.1, 0.1)

    directions = np.exp(1j * np.radians(np.arange(0, 360, 60)))
    for axes in (robot.sides.leds, robot.sides.photodiodes):
        np.testing.assert_allclose(np.array(axes) @ [1, 1j], directions, atol=1e-12)
    led_directions = np.exp(1j * np.array(robot.sides.led_bearings))
    np.testing.assert_allclose(led_directions, directions, atol=1e-12)

    x = 0.8 / np.tan(np.radians(60))  # where an axis at 60 degrees leaves the hull
    np.testing.assert_allclose(robot.leds[:3], [[1.2, 0], [x, 0.8], [-x, 0.8]], atol=1e-9)
    np.testing.assert_allclose(robot.photodiodes[0], [[1.2, 0.2], [1.2, -0.2]], atol=1e-9)

    front_alone = (True, False, False, False, False, False)
    assert robot.sides.front == robot.sides.front_leds == front_alone
    assert robot.sides.back_leds == (False, False, False, True, False, False)


def test_leds_and_photodiodes_of_one_side_may_look_differently(tmp_path):
    sides = read_robot(robot_file(tmp_path, "four askew")).sides
    np.testing.assert_allclose(np.degrees(sides.led_bearings), [20, 95, -170, -70], atol=1e-6)
    np.testing.assert_allclose(np.degrees(sides.bearings), [20, 80, -170, -60], atol=1e-6)


def test_sides_of_the_papers_robot_are_exact():
    assert read_robot().sides == PAPER_SIDES
    assert PAPER_SIDES.is_regular
    assert PAPER_SIDES.bearings == tuple(k * (np.pi / 2) for k in range(4))
    assert PAPER_SIDES.front == PAPER_SIDES.front_leds == (True, False, False, False)
    assert PAPER_SIDES.back_leds == (False, False, True, False)


@pytest.mark.parametrize(
    ("angles", "front"),
    [((45, -45, 180), [0, 1]), ((30, -30, 60, 180), [0, 1]), ((70, -60, 200), [1])],
)
def test_front_sides_look_within_45_degrees_of_ahead_or_nearest_to_it(tmp_path, angles, front):
    text = robot_xml((1, 1), around((1, 1), angles, apart=0.01))
    sides = read_robot(write_file(tmp_path, text)).sides
    assert np.flatnonzero(sides.front).tolist() == front


@pytest.mark.parametrize("name", ROBOTS)
def test_light_never_begins_farther_out_than_the_bound_says(tmp_path, name):
    robot = read_robot(robot_file(tmp_path, name))
    for x, y in (*robot.leds, *robot.receivers):
        assert np.hypot(x, y) <= robot.optical_offset + 1e-12


def test_large_robots_start_on_larger_cells(tmp_path):
    half_edges = (2.5, 1.5)
    text = robot_xml(half_edges, around(half_edges, range(0, 360, 90)))
    robot = read_robot(write_file(tmp_path, text))
    cell = cell_of(robot)
    assert cell == pytest.approx(np.hypot(5, 3) / RD)
    assert cell_of(read_robot()) == 1.0

    n_robots = 200
    arena = replace(SwarmConfig().arena, obstacles=((9.0, 9.0, 1.0, 2.0, 30.0),))
    centres = place_robots(arena, n_robots, np.random.default_rng(0), cell)[:, :2]
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    distance += 1e9 * np.eye(n_robots)
    assert distance.min() >= 2 * robot.circumradius - 1e-9
    assert np.abs(centres).max() + robot.circumradius <= arena.size / 2 * RD + 1e-9

    cells = free_cells(arena, cell)
    assert len(cells) < len(free_cells(arena)) < 2376
    to_obstacle = distances(cells, numbers(arena.obstacles, RD))
    assert to_obstacle.min() >= robot.circumradius - 1e-9


def test_a_copy_elsewhere_takes_the_meshes_from_the_package(tmp_path):
    path = write_file(tmp_path, PAPER)
    assert read_robot(path) == read_robot()

    config = SwarmConfig()
    of_copy = compile_arena(config, 2, np.zeros(0), visual=True, robot_file=path).model
    of_package = compile_arena(config, 2, np.zeros(0), visual=True).model
    assert of_copy.nmesh == of_package.nmesh > 0


NINE_SIDES = around(HALF, range(0, 360, 40), apart=0.01)


def without(kind, name):
    """Return the paper's file in which the element of this name has another one."""
    return PAPER.replace(f'<{kind} name="{name}"', f'<{kind} name="another"')


def changed(old, new):
    """Return the paper's file with a text replaced."""
    assert old in PAPER
    return PAPER.replace(old, new)


BODY = 'name="robot" pos="0 0 0.5"'
HULL = 'class="hull" size="1 1 0.5"'
JOINT_X = 'name="x" class="drive"'
BEFORE_TIP = "<!-- The tip"
LED_0 = '"led0" class="optics" pos="1.001 0 0" xyaxes='
PHOTODIODE_0A = 'a" class="optics" pos="1.001 0.36 0" xyaxes='

REFUSED = {
    "no XML": ("<mujoco", "cannot be read as MJCF"),
    "nothing": (
        "<mujoco/>",
        "lacks body robot, body visual, joint x, .* geom hull, .* site probe_tip, site led0",
    ),
    "no visual body": (without("body", "visual"), "lacks body visual"),
    "no photodiode": (without("site", "photodiode2b"), "lacks site photodiode2b"),
    "no mass": (changed(HULL + ' mass="10"', HULL + ' mass="0"'), "cannot be compiled"),
    "ref": (changed(JOINT_X, JOINT_X + ' ref="1"'), "joints without ref"),
    "vertical axis": (changed('"drive" axis="1 0 0"', '"drive" axis="0 0 1"'), "the joints x and"),
    "ellipsoid": (
        changed('"hull" size="1 1', '"hull" type="ellipsoid" size="1 1'),
        "a box as hull",
    ),
    "turned hull": (changed('class="hull" size', 'class="hull" euler="0 0 5" size'), "not turned"),
    "turned body": (changed(BODY, BODY + ' euler="0 0 5"'), "not turned"),
    "hinge aside": (changed('type="hinge"', 'type="hinge" pos="0.1 0 0"'), "a hinge about z"),
    "low tip": (changed('"0.9 0 -0.445"', '"0.9 0 -0.5"'), "tip is above the floor"),
    "another geom": (
        changed(BEFORE_TIP, '<geom name="tail" size="0.1" mass="1"/>' + BEFORE_TIP),
        "no geoms but `hull`",
    ),
    "another body": (
        changed(BEFORE_TIP, '<body name="tail"/>' + BEFORE_TIP),
        "no bodies but `robot`",
    ),
    "LED looks up": (
        changed(LED_0 + '"1 0 0 0 1 0"', LED_0 + '"1 0 1 0 1 0"'),
        "along the floor",
    ),
    "high body": (changed(BODY, 'name="robot" pos="0 0 0.6"'), "must stand on the floor"),
    "hull aside": (
        changed('class="hull" size', 'class="hull" pos="0.1 0 0" size'),
        "must stand on the floor",
    ),
    "one side": (robot_xml(HALF, [Side(1.2, 0.0, 0)]), "lacks site led1"),
    "nine sides": (robot_xml(HALF, NINE_SIDES), "2 to 8 LEDs, .* three bits .* number 8"),
    "equal LEDs": (
        robot_xml(HALF, [Side(1.2, 0.0, 10), Side(1.2, 0.4, 10)]),
        "LEDs 0 and 1 .* look the same way",
    ),
    "equal pairs": (
        robot_xml(HALF, [Side(1.2, 0.0, 10), Side(1.2, 0.4, 40), Side(1.2, 0.2, 20, 20)]),
        "pairs of photodiodes 1 and 2 .* look the same way",
    ),
    "LED looks inwards": (
        robot_xml(HALF, [Side(1.2, 0.0, 0), Side(-1.2, 0.0, 20)]),
        "led1 .* look away from it",
    ),
    "LED looks past": (
        robot_xml(HALF, [Side(1.2, 0.0, 0), Side(1.3, 1.0, -10)]),
        "led1 .* look away from it",
    ),
    "unequal photodiodes": (
        changed(PHOTODIODE_0A + '"1 0 0 0 1 0"', PHOTODIODE_0A + '"1 1 0 -1 1 0"'),
        "must look the same way",
    ),
}
"""Files of robots that cannot be simulated, and the reason that the error gives."""


@pytest.mark.parametrize(("text", "reason"), REFUSED.values(), ids=REFUSED.keys())
def test_robots_that_cannot_be_simulated_are_refused_in_a_sentence(tmp_path, text, reason):
    path = write_file(tmp_path, text)
    with pytest.raises(UserError, match=reason) as refused:
        read_robot(path)
    assert str(path) in str(refused.value) or "2 to 8" in str(refused.value)
    assert "\n" not in str(refused.value)


def appended(section):
    """Return the paper's file with one more section at its end."""
    return changed("</mujoco>", section + "</mujoco>")


def joint_x(attributes):
    """Return the paper's file with these attributes of the joint x."""
    return changed(JOINT_X, f"{JOINT_X} {attributes}")


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (appended('<equality><weld body1="robot"/></equality>'), "equality constraints"),
        (appended('<tendon><fixed><joint joint="x" coef="1"/></fixed></tendon>'), "tendons"),
        (appended('<actuator><position joint="x" kp="1"/></actuator>'), "actuators"),
        (appended('<contact><pair geom1="hull" geom2="hull"/></contact>'), "contact pairs"),
        (
            appended('<contact><exclude body1="robot" body2="world"/></contact>'),
            "contact exclusions",
        ),
        (joint_x('limited="true" range="-1 1"'), "joint limits"),
        (joint_x('stiffness="1e6"'), "joint stiffness"),
        (joint_x('damping="100 1"'), "damping that grows with speed"),
        (joint_x('frictionloss="1e9"'), "friction loss"),
    ],
)
def test_parts_that_no_engine_simulates_are_refused_by_name(tmp_path, text, part):
    path = write_file(tmp_path, text)
    with pytest.raises(UserError, match=f"has {part}; .* remove") as refused:
        compile_arena(SwarmConfig(), 2, np.zeros(0), robot_file=path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def before_body(element):
    """Return the paper's file with an element before the robot's body."""
    return changed('<body name="robot"', element + '<body name="robot"')


def in_assets(element):
    """Return the paper's file with an element among its assets."""
    return changed("<asset>", "<asset>" + element)


def with_texture(size):
    """Return the paper's file with a texture of this size."""
    return in_assets(f'<texture name="t" type="2d" builtin="flat" {size}/>')


HUGE = {
    "replicate": before_body('<replicate count="2000000000" offset="1 0 0"><site/></replicate>'),
    "hfield": in_assets('<hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/>'),
    "include": changed("<asset>", '<include file="pipe"/><asset>'),
    "DOCTYPE": changed("<mujoco ", '<!DOCTYPE a [<!ENTITY b "c">]><mujoco '),
    "nkey": changed('nkey="0"', 'nkey="2000000000"'),
    "width": with_texture('width="100000" height="8"'),
    "height": with_texture('width="8" height="4097"'),
    "composite": before_body("<composite/>"),
    "flexcomp": before_body("<flexcomp/>"),
    "attach": before_body("<attach/>"),
    "model": before_body("<model/>"),
}
"""Small files of huge robots, by what the error names."""


@needs_named_pipes
@pytest.mark.parametrize(("name", "text"), HUGE.items(), ids=HUGE.keys())
def test_small_files_of_huge_robots_are_refused_before_parsing(tmp_path, monkeypatch, name, text):
    os.mkfifo(tmp_path / "pipe")
    path = write_file(tmp_path, text)
    monkeypatch.setattr(mujoco, "MjSpec", None)
    message = f"{name}.* line [0-9]+[ ;].*: (write the parts out|lower it)"
    with pytest.raises(UserError, match=message) as refused:
        read_robot(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


@needs_named_pipes
@pytest.mark.parametrize("asset", ['texture name="t" type="2d"', 'mesh name="m"', 'skin name="s"'])
def test_files_that_a_robot_names_must_be_files(tmp_path, asset):
    """MuJoCo would wait for a pipe's end."""
    os.mkfifo(tmp_path / "pipe")
    path = write_file(tmp_path, in_assets(f'<{asset} file="{tmp_path}/pipe"/>'))
    with pytest.raises(UserError, match=r"cannot be read as MJCF \(it is a pipe or a device"):
        read_robot(path)


def test_counts_up_to_the_limit_are_read(tmp_path):
    counts = 'nkey="0" nuser_site="16" memory="1M"'
    path = write_file(tmp_path, changed('nkey="0"', counts))
    assert read_robot(path) == read_robot()


def test_a_file_that_mujoco_warns_of_leaves_no_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mujoco.set_mju_user_warning(None)
    path = write_file(tmp_path, changed('size="1 1 0.5"', 'size="nan nan 0.5"'))
    with pytest.raises(UserError, match="cannot be compiled"):
        read_robot(path)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def arena_of_flat_robots(directory, height):
    """Return the arena of robots of this height, whose tip is where the paper's robot has it."""
    tip = 0.055 - height / 2  # from the middle of the hull [mm]
    text = robot_xml(HALF, ROBOTS["three"], height=height)
    text = text.replace('pos="0.9 0.0 -0.445"', f'pos="0.9 0 {tip}"')
    return compile_arena(SwarmConfig(), 1, np.zeros(0), robot_file=write_file(directory, text))


def test_the_planar_engine_takes_robots_of_the_lowest_height(tmp_path):
    arena = arena_of_flat_robots(tmp_path, 0.7)
    assert read_kinds(arena)[0].half_y == 0.8


def test_the_planar_engine_refuses_flat_robots(tmp_path):
    arena = arena_of_flat_robots(tmp_path, 0.69)
    with pytest.raises(UserError, match=r"at least 0\.7 mm high"):
        read_plane(arena)


def test_a_file_that_is_not_there(tmp_path):
    message = r"none.xml cannot be read as MJCF \(there is none\); give a copy of"
    with pytest.raises(UserError, match=message):
        read_robot(tmp_path / "none.xml")
