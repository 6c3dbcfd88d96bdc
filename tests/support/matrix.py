"""Cells of the matrix of tasks, engines, arenas and modes, and the outcome of playing one."""

from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, NamedTuple

import jax
import numpy as np
import pytest

from iswarm_mj import make_env
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.output.frames import RecordedWorld
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import METRIC, Scene
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.simulation.layouts import draw_start
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.state import StepRecord
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import TYPE1
from support.matrix_tasks import TASKS, Drill
from support.matrix_worlds import CHANGES, NUMBERS, STEPS, N, changed, config_of
from support.mjx import ran
from support.robots import robot_file

ENGINES = {
    "planar": PlanarSettings(threads=1),
    "mujoco": MujocoSettings(threads=1),
    "mjx": MjxSettings(chunk=STEPS, devices=tuple(jax.devices("cpu")[:1])),
}
MODES = {
    "square": ("run", "run of 3", "environment of 3", "page"),
    "rectangle": ("run of 3", "environment", "environment of 3", "page"),
}
"""Modes in which the planar engine plays each arena; the other engines play some."""
QUICK_MODES = [
    {("square", "run"), ("square", "environment of 3"), ("rectangle", "page")},
    {("square", "page"), ("rectangle", "run of 3"), ("rectangle", "environment")},
]
"""Arenas and modes of the planar engine that are tested every day, those of every other task.

Each pair of a task and a kind of mode, of a task and an arena, and of an arena and a mode is among
them."""
SEED = 4
CHANGED_AFTER = 2
"""Control steps on the page, after which settings are changed."""


class Cell(NamedTuple):
    """A task on an engine, in an arena, played in a mode."""

    task: str
    engine: str
    arena: str
    """The rectangle has robots of 2.4 x 1.6 mm."""
    mode: str
    """A run, environment or page; of one world or of 3."""

    def __str__(self) -> str:
        return ", ".join(self)


CELLS = [
    *(
        Cell(task, "planar", arena, mode)
        for task in TASKS
        for arena, modes in MODES.items()
        for mode in modes
    ),
    Cell("own", "mujoco", "square", "run of 3"),
    Cell("own", "mujoco", "rectangle", "environment"),
    Cell("areas", "mujoco", "rectangle", "page"),
    Cell("areas", "mujoco", "square", "run"),
    Cell("cleaning", "mujoco", "rectangle", "run of 3"),
    Cell("cleaning", "mujoco", "square", "environment of 3"),
    Cell("boxes", "mujoco", "square", "run of 3"),
    Cell("boxes", "mujoco", "rectangle", "environment of 3"),
    Cell("boxes", "mujoco", "rectangle", "page"),
    Cell("deaths", "mujoco", "rectangle", "run of 3"),
    Cell("deaths", "mujoco", "square", "environment"),
    Cell("conditions", "mujoco", "square", "run"),
    Cell("conditions", "mujoco", "rectangle", "environment of 3"),
    Cell("everything", "mujoco", "square", "environment of 3"),
    Cell("everything", "mujoco", "rectangle", "run of 3"),
    Cell("everything", "mujoco", "square", "page"),
    Cell("own", "mjx", "rectangle", "run"),
    Cell("everything", "mjx", "square", "run of 3"),
]


def cells_of(*tasks: str) -> list[Any]:
    """Return the cells of these tasks as parameters of a test."""
    cells = [cell for cell in CELLS if cell.task in tasks]
    return [
        pytest.param(cell, marks=[pytest.mark.slow] if is_slow(cell) else [], id=str(cell))
        for cell in cells
    ]


QUICK_ON_MUJOCO = [
    Cell("own", "mujoco", "square", "run of 3"),
    Cell("areas", "mujoco", "rectangle", "page"),
    Cell("boxes", "mujoco", "rectangle", "environment of 3"),
    Cell("deaths", "mujoco", "rectangle", "run of 3"),
    Cell("everything", "mujoco", "square", "environment of 3"),
]
"""Cells of MuJoCo in C that are tested every day: both arenas, all kinds of modes."""


def is_slow(cell: Cell) -> bool:
    """Return whether a cell is left to the slow tests; MJX compiles for long."""
    if cell.engine == "planar":
        return (cell.arena, cell.mode) not in QUICK_MODES[list(TASKS).index(cell.task) % 2]
    return cell not in QUICK_ON_MUJOCO


