"""What must hold of the story of each cell, by the parts that its task has. Units: mm, rd, rad."""

import math

import numpy as np

from iswarm_mj.geometry.obstacles import corners, numbers, poses_of_boxes
from iswarm_mj.geometry.walls import beyond, in_mm
from iswarm_mj.sensors.arena import arena_of
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.utils.units import MM, RD, mm_from_rd
from support.matrix import Story
from support.matrix_tasks import (
    CALM_AT,
    DIES_AT,
    DISC,
    DROPS_AT,
    GATE_STEP,
    LIFTS_AT,
    TASKS,
    Deaths,
    Gates,
    Tidy,
    Weather,
    laid_boxes,
    look,
)
from support.matrix_worlds import (
    AT_BOX,
    AT_DUMP,
    AT_OBSTACLE,
    AT_WALL,
    BOXES,
    GATES,
    HOLDERS,
    MORTAL,
    PUSHED,
    STEPS,
    UNTOUCHED,
)

OVERLAP = 0.4
"""Largest overlap of a robot with a wall or an obstacle [mm] (docs/robustness.md)."""
NEAR = 0.3
"""Largest distance of a robot from what it presses against [mm]."""
YIELDS = 0.03
"""A gate gives way by at most this to robots that press against it [mm]."""
STILL = 0.01
"""Robots and boxes that nobody pushes move by less [mm]."""


def check_what_it_saw(task, story: Story) -> None:
    """Task and metrics have the values of their own world, in each step those of its conditions."""
    for step in range(STEPS):
        for world, config in enumerate(story.configs[step]):
            seen = look(arena_of(config.arena), conditions_of(config))
            if isinstance(task, Weather):
                now = step + 1
                seen["lifting"] = seen["lifting"] if now == LIFTS_AT else 0.0
                seen["turning"] = 0.0 if now == CALM_AT else seen["turning"]
                seen["dropping"] = 1.0 if now >= DROPS_AT else seen["dropping"]
            for name, value in seen.items():
                assert story.metrics[name][step, world] == np.float32(value), (name, step, world)
    np.testing.assert_array_equal(
        story.task.step, np.broadcast_to(np.arange(1, STEPS + 1)[:, None], story.task.step.shape)
    )
    if story.reward is not None:
        arena = story.configs[0][0].arena
        np.testing.assert_allclose(story.reward, arena.size + arena.dust_area_offset, rtol=1e-6)


def hulls(story: Story, poses: np.ndarray) -> np.ndarray:
    """Return robots at poses (N, 3) as boxes."""
    halves = story.robot.each("half_edges", np.arange(len(poses)))[:, :2]
    return np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2]), halves])


def depth(one: np.ndarray, other: np.ndarray) -> float:
    """Return how deep two boxes overlap, negative where they do not: by the separating axes of
    both."""
    angle = [math.atan2(box[3], box[2]) for box in (one, other)]
    depths = []
    for yaw in (angle[0], angle[0] + math.pi / 2, angle[1], angle[1] + math.pi / 2):
        axis = np.array([math.cos(yaw), math.sin(yaw)])
        reach = [np.abs((corners(box[None])[0] - box[:2]) @ axis).max() for box in (one, other)]
        depths.append(sum(reach) - abs((one[:2] - other[:2]) @ axis))
    return min(depths)


def check_what_stands(story: Story) -> None:
    """Walls and obstacles hold, also where robots press against them."""
    obstacle = numbers(story.configs[0][0].arena.obstacles, RD)[0]
    for world, n_robots in enumerate(story.numbers):
        walls = in_mm(story.configs[0][world].arena.walls)
        for poses in story.poses[:, world]:
            robots = hulls(story, poses[:n_robots])
            out = beyond(corners(robots), walls).max(axis=1)
            into = [depth(robot, obstacle) for robot in robots]
            assert out.max() <= OVERLAP and max(into) <= OVERLAP, (world, out, into)
        assert out[AT_WALL] > -NEAR and into[AT_OBSTACLE] > -NEAR, (world, out, into)


def check_who_moves(task, story: Story) -> None:
    """Every second robot drives until it dies, the others stand; no robot lives in an empty
    place."""
    moved = np.linalg.norm(np.diff(story.poses[..., :2], axis=0), axis=-1)
    for world, n_robots in enumerate(story.numbers):
        assert (moved[:, world, [0, 2, 6]] < STILL).all() and not moved[:, world, n_robots:].any()
        alive = np.ones((STEPS, n_robots), bool)
        if isinstance(task, Deaths):
            alive[DIES_AT - 1 :, list(MORTAL)] = False
        np.testing.assert_array_equal(story.is_alive[:, world, :n_robots], alive)
        for robot in MORTAL:
            drives = moved[:, world, robot] > 1.0
            np.testing.assert_array_equal(drives, alive[:, robot])


