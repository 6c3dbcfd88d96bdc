"""Flags that the commands on a swarm share."""

import importlib.util
from dataclasses import dataclass, field, fields, make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, cast

import tyro

from iswarm_mj.commands.flags import refuse, usual
from iswarm_mj.commands.options import Accuracy, ConfigOptions, Refinement, Threads
from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import ENGINES, EngineName, ImplName, engine_settings
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import Genome, load_genome, overridden
from iswarm_mj.utils.constraints import Above, Needs, check, constraint_of, validate
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.progress import waiting

GenomeOverrides = make_dataclass(
    "GenomeOverrides",
    [(f.name, cast(Any, f.type) | None, None) for f in fields(Genome)],
    namespace={"described_by": Genome, "__doc__": "Single parameters of the genome (Table 2 of the paper)."},
    frozen=True,
)

MAX_ROBOTS = {"host": 200_000, "devices": 5_000_000}
"""Robots in all worlds together that fit into memory: about 0.1 MB each on an ordinary machine; on several GPUs."""

_OF_MJX = Needs("engine", ("mjx",))
_COMPILED = Needs("is_compiled", why="but with --engine mjx, and planar with --impl warp")
_ON_HOST = Needs("is_on_host", why="with --impl warp, which uses no threads")


@dataclass(frozen=True)
class Swarm(ConfigOptions):
    """Settings that the commands on a swarm share."""

    MAIN: ClassVar[tuple[str, ...]] = ("genome", "controller", "robots", "seed", "worlds", "engine", "impl")
    """Flags that `--help` shows."""

    controller: Annotated[str | None, tyro.conf.arg(name="strategy", metavar="FILE.py:CLASS|NAME")] = None
    """What the robots do in place of the genome's strategy: a class in a file, or the name under which an installed
    package offers one (entry points iswarm_mj.strategies); its fields become flags, see --strategy ... --help."""
    genome: Annotated[str, Needs("controller", (None,), "with `strategy`")] = "type1"
    """A preset (type1 or type2 of the paper's Table 2, or evolved), or a JSON file of the parameters."""
    robots: Annotated[int | None, constraint_of(RunSettings, "n_robots")] = None
    """Number of robots; by default it follows from the density."""
    robot: Path | None = None
    """An MJCF file of other robots, a copy of models/robot.xml with another hull, probe, LEDs and photodiodes."""
    density: Annotated[float | None, Above(0, 1)] = None
    """Robots per 1 x 1 rd cell outside the dump; by default the genome's."""
    seed: Annotated[int, constraint_of(RunSettings, "seed")] = 0
    """Seed of all random numbers."""
    worlds: Annotated[int, constraint_of(RunSettings, "n_worlds")] = 1
    """Number of independent worlds, simulated together."""
    engine: EngineName = "mujoco"
    """Physics engine: mujoco (C, on CPUs), planar (the same contacts solved in the plane, faster on CPUs and
    many times so on NVIDIA GPUs), or mjx (batches compiled by JAX, on GPUs and CPUs)."""
    impl: ImplName = "default"
    """Implementation. Of planar: numba (CPUs) or warp (NVIDIA GPUs, the default where there is one). Of mjx: jax
    (everywhere, the default) or warp (NVIDIA GPUs)."""
    solver_iterations: Annotated[int, constraint_of(MjxSettings, "solver_iterations"), _OF_MJX] = (
        MjxSettings.solver_iterations
    )
    contact_capacity: Annotated[float, constraint_of(MjxSettings, "contact_capacity"), _OF_MJX] = (
        MjxSettings.contact_capacity
    )
    refinement: Refinement = PlanarSettings.refinement
    accuracy: Accuracy = PlanarSettings.accuracy
    devices: Annotated[str, _COMPILED] = "all"
    """Devices that jax or warp distributes the worlds over: all, or a number of those that JAX sees."""
    threads: Annotated[Threads, _ON_HOST] = 0
    """Number of threads of mujoco and numba, 0 for one per core; results do not depend on it."""
    override: Annotated[Any, tyro.conf.arg(name="")] = field(default_factory=GenomeOverrides)
    own: Any = None
    """The strategy with the values of its flags, where `controller` names one; an object of `Genome`, or another."""

    def __post_init__(self):
        validate(self)

    def checked(self) -> tuple[SwarmConfig, Genome, int]:
        """Return the configuration, the genome and the number of robots.

        Raises:
            UserError: a setting is out of range, or contradicts another one.
        """
        known = ENGINES[self.engine].implementations
        constraint = f"{' or '.join(known) or 'left out'} with `engine` {self.engine}"
        check("impl", self.impl, constraint, self.impl in ("default", *known))
        if self.impl == "warp" and importlib.util.find_spec("warp") is None:
            raise UserError("--impl warp needs the package warp-lang; run pip install 'iswarm-mj[warp]'.")
        if self.robots is not None or self.density is not None:
            refuse(self, ["density_of_robots"], "with `robots` or `density`")
        is_genome = isinstance(self.own, Genome)
        genome = self.own if is_genome else overridden(load_genome(self.genome), vars(self.override))
        config = self.config
        n_robots = self._n_robots(config, genome)
        n_worlds = MAX_ROBOTS["devices" if self.is_compiled else "host"] // n_robots
        constraint = f"between 1 and {n_worlds} with {n_robots} robots in each world"
        check("worlds", self.worlds, constraint, self.worlds <= n_worlds)
        return config, genome, n_robots

    @property
    def task(self) -> Any:
        """What the robots are to do."""
        from iswarm_mj.tasks.cleaning import CLEANING

        return CLEANING

    @property
    def implementation(self) -> str | None:
        """The implementation of the engine that is used; None where there is only one."""
        return ENGINES[self.engine].usual_impl() if self.impl == "default" else self.impl

    @property
    def is_compiled(self) -> bool:
        """Whether control steps are taken in chunks, by a compiled program."""
        return not engine_settings(self.engine, impl=self.implementation).on_host

    @property
    def is_on_host(self) -> bool:
        """Whether threads of the CPU do all."""
        return not self.is_compiled

    def _n_robots(self, config: SwarmConfig, genome: Genome) -> int:
        from iswarm_mj.engines.robot_file import read_robot
        from iswarm_mj.tasks.layout import cell_of, check_robots, robots_for

        if self.robot is not None and str(self.robot).isdigit() and not self.robot.exists():
            given = self.robot
            raise UserError(f"--robot must be a file in MJCF (got {given}); perhaps you meant --robots {given}.")
        cell = 1.0 if self.robot is None else cell_of(read_robot(self.robot))
        if self.robots is not None and self.density is not None:
            raise UserError("--robots and --density exclude each other; give one of them.")
        if self.robots is not None:
            n_robots = self.robots
        elif self.density is not None:
            n_robots = robots_for(config.arena, self.density, "density")
        else:
            n_robots = robots_for(config.arena, genome.density_of_robots, "density_of_robots")
        check_robots(config.arena, n_robots, cell)
        return n_robots

    def run_of(self, config: SwarmConfig, genome: Genome, settings: RunSettings, chunk: int = 25) -> Any:
        """Return the `Run` at its start.

        Args:
            config: as returned by `checked`.
            genome: as returned by `checked`.
            settings: of the run.
            chunk: control steps that one call of a compiled program takes.
        """
        from iswarm_mj.simulation.run import Run

        n_worlds = settings.n_worlds
        with waiting(
            f"placing {settings.n_robots} robots in {n_worlds} world{'s' * (n_worlds > 1)}, compiling the engine"
        ):
            return Run(
                config,
                genome,
                settings,
                self.engine_settings(chunk),
                strategy=None if isinstance(self.own, Genome) else self.own,
                task=self.task,
                robot_file=self.robot,
            )

    def engine_settings(self, chunk: int) -> Any:
        """Return the settings of the engine; `chunk` control steps are one call of a compiled program."""
        from iswarm_mj.utils.jax_setup import devices

        used = tuple(devices(self.devices)) if self.is_compiled else None
        return engine_settings(
            self.engine, **{**vars(self), "impl": self.implementation, "chunk": chunk, "devices": used}
        )


