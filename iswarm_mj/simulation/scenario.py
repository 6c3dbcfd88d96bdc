"""Scenarios: the description of a simulation that runs, environments, searches and pages share."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Self

import jax
import jax.numpy as jnp

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.registry import ENGINES
from iswarm_mj.engines.robot_file import as_robot_file, files_of
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.geometry.robot import RobotFile
from iswarm_mj.simulation.failures import Failures, as_failures
from iswarm_mj.simulation.read_scenario import fields_of_result, fields_of_toml
from iswarm_mj.simulation.scenario_flags import STEPS, toml, values_of
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import TYPE1, Genome
from iswarm_mj.strategy.pytrees import refuse_class
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.constraints import check, constraint_of, is_whole, validate
from iswarm_mj.utils.errors import UserError


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Description of a simulation, which `Run`, `rollout`, `make_env`, `evolve` and `play` take.

    All fields but the first are keywords, so their order does not matter. `dataclasses.replace`
    makes variants.
    """

    config: SwarmConfig = field(default_factory=SwarmConfig, kw_only=False)
    """Arena, drive, optics, gripper, interpretations of the paper, and energy."""
    strategy: Any = TYPE1
    """Strategy of the robots: a genome of the paper's, or another one (`Strategy`). Environments
    ignore it, since actions take its place."""
    task: Any = CLEANING
    """Task of the robots, see `Task`."""
    robots: Annotated[int | None, constraint_of(RunSettings, "n_robots")] = None
    """Number of robots; by default it follows from `robot_file`, or from the density of the genome,
    or else of type 1."""
    robot_file: RobotFile = None
    """MJCF file of the robots, None for `models/robot.xml`; or files of several kinds, as
    `["a.xml:200", "b.xml:80"]` with the number of robots of each."""
    engine: EngineSettings = field(default_factory=MujocoSettings)
    """The engine, with its settings."""
    seed: Annotated[int, constraint_of(RunSettings, "seed")] = 0
    """Seed of all random numbers."""
    worlds: int | Sequence[World] | Any = 1
    """Number of worlds of the seed; or a sequence with a `World` for each; or a random key for
    each, as `jax.random.split(jax.random.key(0), 8)`: different strategies meet the same worlds
    with the same keys.

    Worlds of a sequence may differ in the fields of `World`: genome (where the strategy is a
    genome), number of robots, seed and index, share of dead robots, start, key, and configuration.
    Configurations may differ in noise, voltages, adhesion, places and interpretations; the edge of
    the arena, optics and everything else that programs are compiled for are those of `config`. All
    worlds share task and engine, and the strategy but for its `for_world` and for
    `strategy_per_world`.
    """
    strategy_per_world: bool = False
    """The arrays of the strategy have a first axis of worlds: each world has a strategy of its
    own."""
    steps: Annotated[int, constraint_of(RunSettings, "steps")] = STEPS
    """Maximum number of control steps, in environments that of an episode; the page of `play`
    ignores it."""
    goal: Annotated[int | None, constraint_of(RunSettings, "stop_at")] = None
    """Progress of the task that finishes a world, in cleaning the number of balls delivered; None
    for the task's goal."""
    failing: Failures | str | None = None
    """Robots that fail during the run, as `"0.1:400"`: a tenth of them at control step 400."""
    strategy_name: str | None = field(default=None, compare=False)
    """Name of the strategy in files and commands, as --strategy takes it; names of teams have
    blanks between them. By default the name under which a package offers its class, or its
    file."""
    task_name: str | None = field(default=None, compare=False)
    """Name of the task in files and commands, as --task takes it."""

    def __post_init__(self):
        known = ", ".join(f"{settings.__name__}()" for settings in ENGINES.values())
        is_engine = isinstance(self.engine, EngineSettings)
        check("engine", self.engine, f"settings of an engine, as {known}", is_engine)
        for field_name in ("strategy_name", "task_name"):
            name = getattr(self, field_name)
            check(field_name, name, "a text", name is None or isinstance(name, str))
        validate(self)
        refuse_class(self.strategy, "strategy")
        refuse_class(self.task, "task")
        object.__setattr__(self, "robot_file", as_robot_file(self.robot_file))

        object.__setattr__(self, "failing", as_failures(self.failing))
        object.__setattr__(self, "worlds", _checked_worlds(self.worlds))
        if isinstance(self.strategy, Genome):
            check_genome(self.strategy, self.worlds)

    @property
    def genome(self) -> Genome | None:
        """The genome, if they follow the paper's strategy."""
        return self.strategy if isinstance(self.strategy, Genome) else None

    @property
    def n_robots(self) -> int:
        """Number of robots, in the largest world."""
        if self.robots is not None:
            return int(self.robots)
        if isinstance(self.worlds, tuple):
            return max(world.n_robots for world in self.worlds)
        of_kinds = sum(number for _, number in files_of(self.robot_file))
        density = (self.genome or TYPE1).density_of_robots
        return of_kinds or robots_for(self.config.arena, density, "density_of_robots")

    @property
    def n_worlds(self) -> int:
        """Number of worlds."""
        return self.worlds if isinstance(self.worlds, int) else len(self.worlds)

    def settings(
        self, record_worlds: Sequence[int] = (), capacity: int | None = None
    ) -> RunSettings:
        """Return the settings of a run.

        Args:
            record_worlds: numbers of the worlds that are recorded.
            capacity: robots for which compiled programs have room; None for those of the largest
                world.
        """
        worlds = self.worlds if isinstance(self.worlds, tuple) else ()
        failed_fractions = {world.failed_fraction for world in worlds}
        return RunSettings(
            n_robots=self.n_robots,
            steps=self.steps,
            seed=int(self.seed),
            n_worlds=self.n_worlds,
            stop_at=self.goal,
            failed_fraction=failed_fractions.pop() if len(failed_fractions) == 1 else 0.0,
            failing=None if self.failing is None else str(self.failing),
            capacity=capacity,
            record_worlds=tuple(record_worlds),
        )

    def list_worlds(self) -> list[World]:
        """Return all worlds, also those that a seed or keys determine."""
        if isinstance(self.worlds, tuple):
            return list(self.worlds)
        keys: Any = [None] * self.worlds if isinstance(self.worlds, int) else self.worlds
        genome = self.genome or TYPE1
        n_robots = self.n_robots
        return [
            World(genome, n_robots, seed=int(self.seed), index=index, key=key)
            for index, key in enumerate(keys)
        ]

    def values(self) -> dict[str, Any]:
        """Return the settings that differ from the defaults of `iswarm run`, by its flags.

        Raises:
            UserError: no flag can state one of them.
        """
        return values_of(self)

    def to_toml(self) -> str:
        """Return the text of a file for `iswarm run --config` and for `from_toml`.

        Raises:
            UserError: no file can state it, such as a strategy that lives in a notebook.
        """
        return toml(self.values())

    @classmethod
    def from_toml(cls, path: str | Path) -> Self:
        """Read a file whose keys are flags of `iswarm run`, such as `to_toml` states.

        A class of a user's file is loaded by the name of its file. It is the class that was loaded
        so before, unless the file has changed, but not one that a plain import gave.

        Raises:
            UserError: the file cannot be read, or has a key that is no part of a scenario.
        """
        return cls(**fields_of_toml(Path(path)))

    @classmethod
    def from_result(
        cls,
        result: str | Path | Mapping[str, Any],
        *,
        strategy: Any = None,
        task: Any = None,
        engine: type[EngineSettings] | None = None,
    ) -> Self:
        """Read the scenario of a run from its result.json, which does not state worlds that differ.

        Args:
            result: the file, or its content.
            strategy: class of the run's strategy where no installed package offers it, or the
                strategy itself.
            task: class of the run's task where no installed package offers it, or the task itself.
            engine: class of the run's engine where no installed package offers it.

        Raises:
            UserError: it is no result of a run, or it does not state a part completely.
        """
        return cls(**fields_of_result(result, strategy, task, engine))


