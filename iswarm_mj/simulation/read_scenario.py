"""Fields of a scenario, read from a TOML file for --config or from the result.json of a run."""

import json
import shlex
from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, NoReturn, get_args, get_origin, get_type_hints

import numpy as np

from iswarm_mj.config.setting_names import (
    PartField,
    Parts,
    canonical_name,
    names_of,
    setting_names,
)
from iswarm_mj.config.swarm import INTERPRETATIONS, SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.engines.robot_file import as_robot_file
from iswarm_mj.engines.settings import OF_MACHINE
from iswarm_mj.gripper.tips.table import check_unchanged
from iswarm_mj.simulation.scenario_flags import default_of
from iswarm_mj.simulation.stacking import plain, to_json
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS, TYPE1, Genome, load_genome
from iswarm_mj.strategy.library import STRATEGIES, TASKS, PluginKind, find, find_teams, offered
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.constraints import check, validate
from iswarm_mj.utils.errors import UserError, shown
from iswarm_mj.utils.files import read_json, read_toml, restored
from iswarm_mj.utils.user_code import check_is_complete, user_code

_OF_RUN = {
    "robots": "robots",
    "seed": "seed",
    "worlds": "worlds",
    "steps": "steps",
    "stop_at": "goal",
    "failing": "failing",
}
"""Fields of a scenario by the keys of a file."""
_RESULT = "give the result.json of a run of a swarm"
_KEYS_OF_RESULT = {"config", "settings", "engine", "task"}
"""Keys that the result.json of a run of a swarm has, among others."""


def fields_of_toml(path: Path) -> dict[str, Any]:
    """Return the fields of a scenario by a file whose keys are flags of `iswarm run`.

    Raises:
        UserError: the file cannot be read, or has a key that is no part of a scenario.
    """
    # Functions take the keys that they read away from those that are left.
    values = read_toml(path, "name a TOML file, with lines as `steps = 300` or `[arena]`")
    left = {name: _as_tuple(value) for name, value in values.items()}
    scenario = {field: left.pop(key) for key, field in _OF_RUN.items() if key in left}
    scenario["config"] = _config(left)

    # The parts that have settings of their own, as classes or objects.
    strategy = _find_strategy(left)
    task_name = str(left.pop("task")) if "task" in left else None
    parts = {
        "strategy": strategy.plugin,
        "task": CLEANING if task_name is None else find(TASKS, task_name),
        "engine": find_engine(str(left.pop("engine", MujocoSettings.name))).usual(),
    }
    left = _by_canonical_names(left, parts, path)

    # The same parts with their settings.
    setting_of = setting_names(parts)
    scenario["strategy"] = _make_strategy(strategy, left, setting_of)
    scenario["strategy_name"] = strategy.name
    if task_name is not None:
        scenario["task"] = _object(parts["task"], left, _keys_of("task", setting_of))
        scenario["task_name"] = task_name
    scenario["engine"] = _object(parts["engine"], left, _keys_of("engine", setting_of))

    if "robot" in left:
        scenario["robot_file"] = _robot_file(left.pop("robot"))
    if "density" in left:
        scenario["robots"] = robots_for(scenario["config"].arena, left.pop("density"), "density")
    if left:
        raise UserError(
            f"{path} names {shown(next(iter(left)))}, which is no part of a scenario; leave it out"
        )
    return scenario


def _by_canonical_names(left: Mapping[str, Any], parts: Parts, path: Path) -> dict[str, Any]:
    """Return the values of a file by the names in `setting_names`.

    Raises:
        UserError: the file names a setting twice, or one that several parts have.
    """
    named: dict[str, Any] = {}
    for key, value in left.items():
        name = canonical_name(key, parts, source=f"{path}: ")
        if name in named:
            raise UserError(f"{path} names {name} twice, also as {key}; leave out one of them")
        named[name] = value
    return named


def _keys_of(part: str, setting_of: Mapping[str, PartField]) -> dict[str, str]:
    """Return the key in a file of each field of a part."""
    return {setting.field: key for key, setting in setting_of.items() if setting.part == part}


def _config(left: dict[str, Any]) -> SwarmConfig:
    """Return the configuration of a file."""
    reading = left.pop("reading", "paper")
    check("reading", reading, f"one of {', '.join(INTERPRETATIONS)}", reading in INTERPRETATIONS)
    defaults = INTERPRETATIONS[reading]
    groups = {}
    for group, default in vars(defaults).items():
        keys = {name: f"{group}.{name}" for name in names_of(default)}
        groups[group] = _object(default, left, keys)
    return replace(defaults, **groups)


