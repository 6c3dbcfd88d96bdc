"""The command `iswarm`."""

import contextlib
import io
import itertools
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, make_dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from iswarm_mj.compilation import quieten
from iswarm_mj.config import (
    ArenaConfig,
    DriveConfig,
    GripperConfig,
    OpticsConfig,
    StrategyConfig,
    SwarmConfig,
    check,
)
from iswarm_mj.errors import SimulationFault, UserError
from iswarm_mj.strategy.genome import Genome, load_genome, overridden

GenomeOverrides = make_dataclass(
    "GenomeOverrides",
    [
        (f.name, Annotated[f.type | None, tyro.conf.arg(help="Instead of the genome's value.")], None)  # type: ignore
        for f in fields(Genome)
    ],
    frozen=True,
)
GenomeOverrides.__doc__ = "Single parameters of the genome (Table 2 of the paper)."


MOST_ROBOTS = 200_000
"""Robots in all worlds together that the memory of an ordinary machine holds (about 0.1 MB each)."""


@dataclass(frozen=True)
class Swarm:
    """Settings that every command on a swarm has."""

    genome: str = "type1"
    """A preset, type1 or type2 of the paper's Table 2, or a JSON file of its parameters."""
    robots: int | None = None
    """Number of robots; given neither this nor the density, the genome's density counts."""
    density: float | None = None
    """Robots per 1 x 1 rd cell outside the dump."""
    seed: int = 0
    """Seed of all random numbers."""
    worlds: int = 1
    """Number of independent worlds at once."""
    engine: str = "mujoco"
    """Physics engine: mujoco (C, on CPUs)."""
    threads: int = 0
    """Threads for the physics, 0 for one a core; the results do not depend on it."""
    override: Annotated[Any, tyro.conf.arg(name="")] = field(default_factory=GenomeOverrides)
    arena: ArenaConfig = field(default_factory=ArenaConfig)
    drive: DriveConfig = field(default_factory=DriveConfig)
    optics: OpticsConfig = field(default_factory=OpticsConfig)
    gripper: GripperConfig = field(default_factory=GripperConfig)
    strategy: StrategyConfig = field(default_factory=StrategyConfig)

    def checked(self) -> tuple[SwarmConfig, Genome, int]:
        """Return the configuration, the genome and the number of robots.

        Raises:
            UserError: something given is out of range.
        """
        from iswarm_mj.layout import check_robots, robots_for

        check("seed", self.seed, "between 0 and 2^32 - 2", 0 <= self.seed < 2**32 - 1)
        check("worlds", self.worlds, "at least 1", self.worlds >= 1)
        check("threads", self.threads, "between 0 and 1024", 0 <= self.threads <= 1024)
        check("engine", self.engine, "mujoco", self.engine == "mujoco")
        genome = overridden(load_genome(self.genome), vars(self.override))
        config = SwarmConfig(self.arena, self.drive, self.optics, self.gripper, self.strategy)
        if self.robots is not None and self.density is not None:
            raise UserError("--robots and --density were both given; one of them is enough: leave the other out.")
        density = genome.density_of_robots if self.density is None else self.density
        name = "density_of_robots of the genome" if self.density is None else "--density"
        n_robots = robots_for(config.arena, density, name) if self.robots is None else self.robots
        check_robots(config.arena, n_robots)
        most = MOST_ROBOTS // n_robots
        check("worlds", self.worlds, f"between 1 and {most} with {n_robots} robots in each", self.worlds <= most)
        return config, genome, n_robots


