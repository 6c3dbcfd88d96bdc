"""What determines a run on the page, and how a command line or a file states it."""

import inspect
import json
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from functools import cache, reduce
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.registry import ENGINES, OFFER, find_engine
from iswarm_mj.engines.robot_file import files_of
from iswarm_mj.engines.settings import OF_MACHINE, EngineSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import PRESETS, TYPE1, Genome
from iswarm_mj.strategy.library import STRATEGIES, TASKS, Offer, find, find_teams, offered
from iswarm_mj.strategy.teams import Team, Teams
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.errors import UserError, shown
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
            UserError: there is no such setting, or the value is out of range.
        """
        if name == "engine":
            return self if value == self.engine_name else replace(self, engine=find_engine(value).usual())
        if name == "strategy":
            return replace(self, strategy=_made(STRATEGIES, value), strategy_name=value)
        if name == "task":
            return replace(self, task=_made(TASKS, value), task_name=value)
        path = self.paths().get(name, (name,) if name in _OWN else ())
        if not path:
            strategy, task = type(self.strategy).__name__, type(self.task).__name__
            raise UserError(f"{strategy} and {task} have no setting {shown(name)}")
        before = replace(self, robots=None) if name == "density_of_robots" else self
        with user_code(type(self.at(path[:-1])).__name__):
            return _with(before, path, value)

    def with_part(self, name: str, other: "Scenario") -> "Scenario":
        """Return this scenario with the strategy, the task or the engine of another one."""
        found = {name: getattr(other, name)}
        if name != "engine":
            found[f"{name}_name"] = getattr(other, f"{name}_name")
        return replace(self, **found)

    def shares(self, name: str, other: "Scenario") -> bool:
        """Return whether a setting belongs to parts of the same class in two scenarios."""
        path, other_path = self.paths().get(name, ()), other.paths().get(name, ())
        return path == other_path and type(self.at(path[:-1])) is type(other.at(path[:-1]))

    def named(self, offer: Offer) -> str:
        """Return the name of its strategy or its task, as flags take it; of a genome, of the preset it was made of."""
        if offer is TASKS:
            return self.task_name or _name(TASKS, type(self.task))
        if self.genome is not None:
            equal = [name for name, preset in PRESETS.items() if preset == self.genome]
            chosen = [self.strategy_name] if self.strategy_name in PRESETS else []
            return [*equal, *chosen, "type1"][0]
        if isinstance(self.strategy, Teams) and not self.strategy_name:
            return shlex.join(f"{_name_of_team(team)}={team.share}" for team in self.strategy.teams)
        return self.strategy_name or _name(STRATEGIES, type(self.strategy))

    def values(self) -> dict[str, Any]:
        """Return the settings that differ from the defaults of `iswarm run`, by the names of its flags.

        Raises:
            UserError: no flag can state one of them.
        """
        strategy = self.named(STRATEGIES)
        task = self.named(TASKS)
        engine = self.engine_name
        for name in (strategy, task, engine):
            if name.startswith(_NO_FILE):
                cls = name.removeprefix(_NO_FILE)
                raise UserError(f"no command can name {cls}, which is in no file; {_REMEDY}")
        found: dict[str, Any] = {
            "seed": self.seed or None,
            "robots": self.robots,
            "robot": self.robot_file,
        }
        if not is_same(self.task, CLEANING):
            found["task"] = task
        if self.genome is None:
            teams = isinstance(self.strategy, Teams)
            found["strategy"] = tuple(shlex.split(strategy)) if teams else strategy
        elif strategy != "type1":
            found["genome"] = strategy
        if engine != Scenario().engine_name:
            found["engine"] = engine
        found |= self._changed()
        if isinstance(self.strategy, Teams):
            found |= _changed_in_teams(self.strategy, strategy)
        return {name: value for name, value in found.items() if value is not None}

    def _changed(self) -> dict[str, Any]:
        """Return the values of fields that the names of strategy, task and engine do not state.

        Raises:
            UserError: one of them is no number, word or path.
        """
        usual_genome = PRESETS.get(self.named(STRATEGIES), TYPE1)
        usual = Scenario(strategy=usual_genome, engine=type(self.engine).usual())
        left_out = OF_MACHINE | ({"density_of_robots"} if self.robots is not None else set())
        found = {}
        for name, path in self.paths().items():
            part, usual_part, value = self.at(path[:-1]), usual.at(path[:-1]), self.at(path)
            has_usual = type(part) is type(usual_part)
            is_usual = has_usual and is_same(value, usual.at(path))
            if name in left_out or is_usual or isinstance(part, Teams):
                continue
            if isinstance(value, _STATED):
                found[name] = value
            elif not is_same(value, _default_of(part, path[-1])):
                raise _unstated(name, value)
        return found


_OWN = ("seed", "robots")
"""Settings that are fields of a scenario, and of no part of it."""
_STATED = (bool, int, float, str, Path, tuple)
"""Values that a command line can state."""
_NO_FILE = "FILE.py:"
_REMEDY = "repeat this run in Python, with `iswarm_mj.play`"


def is_same(one: Any, other: Any) -> bool:
    """Return whether two values are equal; two objects that hold arrays never are."""
    if one is other:
        return True
    if hasattr(one, "shape") or hasattr(other, "shape"):
        return np.array_equal(one, other)
    try:
        return bool(one == other)
    except ValueError:  # of arrays within, each element of which is true or false
        return False


def _default_of(part: Any, name: str) -> Any:
    """Return the default of a field of a dataclass; a new object where there is none."""
    (own,) = (field for field in fields(part) if field.name == name)
    if own.default_factory is not MISSING:
        return own.default_factory()
    return object() if own.default is MISSING else own.default


def _unstated(name: str, value: Any) -> UserError:
    return UserError(f"no flag can state {name}, a {type(value).__name__}; {_REMEDY}")


def _name_of_team(team: Team) -> str:
    """Return the name of the strategy of a team, as --strategy takes it."""
    if not isinstance(team.strategy, Genome):
        return _name(STRATEGIES, type(team.strategy))
    if team.name in PRESETS:
        return team.name
    return next((name for name, preset in PRESETS.items() if preset == team.strategy), "type1")


@cache
def _teams_of(name: str) -> Any:
    """Return what --strategy makes of the name of teams; once, since it executes users' files."""
    return _made(STRATEGIES, name)