class _Strategy(NamedTuple):
    """Strategy that a file names."""

    plugin: Any
    """Class or object; None for teams."""
    name: str | None
    """Name of the scenario's strategy, see `Scenario.strategy_name`."""
    teams: Mapping[str, tuple[float | int, Any]]
    """Share, and class or object, of each team; empty without teams."""


def _find_strategy(left: dict[str, Any]) -> _Strategy:
    """Return the strategy that a file names, or the genome of the paper's."""
    if "strategy" not in left:
        genome_name = str(left.pop("genome", "type1"))
        preset_name = genome_name if genome_name in PRESETS else None
        return _Strategy(load_genome(genome_name), preset_name, teams={})

    value = left.pop("strategy")
    words = [str(word) for word in value] if isinstance(value, tuple) else [str(value)]
    name = shlex.join(words) if len(words) > 1 else words[0]
    teams = find_teams(words)
    plugin = None if teams else find(STRATEGIES, words[0])
    return _Strategy(plugin, name, teams)


def _make_strategy(
    strategy: _Strategy, left: dict[str, Any], setting_of: Mapping[str, PartField]
) -> Any:
    """Return a strategy, or teams, with the values of their fields in a file."""
    if not strategy.teams:
        return _object(strategy.plugin, left, _keys_of("strategy", setting_of))
    teams = {}
    for team, (share, plugin) in strategy.teams.items():
        keys = {name: f"{team}.{name}" for name in names_of(_class_of(plugin))}
        teams[team] = (share, _object(plugin, left, keys))
    return Teams(teams)


def _robot_file(value: Any) -> Any:
    """Return the file of the robots, or those of their kinds, that a word or several name."""
    words = value if isinstance(value, tuple) else (value,)
    try:
        return as_robot_file(words)
    except UserError:  # a file without the number of its robots
        return as_robot_file(words[0] if len(words) == 1 else words)


def _class_of(plugin: Any) -> type:
    """Return a class, or the class of an object."""
    return plugin if isinstance(plugin, type) else type(plugin)


def _object(plugin: Any, left: dict[str, Any], keys: Mapping[str, str]) -> Any:
    """Return an object of a class, or one like an object, with values of a file.

    Args:
        plugin: the class, or the object.
        left: values by the keys of the file; those of the fields are taken away.
        keys: key in the file of each field.
    """
    cls = _class_of(plugin)
    values = {}
    for name, key in keys.items():
        if key in left:
            values[name] = _as_path(cls, name, left.pop(key))
    return _made(plugin, values)


def _made(plugin: Any, values: dict[str, Any]) -> Any:
    """Return an object of a class, or one like an object, with values that are checked."""
    check_is_complete(_class_of(plugin))
    with user_code(_class_of(plugin).__name__):
        made_object = plugin
        if isinstance(plugin, type):
            made_object = plugin(**values)
        elif values:
            made_object = replace(plugin, **values)
    if is_dataclass(made_object):
        validate(made_object)
    return made_object


def _types_of(cls: type, name: str) -> tuple[Any, ...]:
    """Return the types that a field of a dataclass may have."""
    hint = get_type_hints(cls)[name]
    origin = get_origin(hint)
    if origin is None:
        return (hint,)
    if origin in (tuple, Literal):
        return (origin,)
    return get_args(hint)  # of a union


def _as_path(cls: type, name: str, value: Any) -> Any:
    """Return a value of a field of a dataclass, a path where the field takes one and no text."""
    types = _types_of(cls, name)
    takes_path = Path in types and str not in types
    return Path(value) if takes_path and isinstance(value, str) else value


def fields_of_result(
    result: str | Path | Mapping[str, Any], strategy: Any, task: Any, engine: Any
) -> dict[str, Any]:
    """Return the fields of a scenario by the result.json of a run.

    Args:
        result: the file, or its content.
        strategy: class of the strategy, or the strategy; None for the class that a package offers.
        task: class of the task, or the task; None for the class that a package offers.
        engine: class of the engine's settings; None for the class that a package offers.

    Raises:
        UserError: it is no result of a run, or it does not state a part completely.
    """
    source = "the result"
    content = result
    if isinstance(result, str | Path):
        source = str(result)
        content = read_json(Path(result), _RESULT)
    if not isinstance(content, Mapping) or not content.keys() >= _KEYS_OF_RESULT:
        raise UserError(f"{source} is not of a run of a swarm; {_RESULT}")
    try:
        return _of_result(content, strategy, task, engine)
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise UserError(
            f"{source} has settings that this version does not know ({error}); {_RESULT}"
        ) from None


