"""Flags that the commands on a swarm share."""

import re
import shlex
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from iswarm_mj.commands.command_settings import refuse_changed, with_defaults
from iswarm_mj.commands.options import ConfigOptions
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import Genome, load_genome
from iswarm_mj.utils.constraints import Above, Needs, constraint_of, validate
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.progress import waiting


@dataclass(frozen=True)
class RobotOptions:
    """Robots of a swarm."""

    robot: Annotated[tuple[str, ...], tyro.conf.arg(metavar="FILE[:ROBOTS]")] = ()
    """An MJCF file of other robots, a copy of models/robot.xml with another hull, probe, LEDs and
    photodiodes. Several share the swarm as kinds, with the number of the robots of each: a.xml:200
    b.xml:80."""

    @property
    def robot_file(self) -> Any:
        """The file of the robots, or the files of their kinds, see `RobotFile`."""
        from iswarm_mj.engines.robot_file import as_robot_file

        is_one = len(self.robot) == 1 and not re.search(r":\d+$", self.robot[0])
        return as_robot_file(self.robot[0] if is_one else self.robot or None)


@dataclass(frozen=True)
class TaskOptions:
    """Task of the robots."""

    task_name: Annotated[str | None, tyro.conf.arg(name="task", metavar="FILE.py:CLASS|NAME")] = (
        None
    )
    """Task of the robots, cleaning by default: a class in a file, or the name under which an
    installed package offers one (entry points iswarm_mj.tasks); its fields become flags, see --task
    ... --help."""
    task_plugin: Any = None
    """The task with the values of its flags, where `task_name` names one."""

    @property
    def task(self) -> Any:
        """Task of the robots."""
        from iswarm_mj.tasks.cleaning import CLEANING

        return CLEANING if self.task_plugin is None else self.task_plugin