def _changed_in_teams(teams: Teams, name: str) -> dict[str, Any]:
    """Return the values of fields of the teams' strategies that their names do not state.

    Args:
        teams: of a scenario.
        name: of the teams, as --strategy takes it.

    Raises:
        UserError: no flag can state the name or the share of a team, or a field.
    """
    usual = _teams_of(name)
    shares = [(team.name, team.share) for team in teams.teams]
    if not isinstance(usual, Teams) or shares != [(team.name, team.share) for team in usual.teams]:
        listed = ", ".join(f"{team.name} ({team.share})" for team in teams.teams)
        raise UserError(f"no flag can state the names and shares of the teams {listed}; {_REMEDY}")
    found = {}
    for team, usual_team in zip(teams.teams, usual.teams, strict=True):
        for field_name in _names(team.strategy):
            value = getattr(team.strategy, field_name)
            if is_same(value, getattr(usual_team.strategy, field_name, None)):
                continue
            if not isinstance(value, _STATED):
                raise _unstated(f"{team.name}.{field_name}", value)
            found[f"{team.name}.{field_name}"] = value
    return found


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
        return f"{_NO_FILE}{cls.__name__}"


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
    """Return a file for --config with these settings.

    Raises:
        UserError: one is a text that no file in UTF-8 can hold.
    """
    return "".join(f"{_toml_key(name)} = {_toml(value)}\n" for name, value in values.items())


def _toml_key(name: str) -> str:
    """Return a key with dots between its parts, in quotes those of other letters than ASCII's."""
    parts = name.split(".")
    return ".".join(part if re.fullmatch(r"[A-Za-z0-9_-]+", part) else _toml(part) for part in parts)


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool | int | float):
        return json.dumps(value)
    text = str(value)
    if re.search("[\ud800-\udfff]", text):  # in names of files that are no UTF-8
        raise UserError(f"no TOML can hold {shown(ascii(text))}, which is not text in UTF-8; rename it")

    # Strings of JSON are strings of TOML but for the character DEL, and for surrogates.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
