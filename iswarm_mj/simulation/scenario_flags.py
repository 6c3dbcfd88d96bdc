"""Scenarios as the flags of a command, or as a file for --config."""

import inspect
import json
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields, replace
from functools import cache, reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from iswarm_mj.config.setting_names import PARTS, SCENARIO_KEYS, names_of, setting_names
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.registry import ENGINE_PLUGINS, ENGINES
from iswarm_mj.engines.settings import OF_MACHINE, EngineSettings
from iswarm_mj.strategy.genome import PRESETS, TYPE1, Genome
from iswarm_mj.strategy.library import STRATEGIES, TASKS, PluginKind, find, find_teams, offered
from iswarm_mj.strategy.teams import Team, Teams
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.errors import UserError, shown
from iswarm_mj.utils.operating_system import shell_line, split_words
from iswarm_mj.utils.user_code import check_is_complete, user_code

if TYPE_CHECKING:
    from iswarm_mj.simulation.scenario import Scenario

STEPS = 800
"""Control steps of a run at most, unless its settings say otherwise."""
STATED = (bool, int, float, str, Path, tuple)
"""Values that a command line can state."""
_NO_FILE = "FILE.py:"
_REMEDY = "repeat this run in Python"


def parts_of(scenario: "Scenario") -> dict[str, Any]:
    """Return the strategy, the task and the engine of a scenario by these words."""
    return {part: getattr(scenario, part) for part in PARTS}


def paths_of(scenario: "Scenario") -> dict[str, tuple[str, ...]]:
    """Return the path of attributes from a scenario to each setting of its parts.

    Raises:
        UserError: a field has the name of another setting, see `setting_names`.
    """
    paths: dict[str, tuple[str, ...]] = {}
    for name, setting in setting_names(parts_of(scenario)).items():
        paths[name] = tuple(setting)
    for group, part in vars(scenario.config).items():
        for name in names_of(part):
            paths[f"{group}.{name}"] = ("config", group, name)
    return paths


def value_at(scenario: "Scenario", path: Iterable[str]) -> Any:
    """Return the value at a path of attributes; None where there is nothing."""
    return reduce(lambda part, name: getattr(part, name, None), path, scenario)


def engine_name(engine: EngineSettings) -> str:
    """Return the name of an engine, as --engine takes it."""
    return engine.name if engine.name in ENGINES else _name(ENGINE_PLUGINS, type(engine))


def task_name(scenario: "Scenario") -> str:
    """Return the name of a scenario's task, as --task takes it."""
    return scenario.task_name or _name(TASKS, type(scenario.task))


def strategy_name(scenario: "Scenario") -> str:
    """Return the name of a scenario's strategy, as --strategy takes it.

    For a genome it is that of an equal preset, or else of the preset from which it was made.
    """
    strategy = scenario.strategy
    user_name = scenario.strategy_name
    if isinstance(strategy, Genome):
        made_from = user_name if user_name in PRESETS else "type1"
        return _preset_of(strategy, default=made_from)
    if user_name:
        return user_name
    if isinstance(strategy, Teams):
        return shlex.join(f"{_name_of_team(team)}={team.share}" for team in strategy.teams)
    return _name(STRATEGIES, type(strategy))


def _preset_of(genome: Genome, default: str) -> str:
    """Return the name of the preset that equals a genome, or a default."""
    for name, preset in PRESETS.items():
        if preset == genome:
            return name
    return default


def values_of(scenario: "Scenario") -> dict[str, Any]:
    """Return the settings that differ from the defaults of `iswarm run`, by the names of its flags.

    Raises:
        UserError: no flag can state one of them.
    """
    strategy = strategy_name(scenario)
    task = task_name(scenario)
    engine = engine_name(scenario.engine)
    for name in (strategy, task, engine):
        if name.startswith(_NO_FILE):
            cls = name.removeprefix(_NO_FILE)
            raise UserError(f"no command can name {cls}, which is in no file; {_REMEDY}")
    if not isinstance(scenario.worlds, int):
        raise UserError(f"no flag can state worlds that differ, each a World; {_REMEDY}")

    # Settings of the run; None where a flag is not needed.
    values: dict[str, Any] = {
        "seed": scenario.seed or None,
        "robots": scenario.robots,
        "robot": scenario.robot_file,
        "worlds": scenario.worlds if scenario.worlds > 1 else None,
        "steps": scenario.steps if scenario.steps != STEPS else None,
        "stop_at": scenario.goal,
        "failing": None if scenario.failing is None else str(scenario.failing),
    }

    # Names of task, strategy and engine.
    has_teams = isinstance(scenario.strategy, Teams)
    if not is_same(scenario.task, CLEANING):
        values["task"] = task
    if scenario.genome is None:
        values["strategy"] = tuple(split_words(strategy)) if has_teams else strategy
    elif strategy != "type1":
        values["genome"] = strategy
    if engine != MujocoSettings.name:
        values["engine"] = engine

    # Fields of these and of the configuration.
    values |= _changed(scenario)
    if has_teams:
        values |= _changed_in_teams(scenario.strategy, strategy)
    return {name: value for name, value in values.items() if value is not None}


