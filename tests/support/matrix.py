"""Cells of the matrix, how each of them is played, and what came of it."""

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
WAYS = {
    "square": ("run", "run of 3", "environment of 3", "page"),
    "rectangle": ("run of 3", "environment", "environment of 3", "page"),
}
"""Ways in which the planar engine plays an arena; the other engines play some."""
QUICK_WAYS = [
    {("square", "run"), ("square", "environment of 3"), ("rectangle", "page")},
    {("square", "page"), ("rectangle", "run of 3"), ("rectangle", "environment")},
]
"""Of these, those of every other task in the suite of every day, so that each pair of a task and a
kind of way, of a task and an arena, and of an arena and a way is among them."""
SEED = 4
CHANGED_AFTER = 2
"""Control steps on the page, after which settings are changed."""


class Cell(NamedTuple):
    """A task, an engine, an arena (robots of 2.4 x 1.6 mm in the rectangle), and a way to play it."""

    task: str
    engine: str
    arena: str
    way: str

    def __str__(self) -> str:
        return ", ".join(self)


CELLS = [
    *(
        Cell(task, "planar", arena, way)
        for task in TASKS
        for arena, ways in WAYS.items()
        for way in ways
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


def is_slow(cell: Cell) -> bool:
    """Return whether a cell is left to the slow tests; MJX compiles for long."""
    if cell.engine == "planar":
        return (cell.arena, cell.way) not in QUICK_WAYS[list(TASKS).index(cell.task) % 2]
    return cell.engine == "mjx"


class Story(NamedTuple):
    """What came of B worlds in T control steps."""

    configs: list[list[SwarmConfig]]
    """Of each step and world."""
    numbers: tuple[int, ...]
    """Robots of each world."""
    robot: Robots
    poses: np.ndarray
    """(T + 1, B, N, 3), from the start."""
    boxes: np.ndarray
    """(T + 1, B, M, 3)"""
    is_alive: np.ndarray
    """(T, B, N)"""
    task: Any
    """State of the task after each step, arrays (T, B, ...)."""
    metrics: dict[str, np.ndarray]
    """(T, B)"""
    record: StepRecord | None = None
    """(T, B, ...); None of environments."""
    drawn: list[tuple[Scene, list[Frames]]] | None = None
    """What each world looks like, scene and frames of all steps; None of environments."""
    reward: np.ndarray | None = None
    """(T - 1, B, N) of the steps before the last; None of runs."""


@cache
def robots_of(arena: str) -> Path | None:
    """Return the file of the robots in an arena; None for the paper's."""
    return None if arena == "square" else robot_file(Path(mkdtemp()), "four askew")


def play(cell: Cell) -> Story:
    """Play a cell."""
    if cell.way == "page":
        return play_page(cell)
    n_worlds = 3 if cell.way.endswith("3") else 1
    if cell.way.startswith("environment"):
        return play_environment(cell, n_worlds)
    return play_run(cell, n_worlds)


def run_of(cell: Cell, worlds: list[World], config: SwarmConfig) -> Run:
    """Return a run whose worlds are recorded in the opposite order."""
    recorded = tuple(range(len(worlds)))[::-1]
    return Run(
        Scenario(
            config,
            strategy=Drill(),
            task=TASKS[cell.task],
            robots=N,
            robot_file=robots_of(cell.arena),
            engine=ENGINES[cell.engine],
            seed=SEED,
            worlds=worlds,
            steps=STEPS,
        ),
        record_worlds=recorded,
    )


def play_run(cell: Cell, n_worlds: int) -> Story:
    """Play a run of worlds that differ in settings and numbers of robots."""
    configs = [config_of(cell.arena, world) for world in range(n_worlds)]
    worlds = [World(TYPE1, NUMBERS[k], SEED, k, config=config) for k, config in enumerate(configs)]
    run = run_of(cell, worlds, configs[0])
    return story_of(run, ran(run), [configs] * STEPS)


def story_of(run: Run, record: StepRecord, configs: list[list[SwarmConfig]]) -> Story:
    """Return what came of a run."""
    assert not run.faults
    rows = list(run.settings.record_worlds)
    recorded = [RecordedWorld.of_run(run, rows.index(world)) for world in range(len(rows))]
    frames = [world.frames([record]) for world in recorded]
    in_order = [rows.index(world) for world in range(len(rows))]
    start = jax.tree.map(lambda a: np.asarray(a)[:, in_order], run.start)
    record = jax.tree.map(lambda a: np.asarray(a)[:, in_order], record)
    metrics = {name: [one.arrays()[METRIC + name] for one in frames] for name in run.task.measured}
    return Story(
        configs=configs,
        numbers=tuple(world.n_robots for world in run.worlds),
        robot=run.robot,
        poses=np.concatenate([start.poses, record.poses]),
        boxes=np.concatenate([start.boxes, record.boxes]),
        is_alive=record.swarm.is_alive,
        task=record.swarm.task,
        metrics={name: np.stack(values, axis=1) for name, values in metrics.items()},
        record=record,
        drawn=[(world.scene, [one]) for world, one in zip(recorded, frames, strict=True)],
    )


def play_environment(cell: Cell, n_worlds: int) -> Story:
    """Play episodes, whose robots do what the strategy does; the run with their keys must come to
    the same.

    Robots of an environment have perceived when a step ends, so that its tasks are a step ahead of
    its poses.
    """
    config, task, engine = config_of(cell.arena, 0), TASKS[cell.task], ENGINES[cell.engine]
    given = {"worlds": n_worlds, "n_starts": 1, "seed": SEED, "robot_file": robots_of(cell.arena)}
    env = make_env(config=config, task=task, robots=N, engine=engine, **given)
    state = env.reset(jax.random.split(jax.random.key(SEED), n_worlds))
    keys = list(state.data.key)
    action = np.zeros((n_worlds, N, env.action_size), np.float32)
    action[:, 5, 0], action[:, 1::2, 1] = 0.5, 1.0

    poses, boxes, swarms, metrics, rewards = [], [], [], [], []
    for step in range(STEPS + 1):
        poses.append(np.asarray(env.poses(state)))
        boxes.append(np.asarray(env.boxes(state)))
        if step < STEPS:
            swarms.append(jax.device_get(state.data.world.swarm))
            metrics.append(jax.device_get(state.metrics))
            rewards.append(np.asarray(state.reward))
            state = env.step(state, action)
    assert not np.asarray(state.info["fault"]).any()

    swarm = jax.tree.map(lambda *values: np.stack(values), *swarms)
    story = Story(
        configs=[[config] * n_worlds] * STEPS,
        numbers=(N,) * n_worlds,
        robot=env.core.robot,
        poses=np.stack(poses),
        boxes=np.stack(boxes),
        is_alive=swarm.is_alive,
        task=swarm.task,
        metrics={name: np.stack([one[name] for one in metrics]) for name in task.measured},
        reward=np.stack(rewards[1:]),
    )
    start = draw_start(config, task, env.core.robot, N, SEED, 0)
    run = run_of(
        cell, [World(TYPE1, N, key=key, start=start, config=config) for key in keys], config
    )
    assert_alike(story, story_of(run, ran(run), story.configs))
    return story


def assert_alike(story: Story, other: Story) -> None:
    """Poses, lives and the task are the same, but for what 32-bit floats round."""
    leaves = [
        jax.tree.leaves((one.poses, one.boxes, one.is_alive, one.task)) for one in (story, other)
    ]
    for value, expected in zip(*leaves, strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-5, atol=2e-3)


def play_page(cell: Cell) -> Story:
    """Play the page's session, in which settings change; the run that changes so comes to the
    same."""
    config, task, engine = config_of(cell.arena, 1), TASKS[cell.task], ENGINES[cell.engine]
    scenario = PageScenario(
        config,
        strategy=Drill(),
        task=task,
        robots=N,
        seed=SEED,
        engine=engine,
        robot_file=robots_of(cell.arena),
    )
    session = Session(scenario)
    run = session.start.run()
    snapshots, records = [], []
    for step in range(STEPS):
        if step == CHANGED_AFTER:
            for name, value in CHANGES.items():
                session.set(name, value)
            run.change(changed(config), Drill())
        session.advance()
        snapshots.append(session.snapshots[-1])
        records.append(run.advance())

    configs = [[config]] * CHANGED_AFTER + [[changed(config)]] * (STEPS - CHANGED_AFTER)
    story = story_of(session.run, joined([one.record for one in snapshots]), configs)
    repeated = story_of(run, joined(records), configs)
    jax.tree.map(np.testing.assert_array_equal, story.record, repeated.record)

    # What the page plots and draws; its lines begin at the start.
    metrics = {name: np.array(session.lines[name])[1:, None] for name in task.measured}
    return story._replace(
        metrics=metrics, drawn=[(session.scene, [one.frames for one in snapshots])]
    )


def joined(records: list[StepRecord]) -> StepRecord:
    """Return consecutive records as one."""
    return jax.tree.map(lambda *values: np.concatenate(values), *records)
