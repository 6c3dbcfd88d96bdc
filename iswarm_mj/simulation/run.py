"""Runs: B worlds that advance together on any engine until each of them has ended."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

import jax
import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.validation import check_links
from iswarm_mj.geometry.obstacles import numbers, with_poses
from iswarm_mj.simulation.build import build_loop
from iswarm_mj.simulation.faults import decode_faults, summarize_faults
from iswarm_mj.simulation.layout_checks import check_place
from iswarm_mj.simulation.layouts import with_boxes_laid
from iswarm_mj.simulation.memory_limits import check_memory
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.setup import Setup, set_up
from iswarm_mj.simulation.shared_settings import check_shared_settings
from iswarm_mj.simulation.stacking import metrics_of, of_all_worlds, of_worlds, to_json
from iswarm_mj.simulation.state import StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.worlds import arenas_of_worlds, conditions_of_worlds, vector_strategies
from iswarm_mj.strategy.attributes import payload_of, recorded_of
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.genome import TYPE1, Genome
from iswarm_mj.strategy.teams import check_strategies, team_sizes
from iswarm_mj.strategy.vector_strategy import VectorStrategy, payload_for
from iswarm_mj.tasks.base import Task
from iswarm_mj.tasks.measures import Measures, measure
from iswarm_mj.tasks.validation import as_task
from iswarm_mj.utils.constraints import check_kind, is_whole, validate
from iswarm_mj.utils.errors import SimulationFault, shown
from iswarm_mj.utils.jax_setup import check_jax
from iswarm_mj.utils.profiling import Stopwatch
from iswarm_mj.utils.units import MM, RD, mm_from_rd


class Run:
    """B worlds that advance together until each is finished or faulty, or the time is up.

    A fault ends only its own world, and `faults` names it. With MJX on Warp, a full contact buffer
    ends all worlds of the device, which share it.

        run = Run(scenario)
        while not run.is_over:
            record = run.advance()

    Attributes:
        scenario: scenario as given.
        config: configuration at the start that all worlds share.
        genome: parameters of the paper's strategy at the start.
        settings: settings of the run.
        engine: settings of the engine.
        worlds: B worlds, with their present settings (`change`).
        starts: layout of each world at the start.
        start: record of the start of the W recorded worlds, with axes (1, W).
        strategy: present strategy; None for the paper's.
        task: present task.
        goal: progress of the task that finishes a world, in cleaning balls delivered; None if there
            is none.
        recorded: parts of the strategy's memory that recordings show, and their units.
        payload: fields of the messages.
        teams: number of robots of each team by its name (`strategy.teams`); empty without teams.
        robot: geometry of the robots.
        robot_file: MJCF file of the robots, as an absolute path, or several; None for
            `models/robot.xml`.
        tip: table of the grippers' tips; None for flat ones.
        watch: times of the stages.
        first_call_s: duration of the first call of `advance`, which compiles [s].
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        record_worlds: Sequence[int] = (0,),
        capacity: int | None = None,
    ):
        """Prepare the worlds.

        Args:
            scenario: scenario to simulate.
            record_worlds: numbers of the worlds whose steps `advance` returns.
            capacity: robots for which compiled programs have room: runs of the same capacity share
                them. None for the robots of the largest world.

        Raises:
            UserError: robots, worlds or settings that do not fit.
        """
        check_kind("scenario", scenario, Scenario)
        setup = set_up(scenario, scenario.settings(record_worlds, capacity))
        self.scenario = scenario
        self.settings = setup.settings
        self.config = setup.config
        self.genome = scenario.genome or TYPE1
        self.strategy = None if scenario.genome else scenario.strategy
        self.engine = scenario.engine
        self.task = scenario.task
        self.goal = setup.goal
        self.worlds = list(setup.worlds)
        self.starts = setup.starts
        self.robot = setup.robot
        self.tip = setup.tip
        self.robot_file = scenario.robot_file
        self._task_of_worlds = setup.tasks
        self._capacity = setup.capacity

        strategies = self._strategy_of_worlds()
        if self.strategy is not None:
            _check_methods(setup, strategies)
        self.recorded = recorded_of(VectorStrategy if self.strategy is None else strategies)
        self.payload = self._payload_of(strategies)
        self.teams = team_sizes(strategies, setup.capacity)

        self.watch = Stopwatch()
        with jax.default_device(setup.device):
            self._loop, self.start = build_loop(setup, strategies, self.watch)
        self.first_call_s = 0.0
        self._n_taken = 0
        self._n_taken_in_first_call = 0
        self._has_ended = np.zeros(len(self.worlds), bool)
        self._snapshot: WorldState | None = None

    def _strategy_of_worlds(self) -> Any:
        """Return the strategy with a first axis of B worlds."""
        if self.strategy is None:
            return vector_strategies(self.config, self.robot, self.worlds)
        return of_all_worlds(
            self.strategy,
            self.config,
            self.robot,
            self.worlds,
            is_per_world=self.scenario.strategy_per_world,
        )

    def _payload_of(self, strategies: Any) -> Any:
        """Return the fields of the messages of a strategy."""
        if self.strategy is not None:
            return payload_of(strategies)
        message_range = mm_from_rd(self.config.strategy.message_range)
        return payload_for(message_range, len(self.robot.sides))

    @property
    def step(self) -> int:
        """Number of the last control step that any world took."""
        if not self._has_ended.all():
            return self._n_taken
        state = self._state
        ended_at = np.where(state.is_finished, state.finished_at, state.fault.step)
        return int(ended_at.max())

    @property
    def is_over(self) -> bool:
        """The time is up, or every world has ended."""
        return self._n_taken >= self.settings.steps or bool(self._has_ended.all())

    @property
    def rules(self) -> dict[str, Any]:
        """Task, and genome or other strategy, as results state them."""
        task = to_json(self.task)
        if self.strategy is None:
            return {"task": task, "genome": asdict(self.genome)}
        return {"task": task, "strategy": to_json(self.strategy)}

    @property
    def identity(self) -> dict[str, Any]:
        """Name and main settings of the engine, as results state them."""
        return self.engine.identity

    @property
    def devices(self) -> list[str]:
        """Kinds of the devices that the worlds are spread over.

        Empty where the CPU's threads do all.
        """
        return [device.device_kind for device in self._loop.devices]

    def advance(self) -> StepRecord | None:
        """Take the next control steps: one on the host, a chunk in compiled programs.

        Returns:
            Record of the T steps of the W recorded worlds, NumPy arrays (T, W, ...); None if no
            world is recorded.

        Raises:
            RuntimeError: the run is over.
        """
        check_jax()
        if self.is_over:
            raise RuntimeError(
                f"the run is over after {self.step} control steps; make a new Run to go on"
            )
        first = self._n_taken
        with self.watch("advance"):
            n_taken, record = self._loop.advance(
                first, self.settings.steps, self.settings.record_worlds
            )
        self._n_taken += n_taken
        self._snapshot = None
        # Only what tells the end is read; `_state` is copied when it is asked for.
        is_finished, fault_bits = self._loop.read(lambda s: (s.is_finished, s.fault.bits))
        self._has_ended = is_finished | (fault_bits != 0)

        if first == 0:
            # The first call compiles, so its time counts for no stage.
            self.first_call_s = self.watch.laps["advance"][0]
            self._n_taken_in_first_call = n_taken
            self.watch.laps.clear()

        if record is None:
            return None
        if not self.engine.is_shipped:
            # JAX reads another robot in place of one that does not exist, and says nothing.
            n_robots = record.poses.shape[-2]
            n_sides = len(self.robot.sides)
            check_links(f"the engine {self.engine.name}", record.links, n_robots, n_sides)
        # A compiled chunk goes on after the last world has ended.
        n_steps = self.step - first
        return jax.tree.map(lambda a: a[:n_steps], record)

    def change(
        self, config: SwarmConfig, strategy: Strategy | Genome | Any, task: Task | Any = None
    ) -> None:
        """Give all worlds other settings from the next control step on; places and memories stay.

        Args:
            config: configuration that may differ from the run's in
                `shared_settings.PER_WORLD_FIELDS`.
            strategy: a genome of the paper's where the run has one; otherwise of the same class,
                static fields and shapes as the run's.
            task: task of the same class, static fields and shapes as the run's; None for the
                present one.

        Raises:
            UserError: the configurations differ in something else, or a field of the task is out of
                range.
        """
        # Boxes that the task laid take the place of those of the configuration, as at the start.
        if config.arena.boxes == self.scenario.config.arena.boxes:
            boxes = self.config.arena.boxes
            config = with_boxes_laid(config, boxes, type(self.task).__name__)
        check_shared_settings(self.config, config)
        if task is not None:
            validate(task)
            self.task = task
            self._task_of_worlds = of_worlds(as_task(task), len(self.worlds))

        if isinstance(strategy, Genome):
            self.strategy = None
            self.worlds = [replace(world, config=config, genome=strategy) for world in self.worlds]
        else:
            self.strategy = strategy
            self.worlds = [replace(world, config=config) for world in self.worlds]

        params, state = self.arrays()
        params = params._replace(
            strategy=self._strategy_of_worlds(),
            conditions=conditions_of_worlds(config, self.worlds),
            task=self._task_of_worlds,
            arena=arenas_of_worlds(config, self.worlds),
        )
        self._loop.replace(params, state.swarm)

    def edit(self, edit: Callable[[SwarmState], SwarmState]) -> None:
        """Replace the state of the swarm by another one, from the next control step on.

        Args:
            edit: returns the new state for the present one; NumPy arrays of B worlds, with the same
                shapes and types.
        """
        params, state = self.arrays()
        self._loop.replace(params, edit(state.swarm))
        self._snapshot = None

    def poses(self) -> np.ndarray:
        """Return x, y [m] and yaw [rad] of the robots of all worlds (B, N, 3)."""
        poses = self._loop.poses()[:, : self._capacity]
        return poses * [MM, MM, 1.0]

    def move_robot(self, index: int, place: Sequence[float]) -> None:
        """Put a robot of the first world elsewhere, from the next control step on.

        It keeps its heading and its memory, and all robots come to rest.

        Args:
            index: number of the robot.
            place: x, y of its centre [mm].

        Raises:
            ConfigError: it would stand beyond a wall, in an obstacle, a box or another robot.
        """
        poses = self._loop.poses()
        poses[0, index, :2] = place

        robots = poses[0, : self.worlds[0].n_robots]
        at_start = numbers(self.config.arena.boxes, RD)
        boxes = with_poses(at_start[:0], poses[0, self._capacity :], at_start[:, -2:])
        check_place(index, robots, self.robot, self.config.arena, np.asarray(boxes))
        self._loop.place(poses)
        self._snapshot = None

    def stage_times(self) -> dict[str, float]:
        """Return the median seconds that a control step spends in sense, policy and physics."""
        return self._loop.stage_times()

    @property
    def step_s(self) -> float | None:
        """Mean duration of a control step [s] without the first call, which compiles.

        None until a later call was timed.
        """
        n_timed = self._n_taken - self._n_taken_in_first_call
        if not n_timed:
            return None
        return sum(self.watch.laps["advance"]) / n_timed

    def peak_memory_gb(self) -> float | None:
        """Return the most memory that a device had in use [GB]; None where no device reports it."""
        key = "peak_bytes_in_use"
        stats = [device.memory_stats() or {} for device in self._loop.devices]
        peaks = [of_device[key] for of_device in stats if key in of_device]
        return round(max(peaks) / 1e9, 2) if peaks else None

    @property
    def faults(self) -> list[SimulationFault]:
        """Faults so far, at most one a world."""
        return [fault for fault in self.fault_of_each if fault is not None]

    @property
    def fault_of_each(self) -> list[SimulationFault | None]:
        """Fault of each world, None for a world without one."""
        indices = [world.index for world in self.worlds]
        return decode_faults(self._state.fault, indices, self._capacity)

    @property
    def _state(self) -> WorldState:
        """State of all worlds without bodies and memories, copied from devices on first use."""
        if self._snapshot is None:
            self._snapshot = self._loop.read(_without_bodies_and_memories)
        return self._snapshot

    @property
    def task_state(self) -> Any:
        """State of the task in all worlds, as NumPy arrays with a first axis of B worlds."""
        return self._state.swarm.task

    def raise_faults(self) -> None:
        """Raise one SimulationFault for all faults so far, if there are any."""
        faults = self.faults
        if len(faults) == 1:
            raise faults[0]
        if faults:
            raise SimulationFault(summarize_faults(faults))

    def arrays(self) -> tuple[WorldParams, WorldState]:
        """Return parameters and state of all worlds."""
        return self._loop.worlds()

    def progress(self) -> np.ndarray:
        """Return the progress of the task in each world (B,)."""
        return np.asarray(self._state.progress)

    def metrics(self) -> dict[str, np.ndarray]:
        """Return the metrics of the task in each world (B,) so far, by their names."""
        return metrics_of(self._task_of_worlds, self.task_state)

    def measures(self, world: int) -> Measures:
        """Return the measures of a world so far.

        Raises:
            IndexError: there is no such world.
        """
        if not (is_whole(world) and 0 <= world < len(self.worlds)):
            raise IndexError(
                f"world must be between 0 and {len(self.worlds) - 1} (got {shown(world)})"
            )
        state = self._state
        finished_at = None
        if state.is_finished[world]:
            finished_at = int(state.finished_at[world])
        steps_without_energy = 0
        if state.swarm.steps_without_energy is not None:
            steps_without_energy = int(state.swarm.steps_without_energy[world].sum())
        return measure(
            self.task.balls(self.task_state),
            world,
            collisions=int(state.collisions[world]),
            finished_at=finished_at,
            starved=steps_without_energy,
        )


def check_scenario(scenario: Scenario) -> None:
    """Check a scenario as a run does at its start, but build no engine; it takes milliseconds.

    Raises:
        UserError: robots, worlds or settings do not fit each other.
    """
    setup = set_up(scenario, scenario.settings(record_worlds=(0,), capacity=None))
    if scenario.genome is None:
        strategies = of_all_worlds(
            scenario.strategy,
            setup.config,
            setup.robot,
            setup.worlds,
            is_per_world=scenario.strategy_per_world,
        )
        _check_methods(setup, strategies)


def _check_methods(setup: Setup, strategies: Any) -> None:
    """Check the methods of a user's strategies, and that their memories fit into the machine's.

    Args:
        setup: the checked scenario.
        strategies: strategy with a first axis of B worlds.

    Raises:
        UserError: they do not.
    """
    n_leds = len(setup.robot.sides)
    memories = check_strategies(strategies, setup.capacity, n_leds, setup.sensed)
    check_memory(setup.engine, len(setup.worlds), setup.capacity, memories)


def _without_bodies_and_memories(state: WorldState) -> WorldState:
    """Return a state without its large parts, which are of no use on the host."""
    swarm = state.swarm._replace(memory=None)
    return state._replace(bodies=None, touching=None, swarm=swarm)