def check_genome(genome: Genome, worlds: Any) -> None:
    """Refuse the genome of a run whose worlds have other ones; type 1 is the default.

    Raises:
        UserError: no world has it.
    """
    if genome == TYPE1 or not isinstance(worlds, tuple):
        return
    if all(world.genome != genome for world in worlds):
        raise UserError("strategy is a genome, but worlds have their own; leave out one of them")


def _checked_worlds(worlds: Any) -> Any:
    """Return the number of worlds, their random keys, or a tuple of the worlds.

    Raises:
        ConfigError: the value is something else.
    """
    allowed = "a number above 0, a World for each, or a random key for each"
    if is_whole(worlds):
        check("worlds", worlds, allowed, worlds > 0)
        return int(worlds)
    if isinstance(worlds, jax.Array):
        are_keys = jnp.issubdtype(worlds.dtype, jax.dtypes.prng_key) and worlds.ndim == 1
        type_and_shape = f"{worlds.dtype}{list(worlds.shape)}"
        check("worlds", type_and_shape, allowed, are_keys and len(worlds) > 0)
        return worlds
    are_worlds = isinstance(worlds, Sequence) and all(isinstance(world, World) for world in worlds)
    check("worlds", worlds, allowed, are_worlds and len(worlds) > 0)
    return tuple(worlds)
