"""A run in progress: B worlds that advance together, on any engine, until each of them has ended."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from typing import Any

import jax
import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.checked import check_links
from iswarm_mj.simulation.build import build_loop
from iswarm_mj.simulation.faults import decode_faults, summarize_faults
from iswarm_mj.simulation.given import metrics_of, of_all_worlds, of_worlds, to_json
from iswarm_mj.simulation.layouts import with_boxes_laid
from iswarm_mj.simulation.memory_limits import check_memory
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.setup import set_up
from iswarm_mj.simulation.shared_settings import check_shared_settings
from iswarm_mj.simulation.state import StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.worlds import arenas_of_worlds, conditions_of_worlds, vector_strategies
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.declared import payload_of, recorded_of
from iswarm_mj.strategy.genome import TYPE1, Genome
from iswarm_mj.strategy.signatures import check_strategies
from iswarm_mj.strategy.teams import team_sizes
from iswarm_mj.strategy.vector_strategy import VectorStrategy, payload_for
from iswarm_mj.tasks.base import Task
from iswarm_mj.tasks.measures import Measures, measure
from iswarm_mj.tasks.signatures import as_task
from iswarm_mj.utils.constraints import check_kind, is_whole, validate
from iswarm_mj.utils.errors import SimulationFault, shown
from iswarm_mj.utils.jax_setup import check_jax
from iswarm_mj.utils.profiling import Stopwatch
from iswarm_mj.utils.units import mm_from_rd


class Run:
    """B worlds that advance together until each is finished or faulty, or the time is up.

    A fault ends only its own world, and `faults` names it. With MJX on Warp, a full contact buffer ends all worlds of
    the device, which share it.

    Attributes:
        scenario: what is simulated, as given.
        config: configuration that all worlds share.
        genome: parameters of the paper's strategy.
        settings: of the run.
        engine: settings of the engine.
        worlds: B worlds.
        starts: initial state of each world.
        start: record of the start of the W recorded worlds, with axes (1, W).
        strategy: as given; None for the paper's.
        task: as given.
        goal: progress of the task that finishes a world, in cleaning balls delivered; None if it never is.
        recorded: parts of the strategy's memory that recordings show, and their units.
        payload: fields of the messages.
        teams: number of robots of each team by its name (`strategy.teams`); empty without teams.
        robot: geometry of the robots.
        robot_file: MJCF file of the robots, as an absolute path, or several; None for `models/robot.xml`.
        watch: times of the stages.
    """

    def __init__(self, scenario: Scenario, *, record_worlds: Sequence[int] = (0,), capacity: int | None = None):
        """Prepare the worlds.

        Args:
            scenario: what is simulated.
            record_worlds: numbers of the worlds whose steps `advance` returns.
            capacity: robots for which compiled programs have room: runs of the same capacity share them. None for the
                robots of the largest world.

        Raises:
            UserError: robots, worlds or settings that do not fit.
        """
        check_kind("scenario", scenario, Scenario)
        settings = scenario.settings(record_worlds, capacity)
        setup = set_up(scenario, settings)
        self.scenario = scenario
        self.settings = settings
        self.config = setup.config
        self._configured_boxes = scenario.config.arena.boxes

        self.genome = scenario.genome or TYPE1
        self.strategy = None if scenario.genome else scenario.strategy
        self.engine = scenario.engine
        self.task = scenario.task
        self.goal = setup.goal
        self.worlds = list(setup.worlds)
        self.starts = setup.starts
        self.robot = setup.robot
        self.robot_file = scenario.robot_file
        self._tasks = setup.tasks
        self._capacity = setup.capacity

        strategies = self._strategies()
        n_leds = len(setup.robot.sides)
        if self.strategy is None:
            self.recorded = recorded_of(VectorStrategy)
            message_range = mm_from_rd(self.config.strategy.message_range)
            self.payload = payload_for(message_range, n_leds)
        else:
            memory = check_strategies(strategies, setup.capacity, n_leds, setup.sensed)
            check_memory(setup.engine, len(self.worlds), setup.capacity, memory)
            self.recorded = recorded_of(strategies)
            self.payload = payload_of(strategies)
        self.teams = team_sizes(strategies, setup.capacity)
        self.watch = Stopwatch()
        with jax.default_device(setup.device):
            self._loop, self.start = build_loop(setup, strategies, self.watch)
        self._taken = 0
        self.first_call_s, self._first_steps = 0.0, 0
        self._has_ended = np.zeros(len(self.worlds), bool)
        self._snapshot: WorldState | None = None

    def _strategies(self) -> Any:
        """The strategy with a first axis of B worlds."""
        if self.strategy is None:
            return vector_strategies(self.config, self.robot, self.worlds)
        return of_all_worlds(
            self.strategy,
            self.config,
            self.robot,
            self.worlds,
            is_per_world=self.scenario.strategy_per_world,
        )

    @property
    def step(self) -> int:
        """Last control step that any world took."""
        if not self._has_ended.all():
            return self._taken
        state = self._state
        return int(np.where(state.is_finished, state.finished_at, state.fault.step).max())

    @property
    def is_over(self) -> bool:
        """Whether the time is up or every world has ended."""
        return self._taken >= self.settings.steps or bool(self._has_ended.all())

    @property
    def rules(self) -> dict[str, Any]:
        """What the robots are to do and how, as results state it: the task; the genome or another strategy."""
        how = {"genome": asdict(self.genome)} if self.strategy is None else {"strategy": to_json(self.strategy)}
        return {"task": to_json(self.task), **how}

    @property
    def identity(self) -> dict[str, Any]:
        """Name and main settings of the engine, as results state them."""
        return self.engine.identity

    @property
    def devices(self) -> list[str]:
        """Devices that the worlds are spread over; none where the CPU's threads do all."""
        return [device.device_kind for device in self._loop.devices]

    def advance(self) -> StepRecord | None:
        """Take the next control steps: one on the host, a chunk in compiled programs.

        Returns:
            Record of the T steps of the W recorded worlds, NumPy arrays (T, W, ...); None if no world is recorded.

        Raises:
            RuntimeError: the run is over.
        """
        check_jax()
        if self.is_over:
            raise RuntimeError(f"the run is over after {self.step} control steps; make a new Run to go on")
        first = self._taken
        with self.watch("advance"):
            taken, record = self._loop.advance(first, self.settings.steps, self.settings.record_worlds)
        self._taken += taken
        is_finished, fault = self._loop.read(lambda state: (state.is_finished, state.fault.bits))
        self._has_ended, self._snapshot = is_finished | (fault != 0), None
        if first == 0:  # which compiles: of no stage
            self.first_call_s, self._first_steps = self.watch.laps["advance"][0], taken
            self.watch.laps.clear()
        if record is not None and not self.engine.is_shipped:
            check_links(f"the engine {self.engine.name}", record.links, record.poses.shape[-2], len(self.robot.sides))
        n_steps = self.step - first
        return None if record is None else jax.tree.map(lambda a: a[:n_steps], record)

    def change(self, config: SwarmConfig, strategy: Strategy | Genome | Any, task: Task | Any = None) -> None:
        """Give all worlds other settings from the next control step on; places and memories stay as they are.

        Args:
            config: may differ from the run's in `shared_settings.PER_WORLD_FIELDS`.
            strategy: a genome of the paper's where the run has one; otherwise of the same class, static fields and
                shapes as the run's.
            task: likewise; None for the present one.

        Raises:
            UserError: the configurations differ in something else, or a field of the task is out of range.
        """
        # Boxes that the task laid take the place of those of the configuration, as at the start.
        if config.arena.boxes == self._configured_boxes:
            config = with_boxes_laid(config, self.config.arena.boxes, type(self.task).__name__)

        check_shared_settings(self.config, config)
        if task is not None:
            validate(task)
            self.task, self._tasks = task, of_worlds(as_task(task), len(self.worlds))
        is_genome = isinstance(strategy, Genome)
        own = {"config": config, "genome": strategy} if is_genome else {"config": config}
        self.worlds, self.strategy = [replace(world, **own) for world in self.worlds], None if is_genome else strategy
        params, state = self.arrays()
        conditions = conditions_of_worlds(config, self.worlds)
        arena = arenas_of_worlds(config, self.worlds)
        params = params._replace(strategy=self._strategies(), conditions=conditions, task=self._tasks, arena=arena)
        self._loop.replace(params, state.swarm)

    def edit(self, edit: Callable[[SwarmState], SwarmState]) -> None:
        """Put another state of the swarm in place of the present one, from the next control step on.

        Args:
            edit: makes it of the present one; NumPy arrays of B worlds, with the same shapes and types.
        """
        params, state = self.arrays()
        self._loop.replace(params, edit(state.swarm))
        self._snapshot = None

    def stage_times(self) -> dict[str, float]:
        """Return the median seconds that a control step spends in sense, policy and physics."""
        return self._loop.stage_times()

    @property
    def step_s(self) -> float | None:
        """Seconds that a control step took on average, without the first call, which compiles; None before others."""
        taken = self._taken - self._first_steps
        return sum(self.watch.laps["advance"]) / taken if taken else None

    def peak_memory_gb(self) -> float | None:
        """Return the most memory that a device had in use [GB]; None where no device reports it."""
        stats = [device.memory_stats() for device in self._loop.devices]
        peaks = [found["peak_bytes_in_use"] for found in stats if found and "peak_bytes_in_use" in found]
        return round(max(peaks) / 1e9, 2) if peaks else None

    @property
    def faults(self) -> list[SimulationFault]:
        """What went wrong so far, at most one fault a world."""
        return [fault for fault in self.fault_of_each if fault is not None]

    @property
    def fault_of_each(self) -> list[SimulationFault | None]:
        """The fault of each world, None for a world without one."""
        return decode_faults(self._state.fault, [world.index for world in self.worlds], self._capacity)

    @property
    def _state(self) -> WorldState:
        """State of all worlds but for their bodies and memories, which leaves a device when it is asked for."""
        if self._snapshot is None:
            self._snapshot = self._loop.read(
                lambda state: state._replace(bodies=None, touching=None, swarm=state.swarm._replace(memory=None))
            )
        return self._snapshot

    @property
    def task_state(self) -> Any:
        """State of the task in all worlds, as NumPy arrays with a first axis of B worlds."""
        return self._state.swarm.task

    def raise_faults(self) -> None:
        """Raise one SimulationFault for all faults so far, if there are any."""
        if faults := self.faults:
            raise faults[0] if len(faults) == 1 else SimulationFault(summarize_faults(faults))

    def arrays(self) -> tuple[WorldParams, WorldState]:
        """Return parameters and state of all worlds."""
        return self._loop.worlds()

    def progress(self) -> np.ndarray:
        """Return the progress of the task in each world (B,)."""
        return np.asarray(self._state.progress)

    def metrics(self) -> dict[str, np.ndarray]:
        """Return the metrics of the task in each world (B,) so far, by their names."""
        return metrics_of(self._tasks, self.task_state)

    def measures(self, world: int) -> Measures:
        """Return the measures of a world so far.

        Raises:
            IndexError: there is no such world.
        """
        if not (is_whole(world) and 0 <= world < len(self.worlds)):
            raise IndexError(f"world must be between 0 and {len(self.worlds) - 1} (got {shown(world)})")
        state = self._state
        finished_at = int(state.finished_at[world]) if state.is_finished[world] else None
        starved = 0 if state.swarm.steps_without_energy is None else int(state.swarm.steps_without_energy[world].sum())
        return measure(self.task.balls(self.task_state), world, int(state.collisions[world]), finished_at, starved)