@dataclass(frozen=True)
class WithTask(Swarm):
    """Settings of commands with any task."""

    task_name: Annotated[str | None, tyro.conf.arg(name="task", metavar="FILE.py:CLASS|NAME")] = None
    """What the robots are to do, cleaning by default: a class in a file, or the name under which an installed package
    offers one (entry points iswarm_mj.tasks); its fields become flags, see --task ... --help."""
    own_task: Any = None
    """The task with the values of its flags, where `task_name` names one."""

    @property
    def task(self) -> Any:
        """What the robots are to do."""
        return super().task if self.own_task is None else self.own_task

    def checked(self) -> tuple[SwarmConfig, Genome, int]:
        """See `Swarm.checked`."""
        for group, _, part in (name.partition(".") for name in getattr(self.task, "unused", ())):
            unused = [part] if part else [f.name for f in fields(getattr(self, group))]
            idle = [f"{group}.{name}" for name in unused if self._could_be_usual(group, name)]
            refuse(self, idle, f"in the task {type(self.task).__name__}")
        return super().checked()

    def _could_be_usual(self, group: str, name: str) -> bool:
        """Whether the other settings allow the default of this one, which in a small arena they may refuse."""
        try:
            replace(getattr(self, group), **{name: getattr(getattr(usual(self), group), name)})
        except ConfigError:
            return False
        return True