class Story(NamedTuple):
    """Course of B worlds over T control steps."""

    configs: list[list[SwarmConfig]]
    """Configuration of each step and world."""
    numbers: tuple[int, ...]
    """Number of robots of each world."""
    robot: Robots
    poses: np.ndarray
    """(T + 1, B, N, 3), from the start [mm, mm, rad]."""
    boxes: np.ndarray
    """(T + 1, B, M, 3) poses, from the start [mm, mm, rad]."""
    is_alive: np.ndarray
    """(T, B, N)"""
    task: Any
    """State of the task after each step, arrays (T, B, ...)."""
    metrics: dict[str, np.ndarray]
    """(T, B)"""
    record: StepRecord | None = None
    """(T, B, ...); None for environments."""
    drawn: list[tuple[Scene, list[Frames]]] | None = None
    """Picture of each world, its scene and the frames of all steps; None for environments."""
    reward: np.ndarray | None = None
    """(T - 1, B, N), from all steps but the last; None for runs."""


@cache
def robots_of(arena: str) -> Path | None:
    """Return the file of the robots in an arena; None for the paper's."""
    return None if arena == "square" else robot_file(Path(mkdtemp()), "four askew")


def play(cell: Cell) -> Story:
    """Play a cell."""
    if cell.mode == "page":
        return play_page(cell)
    n_worlds = 3 if cell.mode.endswith("3") else 1
    if cell.mode.startswith("environment"):
        return play_environment(cell, n_worlds)
    return play_run(cell, n_worlds)


def run_of(cell: Cell, worlds: list[World], config: SwarmConfig) -> Run:
    """Return a run whose worlds are recorded in the opposite order."""
    scenario = Scenario(
        config,
        strategy=Drill(),
        task=TASKS[cell.task],
        robots=N,
        robot_file=robots_of(cell.arena),
        engine=ENGINES[cell.engine],
        seed=SEED,
        worlds=worlds,
        steps=STEPS,
    )
    last_first = tuple(range(len(worlds)))[::-1]
    return Run(scenario, record_worlds=last_first)


def play_run(cell: Cell, n_worlds: int) -> Story:
    """Play a run of worlds that differ in settings and numbers of robots."""
    configs = [config_of(cell.arena, world) for world in range(n_worlds)]
    worlds = [World(TYPE1, NUMBERS[k], SEED, k, config=config) for k, config in enumerate(configs)]
    run = run_of(cell, worlds, configs[0])
    return story_of(run, ran(run), [configs] * STEPS)


def story_of(run: Run, record: StepRecord, configs: list[list[SwarmConfig]]) -> Story:
    """Return the course of a run, world by world in their order."""
    assert not run.faults
    rows = list(run.settings.record_worlds)
    row_of_world = [rows.index(world) for world in range(len(rows))]

    # What users see of each world: frames, with the metrics of the task.
    recorded_worlds = [RecordedWorld.of_run(run, row) for row in row_of_world]
    frames_of_worlds = [world.frames([record]) for world in recorded_worlds]
    arrays_of_worlds = [frames.arrays() for frames in frames_of_worlds]
    metrics = {}
    for name in run.task.measured:
        values = [arrays[METRIC + name] for arrays in arrays_of_worlds]
        metrics[name] = np.stack(values, axis=1)
    drawn = [
        (world.scene, [frames])
        for world, frames in zip(recorded_worlds, frames_of_worlds, strict=True)
    ]

    start = jax.tree.map(lambda a: np.asarray(a)[:, row_of_world], run.start)
    record = jax.tree.map(lambda a: np.asarray(a)[:, row_of_world], record)
    return Story(
        configs=configs,
        numbers=tuple(world.n_robots for world in run.worlds),
        robot=run.robot,
        poses=np.concatenate([start.poses, record.poses]),
        boxes=np.concatenate([start.boxes, record.boxes]),
        is_alive=record.swarm.is_alive,
        task=record.swarm.task,
        metrics=metrics,
        record=record,
        drawn=drawn,
    )


