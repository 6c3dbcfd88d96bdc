"""Preparation of runs and environments: checks of a scenario, and its engine."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.base import CompiledEngine, Engine
from iswarm_mj.engines.registry import check_settings
from iswarm_mj.engines.robot_file import check_total, read_robots
from iswarm_mj.engines.settings import EngineSettings, ModelSpec
from iswarm_mj.engines.validation import make_compiled_engine, make_host_engine
from iswarm_mj.geometry.robot import RobotFile, Robots
from iswarm_mj.gripper.attempts import tip_of
from iswarm_mj.gripper.tips.table import TipTable, check_balls
from iswarm_mj.simulation.layouts import Start, check_boxes, with_boxes_laid
from iswarm_mj.simulation.memory_limits import check_memory, devices_of
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.shared_settings import static_config
from iswarm_mj.simulation.stacking import goal_of, of_worlds
from iswarm_mj.simulation.worlds import World, starts_of
from iswarm_mj.tasks.base import Task
from iswarm_mj.tasks.layout import cell_of, check_robots
from iswarm_mj.tasks.validation import as_task, check_task, usable_task
from iswarm_mj.utils.constraints import check, check_kind
from iswarm_mj.utils.jax_setup import check_devices, configure_jax


class Setup(NamedTuple):
    """Scenario that has been checked, and the starts of its worlds."""

    scenario: Scenario
    """The scenario."""
    config: SwarmConfig
    """Configuration of the run, with the boxes that its task lays."""
    static: StaticConfig
    """Settings that control steps are compiled for."""
    settings: RunSettings
    """Settings of the run."""
    robot: Robots
    """Geometry of the robots."""
    tasks: Any
    """The task, with a first axis of B worlds."""
    sensed: dict[str, Any]
    """Shapes and types of the quantities of the task that robots sense besides balls and dump."""
    tip: TipTable | None
    """Table of the grippers' tips; None for flat ones."""
    goal: int | None
    """Progress of the task that finishes a world; None if nothing does."""
    worlds: Sequence[World]
    """The B worlds."""
    starts: Sequence[Start]
    """Start of each world."""

    @property
    def engine(self) -> EngineSettings:
        """Settings of the engine."""
        return self.scenario.engine

    @property
    def task(self) -> Task:
        """The user's task."""
        return self.scenario.task

    @property
    def robot_file(self) -> RobotFile:
        """MJCF file of the robots as an absolute path, or several; None for `models/robot.xml`."""
        return self.scenario.robot_file

    @property
    def capacity(self) -> int:
        """Places for robots in each world."""
        return self.settings.capacity or self.settings.n_robots

    @property
    def device(self) -> Any:
        """JAX device of everything but the engine; None for the default.

        With an engine on the host, GPUs stay free.
        """
        check_devices()
        return jax.local_devices(backend="cpu")[0] if self.engine.on_host else None

    @property
    def model(self) -> ModelSpec:
        """Worlds as the engine needs to know them."""
        is_masked = any(world.n_robots < self.capacity for world in self.worlds)
        return ModelSpec(
            config=self.config,
            n_robots=self.settings.n_robots,
            capacity=self.capacity,
            robot_file=self.robot_file,
            is_masked=is_masked,
        )

    def host_engine(self) -> Callable[[int, int], Engine]:
        """Return a function of the numbers of worlds and threads that makes an engine."""
        return make_host_engine(self.engine, self.model, self.robot)

    def compiled_engine(self, n_worlds: int) -> tuple[CompiledEngine, Sequence[Any]]:
        """Return an engine for programs of JAX, and the devices that share the worlds.

        Args:
            n_worlds: number of worlds of all devices.
        """
        devices = devices_of(self.engine)[:n_worlds]
        n_rows = math.ceil(n_worlds / len(devices))
        platform = devices[0].platform
        engine = make_compiled_engine(self.engine, self.model, self.robot, n_rows, platform)
        return engine, devices


def set_up(
    scenario: Scenario, settings: RunSettings, layouts: Sequence[World] | None = None
) -> Setup:
    """Check a scenario, and draw the starts of its worlds.

    Args:
        scenario: the scenario.
        settings: settings of the run.
        layouts: worlds whose starts are drawn; by default all of the scenario. An environment
            has fewer layouts than worlds, and takes one for each episode.

    Raises:
        UserError: robots, worlds, a task or settings do not fit, or memory does not suffice.
    """
    configure_jax()
    check_kind("scenario", scenario, Scenario)
    config = scenario.config
    engine = scenario.engine
    task = scenario.task
    check_settings(engine)

    # Robots and their number.
    check_total(scenario.robot_file, settings.n_robots)
    robot = read_robots(scenario.robot_file)
    capacity = settings.capacity or settings.n_robots
    check_memory(engine, settings.n_worlds, capacity)
    worlds = scenario.list_worlds() if layouts is None else layouts
    _check_largest_world(settings, worlds)

    tip = _tip_of(config, worlds)

    # The task in the arena, and what its robots send.
    usable_task(task)
    goal = goal_of(task, config, settings)
    check_robots(config.arena, settings.n_robots, cell_of(robot))
    _check_slots(config.optics, n_leds=len(robot.sides))

    # Starts of the worlds, whose boxes the task may have laid, the same in all worlds.
    starts = starts_of(config, task, robot, worlds)
    check_boxes(task, starts)
    boxes = starts[0].boxes
    if boxes != config.arena.boxes:
        config = with_boxes_laid(config, boxes, "start")
        worlds = [_with_boxes(world, boxes) for world in worlds]
    can_have_boxes = config.arena.boxes == () or engine.has_boxes
    allowed = f"left out with the engine {engine.name}, which has none"
    check("arena.boxes", config.arena.boxes, allowed, can_have_boxes)

    # The task, as control steps need it.
    static = static_config(config, on_host=engine.on_host)
    arrays = as_task(task)
    sensed = check_task(arrays, config, static, robot, starts[0].task, capacity)
    return Setup(
        scenario=scenario,
        config=config,
        static=static,
        settings=settings,
        robot=robot,
        tasks=of_worlds(arrays, len(starts)),
        sensed=sensed,
        tip=tip,
        goal=goal,
        worlds=worlds,
        starts=starts,
    )


def _tip_of(config: SwarmConfig, worlds: Sequence[World]) -> TipTable | None:
    """Return the table of the grippers' tips; None for flat ones.

    Raises:
        UserError: the file is no table, or a world has balls that are not in it.
    """
    tip = tip_of(config.gripper)
    if tip is not None:
        for world in worlds:
            arena = (world.config or config).arena
            check_balls("arena.ball_radius_min", arena.ball_radius_min)
            check_balls("arena.ball_radius_max", arena.ball_radius_max)
    return tip


def _check_largest_world(settings: RunSettings, worlds: Sequence[World]) -> None:
    """Refuse settings whose number of robots is not that of the largest world."""
    largest = max(world.n_robots for world in worlds)
    allowed = f"that of the largest world, {largest}"
    check("robots", settings.n_robots, allowed, settings.n_robots == largest)


def _check_slots(optics: OpticsConfig, n_leds: int) -> None:
    """Refuse fewer slots than a robot has LEDs, where messages take time."""
    has_enough_slots = not optics.baud_rate or optics.slots >= n_leds
    allowed = f"at least {n_leds}, one for each LED of the robot"
    check("optics.slots", optics.slots, allowed, has_enough_slots)


def _with_boxes(world: World, boxes: Any) -> World:
    """Return a world whose configuration, if it has one, has the boxes of its start."""
    if world.config is None:
        return world
    return replace(world, config=with_boxes_laid(world.config, boxes, "start"))
