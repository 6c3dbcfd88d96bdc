"""How flags of a command, or the keys of a file for --config, state a scenario."""

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
from iswarm_mj.engines.registry import ENGINES, OFFER
from iswarm_mj.engines.settings import OF_MACHINE, EngineSettings
from iswarm_mj.strategy.genome import PRESETS, TYPE1, Genome
from iswarm_mj.strategy.library import STRATEGIES, TASKS, PluginKind, find, find_teams, offered
from iswarm_mj.strategy.teams import Team, Teams
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.errors import UserError, shown
from iswarm_mj.utils.user_code import user_code

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
    """Return where settings are that are fields of a scenario's parts, as attributes of
    attributes.

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
    """Return what is at a path; None where there is nothing."""
    return reduce(lambda part, name: getattr(part, name, None), path, scenario)


def engine_name(engine: EngineSettings) -> str:
    """Return the name of an engine, as --engine takes it."""
    return engine.name if engine.name in ENGINES else _name(OFFER, type(engine))


def task_name(scenario: "Scenario") -> str:
    """Return the name of a scenario's task, as --task takes it."""
    return scenario.task_name or _name(TASKS, type(scenario.task))


def strategy_name(scenario: "Scenario") -> str:
    """Return the name of its strategy, as --strategy takes it; of a genome, of the preset it was
    made of."""
    strategy, given = scenario.strategy, scenario.strategy_name
    if isinstance(strategy, Genome):
        equal = [name for name, preset in PRESETS.items() if preset == strategy]
        chosen = [given] if given in PRESETS else []
        return [*equal, *chosen, "type1"][0]
    if isinstance(strategy, Teams) and not given:
        return shlex.join(f"{_name_of_team(team)}={team.share}" for team in strategy.teams)
    return given or _name(STRATEGIES, type(strategy))


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

    found: dict[str, Any] = {
        "seed": scenario.seed or None,
        "robots": scenario.robots,
        "robot": scenario.robot_file,
        "worlds": scenario.worlds if scenario.worlds > 1 else None,
        "steps": scenario.steps if scenario.steps != STEPS else None,
        "stop_at": scenario.goal,
    }
    if not is_same(scenario.task, CLEANING):
        found["task"] = task
    if scenario.genome is None:
        teams = isinstance(scenario.strategy, Teams)
        found["strategy"] = tuple(shlex.split(strategy)) if teams else strategy
    elif strategy != "type1":
        found["genome"] = strategy
    if engine != MujocoSettings.name:
        found["engine"] = engine
    found |= _changed(scenario)
    if isinstance(scenario.strategy, Teams):
        found |= _changed_in_teams(scenario.strategy, strategy)
    return {name: value for name, value in found.items() if value is not None}


def _changed(scenario: "Scenario") -> dict[str, Any]:
    """Return the values of fields that the names of strategy, task and engine do not state.

    Raises:
        UserError: one of them is no number, word or path.
    """
    usual = replace(
        scenario,
        config=SwarmConfig(),
        strategy=PRESETS.get(strategy_name(scenario), TYPE1),
        task=CLEANING,
        engine=type(scenario.engine).usual(),
    )
    left_out: set[tuple[str, ...]] = {("engine", name) for name in OF_MACHINE}
    if scenario.genome is not None and scenario.robots is not None:
        left_out.add(("strategy", "density_of_robots"))

    found = {}
    for name, path in paths_of(scenario).items():
        part, usual_part = value_at(scenario, path[:-1]), value_at(usual, path[:-1])
        value = value_at(scenario, path)
        has_usual = type(part) is type(usual_part)
        is_usual = has_usual and is_same(value, value_at(usual, path))
        if path in left_out or is_usual:
            continue
        is_default = is_same(value, default_of(part, path[-1]))
        if not is_default:
            _refuse_flag_of_run(part, path)
        if isinstance(value, STATED):
            found[name] = value
        elif not is_default:
            raise _unstated(name, value)
    return found


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


def default_of(part: Any, name: str) -> Any:
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
    return made_of(STRATEGIES, name)


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
        for field_name in names_of(team.strategy):
            value = getattr(team.strategy, field_name)
            if is_same(value, getattr(usual_team.strategy, field_name, None)):
                continue
            if not isinstance(value, STATED):
                raise _unstated(f"{team.name}.{field_name}", value)
            found[f"{team.name}.{field_name}"] = value
    return found


def made_of(offer: PluginKind, name: str) -> Any:
    """Return the strategy or the task of a name, with the defaults of its fields.

    Raises:
        UserError: a field has none.
    """
    if (
        offer is STRATEGIES
        and re.search(r"=[\d.]+$", name)
        and (teams := find_teams(shlex.split(name)))
    ):
        return Teams({team: (share, _object(found)) for team, (share, found) in teams.items()})
    return _object(find(offer, name))


def _object(found: Any) -> Any:
    """A strategy or a task of a class, with the defaults of its fields."""
    if not isinstance(found, type):
        return found
    with user_code(found.__name__):
        return found()


@cache
def _name(offer: PluginKind, cls: type) -> str:
    """How a command line names a class of strategies, tasks or engines."""
    if found := offered(offer, cls.__name__, set(names_of(cls))):
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
    lines = []
    for name, value in values.items():
        # In `task = "a.py:A"` the task is a word, and then `task.range` no key of a table.
        is_whole = name.partition(".")[0] in values
        key = _toml(name) if is_whole and "." in name else _toml_key(name)
        lines.append(f"{key} = {_toml(value)}\n")
    return "".join(lines)


def _toml_key(name: str) -> str:
    """Return a key with dots between its parts, in quotes those of other letters than ASCII's."""
    parts = name.split(".")
    return ".".join(
        part if re.fullmatch(r"[A-Za-z0-9_-]+", part) else _toml(part) for part in parts
    )


def _toml(value: Any) -> str:
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
