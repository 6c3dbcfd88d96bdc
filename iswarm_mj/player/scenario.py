"""What determines a run on the page, and how a command line or a file states it."""

import inspect
import json
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache, reduce
from pathlib import Path
from typing import Any

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.registry import ENGINES, OFFER, find_engine
from iswarm_mj.engines.robot_file import files_of
from iswarm_mj.engines.settings import OF_MACHINE, EngineSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import PRESETS, TYPE1, Genome
from iswarm_mj.strategy.library import STRATEGIES, TASKS, Offer, find, find_teams, offered
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.robot import RobotFile

STEPS = 1_000_000
"""Control steps of a run at most."""


@dataclass(frozen=True)
class Scenario:
    """A run of one world from its start. Settings are called as flags of `iswarm run`, with dots within groups."""

    config: SwarmConfig = field(default_factory=SwarmConfig)
    strategy: Any = TYPE1
    """A genome of the paper's, or another one."""
    task: Any = CLEANING
    robots: int | None = None
    """Their number; None: it follows from the density of the genome, or of type 1."""
    seed: int = 0
    engine: EngineSettings = field(default_factory=MujocoSettings)
    robot_file: RobotFile = None
    strategy_name: str | None = None
    """As --strategy takes it, of teams with blanks between; by default the name under which a package offers its class,
    or its file."""
    task_name: str | None = None
    """As --task takes it, likewise."""

    @property
    def n_robots(self) -> int:
        """Number of robots."""
        arena, density = self.config.arena, (self.genome or TYPE1).density_of_robots
        total = sum(n for _, n in files_of(self.robot_file))
        return self.robots or total or robots_for(arena, density, "density_of_robots")

    @property
    def engine_name(self) -> str:
        """As --engine takes it."""
        return self.engine.name if self.engine.name in ENGINES else _name(OFFER, type(self.engine))

    @property
    def genome(self) -> Genome | None:
        """The genome, if they follow the paper's strategy."""
        return self.strategy if isinstance(self.strategy, Genome) else None

    def run(self) -> Run:
        """Return the run at its start.

        Raises:
            UserError: settings that do not fit each other.
        """
        settings, engine = RunSettings(self.n_robots, STEPS, self.seed), self.engine.in_chunks(1)
        return Run(self.config, self.strategy, settings, engine, task=self.task, robot_file=self.robot_file)

    def paths(self) -> dict[str, tuple[str, ...]]:
        """Return where settings are that are fields of its parts, as attributes of attributes."""
        own = {name: (part, name) for part in ("strategy", "task", "engine") for name in _names(getattr(self, part))}
        groups = vars(self.config).items()
        return own | {f"{group}.{name}": ("config", group, name) for group, part in groups for name in _names(part)}

    def at(self, path: Iterable[str]) -> Any:
        """Return what is at a path; None where there is nothing."""
        return reduce(lambda part, name: getattr(part, name, None), path, self)

    def get(self, name: str) -> Any:
        """Return the value of a setting."""
        if name in ("strategy", "task"):
            return self.named(STRATEGIES if name == "strategy" else TASKS)
        return self.engine_name if name == "engine" else self.at(self.paths().get(name, (name,)))

    def set(self, name: str, value: Any) -> "Scenario":
        """Return this scenario with another value of a setting.

        Raises:
            UserError: it is out of range.
        """
        if name == "engine":
            return self if value == self.engine_name else replace(self, engine=find_engine(value).usual())
        if name == "strategy":
            return replace(self, strategy=_made(STRATEGIES, value), strategy_name=value)
        if name == "task":
            return replace(self, task=_made(TASKS, value), task_name=value)
        before = replace(self, robots=None) if name == "density_of_robots" else self
        return _with(before, self.paths().get(name, (name,)), value)

    def named(self, offer: Offer) -> str:
        """Return the name of its strategy or its task, as flags take it; of a genome, of the preset it was made of."""
        if offer is TASKS:
            return self.task_name or _name(TASKS, type(self.task))
        if self.genome is None:
            return self.strategy_name or _name(STRATEGIES, type(self.strategy))
        return next((name for name, preset in PRESETS.items() if preset == self.genome), "type1")

    def values(self) -> dict[str, Any]:
        """Return the settings that differ from the defaults of `iswarm run`, by the names of its flags."""
        base, engine = self.named(STRATEGIES), self.engine_name
        usual = Scenario(strategy=PRESETS.get(base, TYPE1), engine=type(self.engine).usual())
        found = {"seed": self.seed or None, "robots": self.robots, "robot": self.robot_file}
        found["task"] = self.named(TASKS) if self.task != CLEANING else None
        words = tuple(shlex.split(base)) if isinstance(self.strategy, Teams) else base
        found["genome" if self.genome else "strategy"] = words if base != "type1" else None
        found["engine"] = engine if engine != Scenario().engine_name else None
        differ = {name: self.at(path) for name, path in self.paths().items() if self.at(path) != usual.at(path)}
        left_out = OF_MACHINE | ({"density_of_robots"} if self.robots is not None else set())
        found |= {k: v for k, v in differ.items() if isinstance(v, _STATED) and k not in left_out}
        return {k: v for k, v in found.items() if v is not None}


_STATED = (bool, int, float, str, Path, tuple)
"""Values that a command line can state."""


def _names(given: Any) -> list[str]:
    return [f.name for f in fields(given) if f.init] if is_dataclass(given) else []


def _with(given: Any, path: tuple[str, ...], value: Any) -> Any:
    """A dataclass in which something else is at a path."""
    name, *rest = path
    return replace(given, **{name: _with(getattr(given, name), tuple(rest), value) if rest else value})


def _made(offer: Offer, name: str) -> Any:
    """A strategy or a task of a name, with the defaults of its fields.

    Raises:
        UserError: a field has none.
    """
    if offer is STRATEGIES and re.search(r"=[\d.]+$", name) and (teams := find_teams(shlex.split(name))):
        return Teams({team: (share, _object(found)) for team, (share, found) in teams.items()})
    return _object(find(offer, name))


def _object(found: Any) -> Any:
    """A strategy or a task of a class, with the defaults of its fields."""
    if not isinstance(found, type):
        return found
    with user_code(found.__name__):
        return found()


@cache
def _name(offer: Offer, cls: type) -> str:
    """How a command line names a class of strategies, tasks or engines."""
    if found := offered(offer, cls.__name__, set(_names(cls))):
        return found
    try:
        return f"{inspect.getsourcefile(cls)}:{cls.__name__}"
    except (TypeError, OSError):  # of a notebook
        return f"FILE.py:{cls.__name__}"


def command_line(command: str, values: Mapping[str, Any]) -> str:
    """Return a command with these settings as flags."""
    words = [word for name, value in values.items() for word in _flag(name, value)]
    return shlex.join(["iswarm", command, *words])


def _flag(name: str, value: Any) -> list[str]:
    """The words that give a flag a value."""
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
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value if isinstance(value, bool | int | float) else str(value))
