"""What runs and environments are made of: what the user gives, checked once, and the engine that it asks for."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.base import CompiledEngine, Engine
from iswarm_mj.engines.checked import make_compiled_engine, make_host_engine
from iswarm_mj.engines.registry import ENGINES, check_settings
from iswarm_mj.engines.robot_file import as_robot_file, check_total, read_robots
from iswarm_mj.engines.settings import EngineSettings, ModelSpec
from iswarm_mj.geometry.robot import RobotFile, Robots
from iswarm_mj.simulation.given import goal_of, of_worlds
from iswarm_mj.simulation.layouts import Start, check_boxes, with_boxes_laid
from iswarm_mj.simulation.memory_limits import check_memory, devices_of
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.shared_settings import static_config
from iswarm_mj.simulation.worlds import World, starts_of, worlds_of_seed
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.tasks.base import Task
from iswarm_mj.tasks.layout import cell_of, check_robots
from iswarm_mj.tasks.signatures import as_task, check_task, usable_task
from iswarm_mj.utils.constraints import check, check_kind
from iswarm_mj.utils.jax_setup import check_devices, configure_jax


class Setup(NamedTuple):
    """What a run or an environment is made of, but for what its robots do."""

    config: SwarmConfig
    """Of the run."""
    static: StaticConfig
    """What control steps are compiled for."""
    settings: RunSettings
    engine: EngineSettings
    robot: Robots
    robot_file: RobotFile
    """As an absolute path, or several; None for `models/robot.xml`."""
    task: Task
    """As given."""
    tasks: Any
    """The task, with a first axis of `worlds`."""
    sensed: dict[str, Any]
    """Shapes and types of what robots sense of it beside balls and dump."""
    goal: int | None
    """Progress of the task that finishes a world; None if it never is."""
    worlds: Sequence[World]
    starts: Sequence[Start]
    """How each of them begins."""

    @property
    def capacity(self) -> int:
        """Places for robots in each world."""
        return self.settings.capacity or self.settings.n_robots

    @property
    def device(self) -> Any:
        """JAX device of what is not the engine's, None for the default: engines on the host leave GPUs alone."""
        check_devices()
        return jax.local_devices(backend="cpu")[0] if self.engine.on_host else None

    @property
    def model(self) -> ModelSpec:
        """What the engine simulates."""
        is_masked = any(world.n_robots < self.capacity for world in self.worlds)
        return ModelSpec(self.config, self.settings.n_robots, self.capacity, self.robot_file, is_masked)

    def host_engine(self) -> Callable[[int, int], Engine]:
        """Return what makes an engine on the host for a number of worlds and of threads."""
        return make_host_engine(self.engine, self.model, self.robot)

    def compiled_engine(self, n_worlds: int) -> tuple[CompiledEngine, Sequence[Any]]:
        """Return an engine for programs of JAX, and the devices that share so many worlds."""
        devices = devices_of(self.engine)[:n_worlds]
        n_rows, platform = -(-n_worlds // len(devices)), devices[0].platform
        return make_compiled_engine(self.engine, self.model, self.robot, n_rows, platform), devices


def set_up(
    config: SwarmConfig,
    settings: RunSettings,
    engine: EngineSettings,
    task: Any,
    worlds: Sequence[World] | Genome,
    robot_file: RobotFile = None,
) -> Setup:
    """Check what the user gives, and draw how worlds begin.

    Args:
        config: of all worlds.
        settings: of the run.
        engine: that carries it out.
        task: what the robots are to do.
        worlds: whose beginnings are drawn; or the genome of those of the settings' seed.
        robot_file: MJCF file of the robots, or of each kind with their number; None for `models/robot.xml`.

    Raises:
        UserError: robots, worlds, a task or settings that do not fit, or too little memory.
    """
    configure_jax()
    check_kind("config", config, SwarmConfig)
    check_kind("settings", settings, RunSettings)
    known = ", ".join(f"{settings.__name__}()" for settings in ENGINES.values())
    check("engine", engine, f"settings of an engine, as {known}", isinstance(engine, EngineSettings))
    check_settings(engine)
    file = as_robot_file(robot_file)
    check_total(file, settings.n_robots)
    robot = read_robots(file)
    capacity = settings.capacity or settings.n_robots
    check_memory(engine, settings.n_worlds, capacity)
    worlds = worlds_of_seed(worlds, settings) if isinstance(worlds, Genome) else worlds
    are_worlds = isinstance(worlds, Sequence) and all(isinstance(world, World) for world in worlds)
    found = f"a {type(worlds).__name__}" if not are_worlds else "none"
    check("worlds", found, "a list of at least one World", are_worlds and len(worlds) > 0)
    largest = max(world.n_robots for world in worlds)
    check("n_robots", settings.n_robots, f"that of the largest world, {largest}", settings.n_robots == largest)
    usable_task(task)
    goal = goal_of(task, config, settings)
    check_robots(config.arena, largest, cell_of(robot))
    slots, n_leds = config.optics.slots, len(robot.sides)
    is_long = not config.optics.baud_rate or slots >= n_leds
    check("optics.slots", slots, f"at least {n_leds}, one for each LED of the robot", is_long)
    starts = starts_of(config, task, robot, worlds)
    check_boxes(task, starts)
    if (boxes := starts[0].boxes) != config.arena.boxes:
        config = with_boxes_laid(config, boxes, "start")
        worlds = [replace(w, config=w.config and with_boxes_laid(w.config, boxes, "start")) for w in worlds]
    known = config.arena.boxes == () or engine.has_boxes
    check("arena.boxes", config.arena.boxes, f"left out with the engine {engine.name}, which has none", known)
    static = static_config(config, engine.on_host)
    arrays = as_task(task)
    sensed = check_task(arrays, config, static, robot, starts[0].task, capacity)
    tasks = of_worlds(arrays, len(starts))
    return Setup(config, static, settings, engine, robot, file, task, tasks, sensed, goal, worlds, starts)
