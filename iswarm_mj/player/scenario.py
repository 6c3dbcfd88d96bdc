"""What determines a run on the page, and how a command line or a file states it."""

import inspect
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.registry import ENGINES, OFFER, find_engine
from iswarm_mj.engines.settings import OF_MACHINE, EngineSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import PRESETS, TYPE1, Genome
from iswarm_mj.strategy.library import STRATEGIES, Offer, find, offered
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.tasks.library import TASKS

STEPS = 1_000_000
"""Control steps of a run at most."""


@dataclass(frozen=True)
class Scenario:
    """A run of one world from its start. Settings are called as flags of `iswarm run`, with dots within groups."""

    config: SwarmConfig = field(default_factory=SwarmConfig)
    genome: Genome = TYPE1
    """Of the paper's strategy."""
    strategy: Any = None
    """Another strategy; None for the paper's."""
    task: Any = CLEANING
    robots: int | None = None
    """Their number; None: it follows from the genome's density."""
    seed: int = 0
    engine: EngineSettings = field(default_factory=MujocoSettings)
    robot_file: Path | None = None
    strategy_name: str | None = None
    """As --strategy takes it; by default the name under which a package offers its class, or its file."""
    task_name: str | None = None
    """As --task takes it, likewise."""

    @property
    def n_robots(self) -> int:
        """Number of robots."""
        arena, density = self.config.arena, self.genome.density_of_robots
        return robots_for(arena, density, "density_of_robots") if self.robots is None else self.robots

    @property
    def engine_name(self) -> str:
        """As --engine takes it."""
        return self.engine.name if self.engine.name in ENGINES else _name(OFFER, type(self.engine))

    def run(self) -> Run:
        """Return the run at its start.

        Raises:
            UserError: settings that do not fit each other.
        """
        settings = RunSettings(self.n_robots, STEPS, self.seed)
        return Run(
            self.config,
            self.genome,
            settings,
            self.engine.in_chunks(1),
            strategy=self.strategy,
            task=self.task,
            robot_file=self.robot_file,
        )

    def get(self, name: str) -> Any:
        """Return the value of a setting."""
        group, _, own = name.rpartition(".")
        if group:
            return getattr(getattr(self.config, group), own)
        if name in ("strategy", "task"):
            return self.named(STRATEGIES if name == "strategy" else TASKS)
        return self.engine_name if name == "engine" else getattr(getattr(self, _owner(self, name) or "", self), name)

    def set(self, name: str, value: Any) -> "Scenario":
        """Return this scenario with another value of a setting.

        Raises:
            UserError: it is out of range.
        """
        group, _, own = name.rpartition(".")
        if group:
            part = replace(getattr(self.config, group), **{own: value})
            return replace(self, config=replace(self.config, **{group: part}))
        if name == "engine":
            return self if value == self.engine_name else replace(self, engine=find_engine(value).usual())
        if name == "strategy":
            found = _made(STRATEGIES, value)
            if isinstance(found, Genome):
                return replace(self, genome=found, strategy=None, strategy_name=None)
            return replace(self, strategy=found, strategy_name=value)
        if name == "task":
            return replace(self, task=_made(TASKS, value), task_name=value)
        if name == "density_of_robots":
            return replace(self, robots=None, genome=replace(self.genome, density_of_robots=value))
        owner = _owner(self, name)
        changed = value if owner is None else replace(getattr(self, owner), **{name: value})
        return replace(self, **{owner or name: changed})

    def named(self, offer: Offer) -> str:
        """Return the name of its strategy or its task, as flags take it; of a genome, of the preset it was made of."""
        if offer is TASKS:
            return self.task_name or _name(TASKS, type(self.task))
        if self.strategy is not None:
            return self.strategy_name or _name(STRATEGIES, type(self.strategy))
        return next((name for name, preset in PRESETS.items() if preset == self.genome), "type1")

    def values(self) -> dict[str, Any]:
        """Return the settings that differ from the defaults of `iswarm run`, by the names of its flags."""
        found: dict[str, Any] = {"seed": self.seed, "robots": self.robots, "robot": self.robot_file}
        if self.task != CLEANING:
            found |= {"task": self.named(TASKS), **_plain(self.task)}
        if self.strategy is not None:
            found |= {"strategy": self.named(STRATEGIES), **_plain(self.strategy)}
        else:
            base = self.named(STRATEGIES)
            found |= {"genome": base} | _different(self.genome, PRESETS[base])
        if self.robots is not None:
            found.pop("density_of_robots", None)
        found |= {"engine": self.engine_name} | _different(self.engine, type(self.engine)())
        usual = SwarmConfig()
        for group, part in vars(self.config).items():
            found |= {f"{group}.{k}": value for k, value in _different(part, getattr(usual, group)).items()}
        known = {"seed": 0, "genome": "type1", "engine": "mujoco"}
        return {k: v for k, v in found.items() if v is not None and known.get(k) != v and k not in OF_MACHINE}


def _owner(scenario: Scenario, name: str) -> str | None:
    """Field of a scenario that has a setting: genome, strategy or task; None for its own."""
    if name in {f.name for f in fields(Scenario)}:
        return None
    rules = "genome" if scenario.strategy is None else "strategy"
    return next(owner for owner in (rules, "task", "engine") if name in _names(getattr(scenario, owner)))


def _names(given: Any) -> list[str]:
    return [f.name for f in fields(given) if f.init] if is_dataclass(given) else []


def _plain(given: Any) -> dict[str, Any]:
    """Fields of an own strategy or task that a command line can state."""
    kinds = (bool, int, float, str, Path)
    values = {name: getattr(given, name) for name in _names(given)}
    return {k: v for k, v in values.items() if isinstance(v, kinds)}


def _made(offer: Offer, name: str) -> Any:
    """A strategy or a task of a name, with the defaults of its fields.

    Raises:
        UserError: a field has none.
    """
    found = find(offer, name)
    if not isinstance(found, type):
        return found
    with user_code(found.__name__):
        return found()


def _different(given: Any, usual: Any) -> dict[str, Any]:
    return {name: getattr(given, name) for name in _names(given) if getattr(given, name) != getattr(usual, name)}


@cache
def _name(offer: Offer, cls: type) -> str:
    """How a command line names a class of strategies, tasks or engines."""
    if found := offered(offer, cls.__name__, {f.name for f in fields(cls)} if is_dataclass(cls) else set()):
        return found
    try:
        return f"{inspect.getsourcefile(cls)}:{cls.__name__}"
    except (TypeError, OSError):  # of a notebook
        return f"FILE.py:{cls.__name__}"


def command_line(command: str, values: Mapping[str, Any]) -> str:
    """Return a command with these settings as flags."""
    return shlex.join(["iswarm", command, *(word for name, value in values.items() for word in _flag(name, value))])


def _flag(name: str, value: Any) -> list[str]:
    group, dot, own = name.replace("_", "-").rpartition(".")
    if isinstance(value, bool):
        return [f"--{group}{dot}{'' if value else 'no-'}{own}"]
    if isinstance(value, tuple):
        inner = [part for one in value for part in (one if isinstance(one, tuple) else (one,))]
        return [f"--{group}{dot}{own}", *map(str, inner)]
    return [f"--{group}{dot}{own}", str(value)]


def toml(values: Mapping[str, Any]) -> str:
    """Return a file for --config with these settings."""
    return "".join(f"{name} = {_toml(value)}\n" for name, value in values.items())


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, int | float):
        return repr(value)
    return '"' + str(value).replace("\\", "\\\\").replace('"', '\\"') + '"'