def _changed(scenario: "Scenario") -> dict[str, Any]:
    """Return the values of fields that the names of strategy, task and engine do not state.

    Raises:
        UserError: one of them is no number, word or path.
    """
    defaults = replace(
        scenario,
        config=SwarmConfig(),
        strategy=PRESETS.get(strategy_name(scenario), TYPE1),
        task=CLEANING,
        engine=type(scenario.engine).usual(),
    )
    left_out: set[tuple[str, ...]] = {("engine", name) for name in OF_MACHINE}
    if scenario.genome is not None and scenario.robots is not None:
        left_out.add(("strategy", "density_of_robots"))

    values = {}
    for name, path in paths_of(scenario).items():
        part = value_at(scenario, path[:-1])
        value = value_at(scenario, path)

        # Values that the flags have anyway need not be stated.
        is_of_default_part = type(part) is type(value_at(defaults, path[:-1]))
        is_implied = is_of_default_part and is_same(value, value_at(defaults, path))
        if path in left_out or is_implied:
            continue

        # Others must be stated if they are not those of the part that its name gives.
        is_default = is_same(value, _default_by_name(scenario, path))
        if not is_default:
            _refuse_flag_of_run(part, path)
        if isinstance(value, STATED) and not is_default:
            values[name] = value
        elif not is_default:
            raise _unstated(name, value)
    return values


def _default_by_name(scenario: "Scenario", path: tuple[str, ...]) -> Any:
    """Return the value of a field where nothing but the name of its part is stated.

    Args:
        scenario: scenario with the part.
        path: path of attributes to the field.
    """
    part = value_at(scenario, path[:-1])
    by_name = None
    if path[0] == "strategy":
        by_name = _made_by_name(STRATEGIES, strategy_name(scenario))
    elif path[0] == "task":
        by_name = _made_by_name(TASKS, task_name(scenario))
    if type(by_name) is type(part):
        return getattr(by_name, path[-1])
    return default_of(part, path[-1])


def _refuse_flag_of_run(part: Any, path: tuple[str, ...]) -> None:
    """Refuse to state a field of a part that has the name of a flag of `iswarm run`.

    Raises:
        UserError: it has.
    """
    field_name = path[-1]
    if path[0] in PARTS and field_name in SCENARIO_KEYS:
        raise UserError(
            f"no flag can state {field_name} of {type(part).__name__}, "
            f"as `{field_name}` is a flag of iswarm run; rename the field, or {_REMEDY}"
        )


def is_same(first: Any, second: Any) -> bool:
    """Return whether two values are equal; two objects that hold arrays never are."""
    if first is second:
        return True
    if hasattr(first, "shape") or hasattr(second, "shape"):
        return np.array_equal(first, second)
    try:
        return bool(first == second)
    except ValueError:  # arrays within are compared element by element, which has no truth value
        return False


def default_of(part: Any, name: str) -> Any:
    """Return the default of a field of a dataclass; a new object where there is none."""
    (field,) = (field for field in fields(part) if field.name == name)
    if field.default_factory is not MISSING:
        return field.default_factory()
    return object() if field.default is MISSING else field.default


def _unstated(name: str, value: Any) -> UserError:
    """Return the error about a setting that no flag can state."""
    return UserError(f"no flag can state {name}, a {type(value).__name__}; {_REMEDY}")


def _name_of_team(team: Team) -> str:
    """Return the name of the strategy of a team, as --strategy takes it."""
    if not isinstance(team.strategy, Genome):
        return _name(STRATEGIES, type(team.strategy))
    if team.name in PRESETS:
        return team.name
    return _preset_of(team.strategy, default="type1")


@cache
def _made_by_name(kind: PluginKind, name: str) -> Any:
    """Return the strategy or the task that a name gives; once, since it executes users' files.

    None where the name alone gives none, as a field has no default.
    """
    try:
        return made_of(kind, name)
    except UserError:
        return None


def forget_made() -> None:
    """Make strategies and tasks of names again when they are needed, as files have changed."""
    _made_by_name.cache_clear()