def _of_result(content: Mapping[str, Any], strategy: Any, task: Any, engine: Any) -> dict[str, Any]:
    """Return the fields of a scenario by the content of a result.json.

    Args: as for `fields_of_result`.
    """
    engine = find_engine(content["engine"]) if engine is None else engine
    engine_names = set(names_of(engine)) - OF_MACHINE
    engine_values = {name: content[name] for name in engine_names if name in content}
    if "genome" in content:
        strategy = restored(Genome, content["genome"])
    else:
        strategy = _stated(STRATEGIES, content["strategy"], strategy)
    settings = content["settings"]
    config = restored(SwarmConfig, content["config"])
    if "gripper_tip" in content:
        check_unchanged(config.gripper.tip, content["gripper_tip"]["sha256"])
    return {
        "config": config,
        "strategy": strategy,
        "task": _stated(TASKS, content["task"], task),
        "robots": settings["n_robots"],
        "robot_file": content["robot"]["file"],
        "engine": engine(**engine_values),
        "seed": settings["seed"],
        "worlds": _worlds_of(settings, strategy),
        "steps": settings["steps"],
        "goal": settings["stop_at"],
        "failing": settings.get("failing"),  # which results of earlier versions lack
    }


def _worlds_of(settings: Mapping[str, Any], strategy: Any) -> int | list[World]:
    """Return the worlds of a run: their number, or each with its share of dead robots."""
    n_worlds = settings["n_worlds"]
    failed_fraction = settings["failed_fraction"]
    if not failed_fraction:
        return n_worlds
    genome = strategy if isinstance(strategy, Genome) else TYPE1
    return [
        World(
            genome,
            n_robots=settings["n_robots"],
            seed=settings["seed"],
            index=index,
            failed_fraction=failed_fraction,
        )
        for index in range(n_worlds)
    ]


def _stated(kind: PluginKind, stated: Mapping[str, Any], plugin: Any) -> Any:
    """Return a strategy or a task as a result states it, see `to_json`.

    Args:
        kind: strategies or tasks.
        stated: name of the class, and the values of its fields.
        plugin: the user's class, or the strategy or task itself; None for the class that a package
            offers.
    """
    if plugin is not None and not isinstance(plugin, type):
        return plugin
    values = dict(stated)
    class_name = values.pop("class")
    if plugin is None and class_name == "Teams":
        return Teams({team: (part["share"], _of_team(part)) for team, part in values.items()})
    if plugin is None and class_name == type(CLEANING).__name__ and not values:
        return CLEANING

    cls = _offered_class(kind, class_name, set(values)) if plugin is None else plugin
    fields = {name: _value(kind, cls, name, value) for name, value in values.items()}
    restored_plugin = _made(cls, fields)
    if json.loads(json.dumps(to_json(restored_plugin), default=str)) != stated:
        _refuse(kind, class_name, "the values")
    return restored_plugin


def _offered_class(kind: PluginKind, class_name: str, field_names: set[str]) -> Any:
    """Return the class with these fields that an installed package offers.

    Raises:
        UserError: no package does.
    """
    installed_name = offered(kind, class_name, field_names)
    if installed_name is None:
        fact = f"the result is of the {kind.word} {shown(class_name)}, which no package offers"
        remedy = f"give its class, as from_result(..., {kind.word}={class_name})"
        raise UserError(f"{fact}; {remedy}")
    return find(kind, installed_name)


def _of_team(stated: Mapping[str, Any]) -> Any:
    """Return the strategy of a team as a result states it."""
    strategy = {name: value for name, value in stated.items() if name != "share"}
    if strategy["class"] == Genome.__name__:
        values = {name: value for name, value in strategy.items() if name != "class"}
        return restored(Genome, values)
    return _stated(STRATEGIES, strategy, None)


def _value(kind: PluginKind, cls: Any, name: str, value: Any) -> Any:
    """Return the value of a field of which a result states a number, a text or a list."""
    types = _types_of(cls, name)
    default = default_of(cls, name)
    if plain(default) == value:
        return default
    if isinstance(value, list):
        if hasattr(default, "dtype"):
            return np.asarray(value, default.dtype)
        if tuple in types:
            return _as_tuple(value)
        _refuse(kind, cls.__name__, name)
    takes_text = str in types or Literal in types
    if isinstance(value, str) and not takes_text:
        if Path not in types:
            _refuse(kind, cls.__name__, name)
        return Path(value)
    return value


def _as_tuple(value: Any) -> Any:
    """Return a list, and the lists in it, as tuples; other values as they are."""
    return tuple(map(_as_tuple, value)) if isinstance(value, list) else value


def _refuse(kind: PluginKind, class_name: str, name: str) -> NoReturn:
    """Refuse a result that states a value only in part, such as a large array.

    Raises:
        UserError: always.
    """
    remedy = f"give the {kind.word} itself, as from_result(..., {kind.word}={class_name}(...))"
    raise UserError(f"the result does not state {name} of {class_name} completely; {remedy}")