def check_light(task, story: Story) -> None:
    """Robots hear those that live, and none that has died: it is dark from the next step on."""
    if story.record is None:
        return
    links = story.record.links
    for robot in MORTAL:
        heard = (links.valid & (links.sender == robot)).any(axis=(-2, -1))
        assert heard[:DIES_AT].any(axis=0).all(), (robot, heard)
        if isinstance(task, Deaths):
            assert not heard[DIES_AT:].any(), (robot, heard)
        else:
            assert robot == MORTAL[0] or heard[DIES_AT:].any(), (robot, heard)


def check_errors_of_drives(task, story: Story) -> None:
    """Drives err, but for the step that is calm."""
    if story.record is None:
        return
    errors = story.record.command.turn[..., AT_WALL]
    calm = np.zeros(STEPS, bool)
    calm[CALM_AT - 1] = isinstance(task, Weather)
    np.testing.assert_array_equal(errors == 0, np.broadcast_to(calm[:, None], errors.shape))


def check_boxes(task, story: Story) -> None:
    """Gates slide where the task drives them, and stand elsewhere; others stay where no robot
    pushes them."""
    for world, n_robots in enumerate(story.numbers):
        config, boxes = story.configs[0][world], story.boxes[:, world]
        rows = laid_boxes(config) if isinstance(task, Gates) and config.arena.outline else BOXES
        np.testing.assert_allclose(boxes[0], poses_of_boxes(rows), atol=1e-4)
        way = boxes - boxes[0]
        for gate, side in zip(GATES, (1, -1), strict=True):
            target = np.outer(
                np.arange(STEPS + 1), [0.0, side * GATE_STEP * isinstance(task, Gates)]
            )
            np.testing.assert_allclose(way[:, gate, :2], target, atol=YIELDS)
        assert np.abs(way[:, UNTOUCHED]).max() < STILL
        is_pushed = n_robots > AT_BOX
        assert (way[-1, PUSHED, 0] > 1.0) == is_pushed and (
            is_pushed or np.abs(way[:, PUSHED]).max() < STILL
        )


def check_balls(task, story: Story) -> None:
    """Robots lift the balls at their tools, keep them or lose them as the conditions say, and
    deliver on their dump."""
    if not isinstance(task, Tidy):
        return
    balls, last = story.task.balls, len(HOLDERS)
    for world, config in enumerate(story.configs[0]):
        dust = [-mm_from_rd(config.arena.dust_area_offset), 0.0]
        np.testing.assert_allclose(
            balls.position[:, world, last], np.broadcast_to(dust, (STEPS, 2)), rtol=1e-6
        )
        held, delivered = np.zeros((STEPS, last), bool), np.zeros((STEPS, last), bool)
        lifted = [robot % 2 == 0 for robot in HOLDERS] if isinstance(task, Weather) else True
        lifts_at = LIFTS_AT if isinstance(task, Weather) else 1
        held[lifts_at - 1 :] = lifted
        own = HOLDERS.index(AT_DUMP)
        for step in range(lifts_at, STEPS):
            tip = story.poses[0, world, AT_DUMP, 0] + tip_of(story)
            reaches = tip <= mm_from_rd(story.configs[step][world].arena.dump_size) / 2
            if reaches and held[step, own]:
                held[step:, own], delivered[step:, own] = False, True
        if isinstance(task, Weather):
            held[DROPS_AT - 1 :] = False
        np.testing.assert_array_equal(balls.is_held[:, world, :last], held, err_msg=str(world))
        np.testing.assert_array_equal(
            balls.is_delivered[:, world, :last], delivered, err_msg=str(world)
        )


def tip_of(story: Story) -> float:
    """Return how far ahead of the robots the tips of their tools are [mm]."""
    return float(story.robot.each("probe_tip", np.arange(1))[0, 0])


def check_areas(task, story: Story) -> None:
    """The floor shows the areas of each world, where they are in each step."""
    if story.drawn is None:
        return
    for world, (scene, frames) in enumerate(story.drawn):
        config = story.configs[-1][world]
        half = mm_from_rd(config.arena.dump_size) / 2 * MM
        if isinstance(task, Tidy):
            np.testing.assert_allclose(scene.dump, [-half, -half, half, half], rtol=1e-5)
            centre = mm_from_rd(config.arena.dust_area_offset) * MM
            np.testing.assert_allclose(
                scene.dust_areas[:, [0, 2]].mean(axis=1), [-centre, centre], rtol=1e-5
            )
        if "disc" in task.drawn:
            discs = np.concatenate([one.arrays()[DISC] for one in frames])[:, 0]
            for step, (x, y, radius) in enumerate(discs):
                arena = story.configs[step][world].arena
                expected = [
                    mm_from_rd(arena.dust_area_offset),
                    step + 1,
                    mm_from_rd(arena.dump_size) / 2,
                ]
                np.testing.assert_allclose([x, y, radius], MM * np.array(expected), rtol=1e-5)


def check(cell, story: Story) -> None:
    """Check all of a cell."""
    task = TASKS[cell.task]
    check_what_it_saw(task, story)
    check_what_stands(story)
    check_who_moves(task, story)
    check_light(task, story)
    check_errors_of_drives(task, story)
    check_boxes(task, story)
    check_balls(task, story)
    check_areas(task, story)