def _changed_in_teams(teams: Teams, name: str) -> dict[str, Any]:
    """Return the values of fields of the teams' strategies that their names do not state.

    Args:
        teams: teams of a scenario.
        name: name of the teams, as --strategy takes it.

    Raises:
        UserError: no flag can state the name or the share of a team, or a field.
    """
    default_teams = _made_by_name(STRATEGIES, name)
    if not isinstance(default_teams, Teams) or _shares(default_teams) != _shares(teams):
        listed = ", ".join(f"{name} ({share})" for name, share in _shares(teams))
        raise UserError(f"no flag can state the names and shares of the teams {listed}; {_REMEDY}")

    values = {}
    for team, default_team in zip(teams.teams, default_teams.teams, strict=True):
        for field_name in names_of(team.strategy):
            value = getattr(team.strategy, field_name)
            if is_same(value, getattr(default_team.strategy, field_name, None)):
                continue
            setting = f"{team.name}.{field_name}"
            if not isinstance(value, STATED):
                raise _unstated(setting, value)
            values[setting] = value
    return values


def _shares(teams: Teams) -> list[tuple[str, float | int]]:
    """Return name and share of each team."""
    return [(team.name, team.share) for team in teams.teams]


def made_of(kind: PluginKind, name: str) -> Any:
    """Return the strategy or the task of a name, with the defaults of its fields.

    Raises:
        UserError: there is no such strategy or task, or a field has no default.
    """
    if kind is STRATEGIES and re.search(r"=[\d.]+$", name):
        teams = find_teams(split_words(name))
        if teams:
            return Teams(
                {team: (share, _object(plugin)) for team, (share, plugin) in teams.items()}
            )
    return _object(find(kind, name))


def _object(plugin: Any) -> Any:
    """Return an object of a class, with the defaults of its fields; an object as it is."""
    if not isinstance(plugin, type):
        return plugin
    check_is_complete(plugin)
    with user_code(plugin.__name__):
        return plugin()


@cache
def _name(kind: PluginKind, cls: type) -> str:
    """Return the name of a class of strategies, tasks or engines on a command line."""
    installed_name = offered(kind, cls.__name__, set(names_of(cls)))
    if installed_name:
        return installed_name
    try:
        return f"{inspect.getsourcefile(cls)}:{cls.__name__}"
    except (TypeError, OSError):  # of a notebook
        return f"{_NO_FILE}{cls.__name__}"


def command_line(command: str, values: Mapping[str, Any]) -> str:
    """Return a command with these settings as flags."""
    return shell_line(["iswarm", command, *flag_words(values)])


def flag_words(values: Mapping[str, Any]) -> list[str]:
    """Return the words of a command line that give settings as flags."""
    return [word for name, value in values.items() for word in _flag(name, value)]


def _flag(name: str, value: Any) -> list[str]:
    """Return the words of a command line that give a flag a value."""
    group, dot, flag = name.replace("_", "-").rpartition(".")
    if isinstance(value, bool):
        return [f"--{group}{dot}{'' if value else 'no-'}{flag}"]
    words = [str(value)]
    if isinstance(value, tuple):
        words = []
        for entry in value:
            parts = entry if isinstance(entry, tuple) else (entry,)
            words += [str(part) for part in parts]
    return [f"--{group}{dot}{flag}", *words]


def toml(values: Mapping[str, Any]) -> str:
    """Return a file for --config with these settings.

    Raises:
        UserError: one is a text that no file in UTF-8 can hold.
    """
    lines = []
    for name, value in values.items():
        # In `task = "a.py:A"` the task is a word, and then `task.range` no key of a table.
        is_whole = name.partition(".")[0] in values
        key = _toml(name) if is_whole and "." in name else _toml_key(name)
        lines.append(f"{key} = {_toml(value)}\n")
    return "".join(lines)


def _toml_key(name: str) -> str:
    """Return a key with dots between its parts; parts of other letters than ASCII's are quoted."""
    keys = []
    for part in name.split("."):
        is_bare = re.fullmatch(r"[A-Za-z0-9_-]+", part)
        keys.append(part if is_bare else _toml(part))
    return ".".join(keys)


def _toml(value: Any) -> str:
    """Return a value in TOML."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, bool | int | float):
        return json.dumps(value)
    text = str(value)
    if re.search("[\ud800-\udfff]", text):  # in names of files that are no UTF-8
        raise UserError(
            f"no TOML can hold {shown(ascii(text))}, which is not text in UTF-8; rename it"
        )

    # Strings of JSON are strings of TOML but for the character DEL, and for surrogates.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