@dataclass(frozen=True)
class Clean(Swarm):
    """Run the cleaning swarm and write result.json, trajectory.npz and clean.rrd (open it with `rerun`)."""

    steps: int = 800
    """Control steps at most."""
    stop_at: int | None = None
    """Finish when this many balls are delivered; all of them by default."""
    out: Path = Path("runs/clean")
    """Directory for the results; those of an earlier run in it are replaced."""
    record: bool = True
    """Record the first world to trajectory.npz and clean.rrd."""

    def run(self) -> None:
        """Run the command."""
        config, genome, n_robots = self.checked()
        check("steps", self.steps, "between 1 and 1000000", 1 <= self.steps <= 1_000_000)
        n_dust = config.arena.n_dust
        stop_at = n_dust if self.stop_at is None else self.stop_at
        check("stop_at", stop_at, f"between 1 and the number of balls, {n_dust}", 1 <= stop_at <= n_dust)
        from iswarm_mj.cleaning import clean
        from iswarm_mj.rollout import RunSettings

        settings = RunSettings(n_robots, self.steps, self.seed, self.worlds, self.threads, stop_at)
        clean(config, genome, settings, self.engine, self.out, self.record)


@dataclass(frozen=True)
class Bench(Swarm):
    """Time the control step and its parts on this machine; prints one JSON line."""

    steps: int = 200
    """Control steps that are timed."""
    warm_up: int = 20
    """Control steps before that."""
    record: bool = False
    """Record too, to a temporary file."""

    def run(self) -> None:
        """Run the command."""
        config, genome, n_robots = self.checked()
        check("steps", self.steps, "between 1 and 100000", 1 <= self.steps <= 100_000)
        check("warm_up", self.warm_up, "between 1 and 100000", 1 <= self.warm_up <= 100_000)
        from iswarm_mj.benchmark import bench
        from iswarm_mj.rollout import RunSettings

        settings = RunSettings(n_robots, self.warm_up + self.steps, self.seed, self.worlds, self.threads)
        bench(config, genome, settings, self.engine, self.warm_up, self.record)


@dataclass(frozen=True)
class Picture:
    """Render one step of a recorded run to a PNG, off-screen."""

    directory: tyro.conf.Positional[Path] = Path("runs/clean")
    """The --out of a run of `iswarm clean`."""
    step: int = 100
    """Control step, from 0 for the start."""
    camera: str = "above"
    """above or oblique."""
    width: int = 1280
    """[pixels]"""
    height: int = 1280
    """[pixels]"""
    ball_scale: float = 15.0
    """The balls are drawn this many times larger, or they would not show."""
    out: Path = Path("swarm.png")
    """The file to write."""

    def run(self) -> None:
        """Run the command."""
        check("width", self.width, "between 16 and 8192 pixels", 16 <= self.width <= 8192)
        check("height", self.height, "between 16 and 8192 pixels", 16 <= self.height <= 8192)
        check("ball_scale", self.ball_scale, "between 1 and 1000", 1 <= self.ball_scale <= 1000)
        from iswarm_mj.picture import render

        render(self.directory, self.step, self.camera, (self.width, self.height), self.ball_scale, self.out)


COMMANDS = {"clean": Clean, "picture": Picture, "bench": Bench}


def parse(arguments: Sequence[str] | None) -> Clean | Picture | Bench:
    """Return the command that the arguments ask for.

    Raises:
        UserError: a flag is unknown or its value not of its type; tyro's box of text as one sentence.
    """
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="iswarm", args=arguments)
    except SystemExit as stop:
        if not stop.code:
            raise
    lines = [line.strip("│╭╮╰╯ ") for line in said.getvalue().splitlines()]
    lines = [line for line in lines[1:] if line.strip("─ ")] or ["The command line could not be read."]
    ends = ("Got errors", "Argument helptext", "For full", "Perhaps")
    fact = " ".join(itertools.takewhile(lambda line: not line.startswith(ends), lines))
    raise UserError(f"{fact.rstrip('.')}; `iswarm --help` and `iswarm clean --help` list what is allowed.")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of `iswarm`; exits with 2 on bad input and 1 on a fault of the simulation."""
    quieten()
    try:
        parse(arguments).run()
    except UserError as error:
        print(f"iswarm: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except SimulationFault as fault:
        print(f"iswarm: {fault}", file=sys.stderr)
        raise SystemExit(1) from None
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(141) from None
    except KeyboardInterrupt:
        print("iswarm: interrupted; what was recorded so far is kept.", file=sys.stderr)
        raise SystemExit(130) from None
