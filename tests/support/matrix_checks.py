"""Checks of the story of a cell, by the parts that its task has. Units: mm, rd, rad."""

import math

import numpy as np

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.geometry.obstacles import corners, numbers, poses_of_boxes
from iswarm_mj.geometry.walls import beyond, in_mm
from iswarm_mj.output.trajectory import Scene
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
"""Largest distance by which a gate gives way to robots that press against it [mm]."""
STILL = 0.01
"""Largest distance by which robots and boxes move that nobody pushes [mm]."""


def check_what_it_saw(task, story: Story) -> None:
    """Check that the task saw the settings of its own world, and the conditions of each step."""
    for step in range(STEPS):
        for world, config in enumerate(story.configs[step]):
            expected = expected_sight(task, config, step + 1)
            for name, value in expected.items():
                assert story.metrics[name][step, world] == np.float32(value), (name, step, world)

    steps_taken = np.arange(1, STEPS + 1)[:, None]
    np.testing.assert_array_equal(
        story.task.step, np.broadcast_to(steps_taken, story.task.step.shape)
    )
    if story.reward is not None:
        arena = story.configs[0][0].arena
        np.testing.assert_allclose(story.reward, arena.size + arena.dust_area_offset, rtol=1e-6)


def expected_sight(task, config: SwarmConfig, step: int) -> dict[str, float]:
    """Return what a task has to see in a control step, counted from 1."""
    sight = look(arena_of(config.arena), conditions_of(config))
    if not isinstance(task, Weather):
        return sight
    if step != LIFTS_AT:
        sight["lifting"] = 0.0
    if step == CALM_AT:
        sight["turning"] = 0.0
    if step >= DROPS_AT:
        sight["dropping"] = 1.0
    return sight


def hulls(story: Story, poses: np.ndarray) -> np.ndarray:
    """Return robots at poses (N, 3) as boxes."""
    halves = story.robot.each("half_edges", np.arange(len(poses)))[:, :2]
    return np.column_stack([poses[:, :2], np.cos(poses[:, 2]), np.sin(poses[:, 2]), halves])


def depth(first: np.ndarray, second: np.ndarray) -> float:
    """Return how deep two boxes overlap, by their separating axes; negative where they do not."""
    depths = []
    for axis in (*axes_of(first), *axes_of(second)):
        extent = half_extent(first, axis) + half_extent(second, axis)
        depths.append(extent - abs((first[:2] - second[:2]) @ axis))
    return min(depths)


def axes_of(box: np.ndarray) -> list[np.ndarray]:
    """Return the two axes of a box."""
    yaw = math.atan2(box[3], box[2])
    return [np.array([math.cos(angle), math.sin(angle)]) for angle in (yaw, yaw + math.pi / 2)]


def half_extent(box: np.ndarray, axis: np.ndarray) -> float:
    """Return half the extent of a box along an axis."""
    from_centre = corners(box[None])[0] - box[:2]
    return np.abs(from_centre @ axis).max()


def check_what_stands(story: Story) -> None:
    """Check that walls and obstacles hold, also where robots press against them."""
    obstacle = numbers(story.configs[0][0].arena.obstacles, RD)[0]
    for world, n_robots in enumerate(story.numbers):
        walls = in_mm(story.configs[0][world].arena.walls)
        for poses in story.poses[:, world]:
            robots = hulls(story, poses[:n_robots])
            beyond_walls = beyond(corners(robots), walls).max(axis=1)
            into_obstacle = [depth(robot, obstacle) for robot in robots]
            assert beyond_walls.max() <= OVERLAP, (world, beyond_walls)
            assert max(into_obstacle) <= OVERLAP, (world, into_obstacle)

        # At the end those that drove there are there.
        assert beyond_walls[AT_WALL] > -NEAR, (world, beyond_walls)
        assert into_obstacle[AT_OBSTACLE] > -NEAR, (world, into_obstacle)


def check_who_moves(task, story: Story) -> None:
    """Check that every second robot drives until it dies, and that the others stand."""
    moved = np.linalg.norm(np.diff(story.poses[..., :2], axis=0), axis=-1)
    for world, n_robots in enumerate(story.numbers):
        empty_places = moved[:, world, n_robots:]
        assert not empty_places.any()
        standing = moved[:, world, [0, 2, 6]]
        assert (standing < STILL).all()

        is_alive = np.ones((STEPS, n_robots), bool)
        if isinstance(task, Deaths):
            is_alive[DIES_AT - 1 :, list(MORTAL)] = False
        np.testing.assert_array_equal(story.is_alive[:, world, :n_robots], is_alive)
        for robot in MORTAL:
            drives = moved[:, world, robot] > 1.0
            np.testing.assert_array_equal(drives, is_alive[:, robot])


def check_light(task, story: Story) -> None:
    """Check that robots hear those that live, and from the next step on none that has died."""
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
    """Check that drives err, but for the step without errors."""
    if story.record is None:
        return
    errors = story.record.command.turn[..., AT_WALL]
    calm = np.zeros(STEPS, bool)
    calm[CALM_AT - 1] = isinstance(task, Weather)
    np.testing.assert_array_equal(errors == 0, np.broadcast_to(calm[:, None], errors.shape))


