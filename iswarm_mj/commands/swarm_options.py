"""Flags that every command on a swarm has."""

import importlib.util
from dataclasses import asdict, dataclass, field, fields, make_dataclass, replace
from typing import Annotated, Any

import tyro

from iswarm_mj.config import (
    ArenaConfig,
    DriveConfig,
    GripperConfig,
    OpticsConfig,
    StrategyConfig,
    SwarmConfig,
    check,
)
from iswarm_mj.strategy.genome import Genome, load_genome, overridden
from iswarm_mj.utils.errors import UserError

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
MOST_ROBOTS_MJX = 5_000_000
"""Likewise on GPUs, several of them together."""
_MJX_ONLY = ("impl", "solver_iterations", "contact_room", "devices", "hosts", "hosts_timeout")
_OWN = {"devices", "hosts_timeout", "threads", "out"}  # what each of several processes may have of its own
_RESOLVED = {"genome", "override", "robots", "density"}  # what `checked` makes the genome and the number of robots of


@dataclass(frozen=True)
class Swarm:
    """Settings that every command on a swarm has."""

    genome: str = "type1"
    """A preset, type1 or type2 of the paper's Table 2 or evolved, or a JSON file of the parameters."""
    robots: int | None = None
    """Number of robots; given neither this nor the density, the genome's density counts."""
    density: float | None = None
    """Robots per 1 x 1 rd cell outside the dump."""
    seed: int = 0
    """Seed of all random numbers."""
    worlds: int = 1
    """Number of independent worlds at once."""
    engine: str = "mujoco"
    """Physics engine: mujoco (C, on CPUs), or mjx (batches compiled by JAX, on GPUs and CPUs)."""
    impl: str = "jax"
    """Implementation of mjx: jax (everywhere), or warp (NVIDIA GPUs, the fastest there; slow on CPUs)."""
    solver_iterations: int = 100
    """Iterations of the contact solver of mjx at most: 100 for MuJoCo's own result, 20 for speed."""
    contact_room: float = 1.0
    """Room for contacts in mjx, relative to the rule's; jammed swarms need more."""
    devices: str = "all"
    """Devices that mjx spreads the worlds over: all, or how many of those that JAX sees."""
    hosts: bool = False
    """Share the worlds of mjx among the processes of a job on several hosts; each uses its own `devices`."""
    hosts_timeout: float = 300.0
    """Seconds for which a process waits for the others when it begins."""
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
        from iswarm_mj.simulation.initial import check_robots, robots_for

        check("seed", self.seed, "between 0 and 2^32 - 2", 0 <= self.seed < 2**32 - 1)
        check("worlds", self.worlds, "at least 1", self.worlds >= 1)
        check("threads", self.threads, "between 0 and 1024", 0 <= self.threads <= 1024)
        check("engine", self.engine, "mujoco or mjx", self.engine in ("mujoco", "mjx"))
        for name in _MJX_ONLY:
            is_fit = self.engine == "mjx" or getattr(self, name) == getattr(Swarm, name)
            check("engine", self.engine, f"mjx with --{name.replace('_', '-')}", is_fit)
        check("impl", self.impl, "jax or warp", self.impl in ("jax", "warp"))
        check("hosts_timeout", self.hosts_timeout, "between 1 and 86400 s", 1 <= self.hosts_timeout <= 86_400)
        if self.impl == "warp" and self.engine == "mjx" and importlib.util.find_spec("warp") is None:
            raise UserError("--impl was warp, which needs the package warp-lang: pip install 'iswarm-mj[warp]'.")
        genome = overridden(load_genome(self.genome), vars(self.override))
        config = SwarmConfig(self.arena, self.drive, self.optics, self.gripper, self.strategy)
        if self.robots is not None and self.density is not None:
            raise UserError("--robots and --density were both given; one of them is enough: leave the other out.")
        density = genome.density_of_robots if self.density is None else self.density
        name = "density_of_robots of the genome" if self.density is None else "--density"
        n_robots = robots_for(config.arena, density, name) if self.robots is None else self.robots
        check_robots(config.arena, n_robots)
        most = (MOST_ROBOTS if self.engine == "mujoco" else MOST_ROBOTS_MJX) // n_robots
        check("worlds", self.worlds, f"between 1 and {most} with {n_robots} robots in each", self.worlds <= most)
        return config, genome, n_robots

    def joined(self) -> Any:
        """Return the `Hosts` that share the worlds: with --hosts the processes of the job, else this one alone.

        Raises:
            UserError: they cannot be joined.
        """
        from iswarm_mj.simulation.distributed import ALONE, join

        return join(self.hosts_timeout) if self.hosts else ALONE

    def mjx_run(self, config: SwarmConfig, genome: Genome, n_robots: int, batch: Any, hosts: Any) -> Any:
        """Return a `BatchRun` of this process's share of the worlds.

        Args:
            config: as `checked` returned it.
            genome: likewise.
            n_robots: likewise.
            batch: `BatchSettings` of the whole run.
            hosts: as `joined` returned them.

        Raises:
            UserError: too few worlds, or too many recorded, for so many processes; or these were given different runs.
        """
        from iswarm_mj.simulation.distributed import devices
        from iswarm_mj.simulation.run_mjx import BatchRun, worlds_of_seed
        from iswarm_mj.simulation.worlds import World

        hosts.agree(self._deciding(genome, n_robots))
        share = hosts.share(self.worlds, batch.record_worlds)
        every = worlds_of_seed(World(genome, n_robots, self.seed), self.worlds)
        recorded = tuple(share.index(world) for world in batch.record_worlds) if hosts.index == 0 else ()
        batch = replace(batch, record_worlds=recorded)
        return BatchRun(config, [every[world] for world in share], batch, devices=devices(self.devices))

    def _deciding(self, genome: Genome, n_robots: int) -> dict[str, Any]:
        """All that decides a run in MJX: the command with its flags, and the versions of what computes it."""
        from iswarm_mj.utils.versions import versions

        flags = {name: value for name, value in asdict(self).items() if name not in _OWN | _RESOLVED}
        run = {"command": type(self).__name__.lower(), "robots": n_robots, "genome": asdict(genome)}
        return {**run, **flags, "versions": versions()}