def play_environment(cell: Cell, n_worlds: int) -> Story:
    """Play episodes whose robots do what the strategy does; a run with their keys ends alike.

    Robots of an environment have perceived when a step ends, so that its tasks are a step ahead of
    its poses.
    """
    config = config_of(cell.arena, 0)
    task = TASKS[cell.task]
    env = make_env(
        config=config,
        task=task,
        robots=N,
        engine=ENGINES[cell.engine],
        worlds=n_worlds,
        n_starts=1,
        seed=SEED,
        robot_file=robots_of(cell.arena),
    )
    state = env.reset(jax.random.split(jax.random.key(SEED), n_worlds))
    keys = list(state.data.key)

    # The commands of `Drill`, as shares of the largest ones.
    action = np.zeros((n_worlds, N, env.action_size), np.float32)
    action[:, 5, 0] = 0.5
    action[:, 1::2, 1] = 1.0

    poses = []
    boxes = []
    states = []
    for _ in range(STEPS):
        poses.append(np.asarray(env.poses(state)))
        boxes.append(np.asarray(env.boxes(state)))
        states.append(jax.device_get((state.data.world.swarm, state.metrics, state.reward)))
        state = env.step(state, action)
    poses.append(np.asarray(env.poses(state)))
    boxes.append(np.asarray(env.boxes(state)))
    assert not np.asarray(state.info["fault"]).any()

    swarm, metrics, reward = jax.tree.map(lambda *values: np.stack(values), *states)
    story = Story(
        configs=[[config] * n_worlds] * STEPS,
        numbers=(N,) * n_worlds,
        robot=env.core.robot,
        poses=np.stack(poses),
        boxes=np.stack(boxes),
        is_alive=swarm.is_alive,
        task=swarm.task,
        metrics={name: metrics[name] for name in task.measured},
        reward=reward[1:],
    )

    # The same start and keys in a run.
    start = draw_start(config, task, env.core.robot, N, SEED, 0)
    worlds = [World(TYPE1, N, key=key, start=start, config=config) for key in keys]
    run = run_of(cell, worlds, config)
    assert_alike(story, story_of(run, ran(run), story.configs))
    return story


def assert_alike(story: Story, expected: Story) -> None:
    """Assert that poses, lives and the task are the same, but for what 32-bit floats round."""
    leaves = jax.tree.leaves((story.poses, story.boxes, story.is_alive, story.task))
    expected_leaves = jax.tree.leaves(
        (expected.poses, expected.boxes, expected.is_alive, expected.task)
    )
    for values, expected_values in zip(leaves, expected_leaves, strict=True):
        np.testing.assert_allclose(values, expected_values, rtol=1e-5, atol=2e-3)


def play_page(cell: Cell) -> Story:
    """Play the page's session, in which settings change; a run that changes alike ends alike."""
    config = config_of(cell.arena, 1)
    task = TASKS[cell.task]
    scenario = PageScenario(
        config,
        strategy=Drill(),
        task=task,
        robots=N,
        seed=SEED,
        engine=ENGINES[cell.engine],
        robot_file=robots_of(cell.arena),
    )
    session = Session(scenario)
    run = session.start.run()

    # Change settings of both between two control steps.
    snapshots = []
    records = []
    for step in range(STEPS):
        if step == CHANGED_AFTER:
            for name, value in CHANGES.items():
                session.set(name, value)
            run.change(changed(config), Drill())
        session.advance()
        snapshots.append(session.snapshots[-1])
        records.append(run.advance())

    configs = [[config]] * CHANGED_AFTER + [[changed(config)]] * (STEPS - CHANGED_AFTER)
    record = joined([snapshot.record for snapshot in snapshots])
    story = story_of(session.run, record, configs)
    repeated = story_of(run, joined(records), configs)
    jax.tree.map(np.testing.assert_array_equal, story.record, repeated.record)

    # What the page plots and draws; its lines begin at the start.
    metrics = {name: np.array(session.lines[name])[1:, None] for name in task.measured}
    frames = [snapshot.frames for snapshot in snapshots]
    return story._replace(metrics=metrics, drawn=[(session.scene, frames)])


def joined(records: list[StepRecord]) -> StepRecord:
    """Return consecutive records as one."""
    return jax.tree.map(lambda *values: np.concatenate(values), *records)