def check_boxes(task, story: Story) -> None:
    """Check that gates slide where the task drives them, and that other boxes move by pushes."""
    for world, n_robots in enumerate(story.numbers):
        config = story.configs[0][world]
        boxes = story.boxes[:, world]
        is_laid_by_task = isinstance(task, Gates) and config.arena.outline
        rows = laid_boxes(config) if is_laid_by_task else BOXES
        np.testing.assert_allclose(boxes[0], poses_of_boxes(rows), atol=1e-4)

        displacement = boxes - boxes[0]
        gate_step = GATE_STEP if isinstance(task, Gates) else 0.0
        for gate, side in zip(GATES, (1, -1), strict=True):
            target = np.outer(np.arange(STEPS + 1), [0.0, side * gate_step])
            np.testing.assert_allclose(displacement[:, gate, :2], target, atol=YIELDS)

        assert np.abs(displacement[:, UNTOUCHED]).max() < STILL
        if n_robots > AT_BOX:
            assert displacement[-1, PUSHED, 0] > 1.0
        else:
            assert np.abs(displacement[:, PUSHED]).max() < STILL


def check_balls(task, story: Story) -> None:
    """Check that robots lift, carry, lose and deliver balls as arena and conditions say."""
    if not isinstance(task, Tidy):
        return
    balls = story.task.balls
    at_tools = slice(len(HOLDERS))
    in_dust = len(HOLDERS)
    for world, config in enumerate(story.configs[0]):
        dust = [-mm_from_rd(config.arena.dust_area_offset), 0.0]
        np.testing.assert_allclose(
            balls.position[:, world, in_dust], np.broadcast_to(dust, (STEPS, 2)), rtol=1e-6
        )
        is_held, is_delivered = expected_balls(task, story, world)
        name = f"world {world}"
        np.testing.assert_array_equal(balls.is_held[:, world, at_tools], is_held, name)
        np.testing.assert_array_equal(balls.is_delivered[:, world, at_tools], is_delivered, name)


def expected_balls(task, story: Story, world: int) -> tuple[np.ndarray, np.ndarray]:
    """Return which of the balls at tools have to be held, and delivered, in each step."""
    is_held = np.zeros((STEPS, len(HOLDERS)), bool)
    is_delivered = np.zeros((STEPS, len(HOLDERS)), bool)

    # In bad weather robots that drive are no longer at their balls once they can be lifted.
    lifts_at = 1
    is_lifted = np.ones(len(HOLDERS), bool)
    if isinstance(task, Weather):
        lifts_at = LIFTS_AT
        is_lifted = np.array(HOLDERS) % 2 == 0
    is_held[lifts_at - 1 :] = is_lifted

    # The robot at the dump delivers once its dump reaches to the tip of its tool.
    ball_at_dump = HOLDERS.index(AT_DUMP)
    tip = story.poses[0, world, AT_DUMP, 0] + tip_of(story)
    for step in range(lifts_at, STEPS):
        dump_size = story.configs[step][world].arena.dump_size
        is_over_dump = tip <= mm_from_rd(dump_size) / 2
        if is_over_dump and is_held[step, ball_at_dump]:
            is_held[step:, ball_at_dump] = False
            is_delivered[step:, ball_at_dump] = True

    if isinstance(task, Weather):
        is_held[DROPS_AT - 1 :] = False
    return is_held, is_delivered


def tip_of(story: Story) -> float:
    """Return how far ahead of the robots the tips of their tools are [mm]."""
    return float(story.robot.each("probe_tip", np.arange(1))[0, 0])


def check_areas(task, story: Story) -> None:
    """Check that pictures show the areas of each world, where they are in each step."""
    if story.drawn is None:
        return
    for world, (scene, frames) in enumerate(story.drawn):
        if isinstance(task, Tidy):
            check_cleaning_areas(scene, story.configs[-1][world].arena)
        if "disc" in task.drawn:
            discs = np.concatenate([block.arrays()[DISC] for block in frames])[:, 0]
            for step, disc in enumerate(discs):
                arena = story.configs[step][world].arena
                x = mm_from_rd(arena.dust_area_offset)
                radius = mm_from_rd(arena.dump_size) / 2
                expected = MM * np.array([x, step + 1, radius])
                np.testing.assert_allclose(disc, expected, rtol=1e-5)


def check_cleaning_areas(scene: Scene, arena: ArenaConfig) -> None:
    """Check the dump and the middle of the two dust areas in a picture."""
    half_dump = mm_from_rd(arena.dump_size) / 2 * MM
    corners_of_dump = [-half_dump, -half_dump, half_dump, half_dump]
    np.testing.assert_allclose(scene.dump, corners_of_dump, rtol=1e-5)

    offset = mm_from_rd(arena.dust_area_offset) * MM
    middles = scene.dust_areas[:, [0, 2]].mean(axis=1)
    np.testing.assert_allclose(middles, [-offset, offset], rtol=1e-5)


def check(cell, story: Story) -> None:
    """Check the story of a cell."""
    task = TASKS[cell.task]
    check_what_it_saw(task, story)
    check_what_stands(story)
    check_who_moves(task, story)
    check_light(task, story)
    check_errors_of_drives(task, story)
    check_boxes(task, story)
    check_balls(task, story)
    check_areas(task, story)