@dataclass(frozen=True)
class Swarm(ConfigOptions, RobotOptions):
    """Settings that the commands on a swarm share."""

    controller: Annotated[
        tuple[str, ...], tyro.conf.arg(name="strategy", metavar="FILE.py:CLASS|NAME")
    ] = ()
    """Strategy of the robots in place of the genome's: a class in a file, or the name under which
    an installed package offers one (entry points iswarm_mj.strategies); its fields become
    flags, see --strategy ... --help. Several share the swarm as teams, with the share or number of
    the robots of each: a.py:A=0.7 type2=0.3."""
    genome: Annotated[str, Needs("controller", ((),), "with `strategy`")] = "type1"
    """A preset (type1 or type2 of the paper's Table 2, or evolved), or a JSON file of the
    parameters; each is a flag, too, see --genome ... --help."""
    robots: Annotated[int | None, constraint_of(RunSettings, "n_robots")] = None
    """Number of robots; by default it follows from the density."""
    density: Annotated[float | None, Above(0, 1)] = None
    """Robots per 1 x 1 rd cell outside the dump; by default the genome's."""
    seed: Annotated[int, constraint_of(RunSettings, "seed")] = 0
    """Seed of all random numbers."""
    worlds: Annotated[int, constraint_of(RunSettings, "n_worlds")] = 1
    """Number of independent worlds, simulated together."""
    failing: Annotated[str | None, tyro.conf.arg(metavar="SHARE:STEP")] = None
    """Share of the robots that fail, and the control step at which they do, as 0.1:400; from then
    on they only stand in the way, and keep their balls."""
    strategy_plugin: Any = None
    """The strategy with the values of its flags: what `controller` names, or else the genome, an
    object of `Genome`."""

    def __post_init__(self):
        validate(self)

    @property
    def rules(self) -> Any:
        """The strategy, or the genome of the paper's."""
        return load_genome(self.genome) if self.strategy_plugin is None else self.strategy_plugin

    def number_of_robots(self) -> int:
        """Return the number of robots, after checks of all settings that it depends on.

        Raises:
            UserError: a setting is out of range, or contradicts another one.
        """
        from iswarm_mj.engines.robot_file import check_total, files_of, read_robots
        from iswarm_mj.tasks.layout import cell_of, check_robots

        if self.robots is not None or self.density is not None:
            refuse_changed(self, ["strategy.density_of_robots"], "with `robots` or `density`")
        self._refuse_number_as_file()

        robot_file = self.robot_file
        n_of_files = sum(n for _, n in files_of(robot_file))
        if self.density is not None and (self.robots is not None or n_of_files):
            number_flag = "--robots" if self.robots is not None else "numbers of robots in --robot"
            raise UserError(f"{number_flag} and --density exclude each other; give one of them.")

        n_robots = self.robots or n_of_files or self._number_by_density()
        check_total(robot_file, n_robots)
        check_robots(self.config.arena, n_robots, cell_of(read_robots(robot_file)))
        return n_robots

    def _refuse_number_as_file(self) -> None:
        """Refuse a number given to `--robot`, which was meant for `--robots`."""
        if len(self.robot) != 1:
            return
        word = self.robot[0]
        if word.isdigit() and not Path(word).exists():
            raise UserError(
                f"--robot must be a file in MJCF (got {word}); perhaps you meant --robots {word}."
            )

    def _number_by_density(self) -> int:
        """Return the number of robots that follows from `density`, or from the genome's."""
        from iswarm_mj.tasks.layout import robots_for

        arena = self.config.arena
        if self.density is not None:
            return robots_for(arena, self.density, "density")
        genome = self.rules if isinstance(self.rules, Genome) else load_genome(self.genome)
        return robots_for(arena, genome.density_of_robots, "density_of_robots")

    def scenario(self, **fields: Any) -> Any:
        """Return the `Scenario` that the flags describe.

        Args:
            fields: further fields of the scenario, of flags that only some commands have.

        Raises:
            UserError: see `number_of_robots`.
        """
        n_robots = self.number_of_robots()
        from iswarm_mj.simulation.scenario import Scenario

        return Scenario(
            self.config,
            strategy=self.rules,
            robots=self.robots if self.density is None else n_robots,
            robot_file=self.robot_file,
            engine=self.engine_settings,
            seed=self.seed,
            worlds=self.worlds,
            failing=self.failing,
            strategy_name=self._strategy_name(),
            **fields,
        )

    def _strategy_name(self) -> str:
        """Return the words of `--strategy` as one text, of which a shell makes the words again."""
        if len(self.controller) > 1:
            return shlex.join(self.controller)
        return "".join(self.controller)


def run_of(scenario: Any, record_worlds: tuple[int, ...] = ()) -> Any:
    """Return the `Run` of a scenario at its start, and say that robots are placed if that takes
    long."""
    from iswarm_mj.simulation.run import Run

    n_worlds = scenario.n_worlds
    with waiting(f"placing {scenario.n_robots} robots in {n_worlds} world{'s' * (n_worlds > 1)}"):
        return Run(scenario, record_worlds=record_worlds)


@dataclass(frozen=True)
class WithTask(TaskOptions, Swarm):
    """Settings of commands on a swarm with any task."""

    def scenario(self, **fields: Any) -> Any:
        """Return the scenario with its task, see `Swarm.scenario`."""
        return super().scenario(task=self.task, task_name=self.task_name, **fields)

    def number_of_robots(self) -> int:
        """Return the number of robots, and refuse settings that the task does not use.

        Raises:
            UserError: see `Swarm.number_of_robots`.
        """
        for setting in self.task.unused:
            group, _, name = setting.partition(".")
            names = [name] if name else [field.name for field in fields(getattr(self, group))]
            refused = [f"{group}.{each}" for each in names if self._allows_default(group, each)]
            refuse_changed(self, refused, f"in the task {type(self.task).__name__}")
        return super().number_of_robots()

    def _allows_default(self, group: str, name: str) -> bool:
        """Return whether the other settings allow the default of this one.

        In a small arena they may not.
        """
        default = getattr(getattr(with_defaults(self), group), name)
        try:
            replace(getattr(self, group), **{name: default})
        except ConfigError:
            return False
        return True
