"""Strategies and tasks by name: a class in a file, or an entry point of an installed package."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from iswarm_mj.strategy.base import makes_strategies
from iswarm_mj.strategy.user_files import import_file
from iswarm_mj.utils.errors import ConfigError, UserError, closest, shown
from iswarm_mj.utils.files import check_file
from iswarm_mj.utils.user_code import user_code


class PluginKind(NamedTuple):
    """Kind of classes that users and packages add, such as strategies."""

    word: str
    """Noun in the singular, also the name of the flag."""
    plural: str
    """Noun in the plural, also the end of the name of the group of entry points."""
    method: str
    """Method that only classes of this kind have."""
    example: str
    """Example of the name of a class in a file."""
    base: str
    """Public name of the class that documents the methods."""

    @property
    def group(self) -> str:
        """Group of entry points: classes, or objects whose fields are the defaults."""
        return f"iswarm_mj.{self.plural}"

    @property
    def form(self) -> str:
        """Form of the name of a class in a file, with an example."""
        return f"FILE.py:CLASS, as {self.example}"


STRATEGIES = PluginKind(
    word="strategy",
    plural="strategies",
    method="act",
    example="walk.py:Walk",
    base="iswarm_mj.Strategy",
)
TASKS = PluginKind(
    word="task",
    plural="tasks",
    method="lay_out",
    example="gather.py:Gather",
    base="iswarm_mj.Task",
)


def find_strategy(name: str) -> Any:
    """Return a class of strategies, or an object whose fields are the defaults; see `find`."""
    return find(STRATEGIES, name)


def find_teams(words: Sequence[str]) -> dict[str, tuple[float | int, Any]]:
    """Return the teams that the flag --strategy names: share, and class or object, by their names.

    Teams are called by their strategies, with a number where several have the same.

    Args:
        words: names of strategies, each with the share or the number of its robots, as
            `walk.py:Walk=0.5`. A single strategy without a share makes no teams.

    Raises:
        UserError: a share is missing or no number, or there is no such strategy.
    """
    teams: dict[str, tuple[float | int, Any]] = {}
    for word in words:
        match = re.fullmatch(r"(.+)=(\d+|\d*\.\d+)", word)
        if match is None and len(words) == 1:
            return {}
        if match is None:
            form = "NAME=SHARE or NAME=ROBOTS for each of several strategies"
            raise ConfigError("strategy", word, f"{form}, as a.py:A=0.7 b.py:B=0.3")

        strategy_name, number = match.groups()
        share = int(number) if number.isdecimal() else float(number)
        class_name = strategy_name.rpartition(":")[2]
        team = re.sub(r"\W", "_", class_name)
        n_same = sum(name == team or name.removeprefix(team).isdecimal() for name in teams)
        if n_same:
            team = f"{team}{n_same + 1}"
        teams[team] = (share, find_strategy(strategy_name))
    return teams


def find(kind: PluginKind, name: str, shipped: Mapping[str, Any] | None = None) -> Any:
    """Return a class, or an object whose fields are the defaults.

    Args:
        kind: kind of the class.
        name: `FILE.py:CLASS`, or the name of an entry point.
        shipped: classes of this package, by name.

    Raises:
        UserError: there is no such file, class or name, or the file cannot be imported.
    """
    path, colon, class_name = name.rpartition(":")
    is_class = bool(colon) and not class_name.endswith(".py")  # else of a drive, as C:\walk.py
    if is_class:
        return _find_in_file(kind, Path(path), class_name)
    if name.endswith(".py") or "/" in name or os.sep in name:
        return _find_in_file(kind, Path(name), "")

    known: dict[str, Any] = {point.name: point for point in entry_points(group=kind.group)}
    known |= shipped or {}
    if name not in known:
        similar = closest(name, known)
        remedy = f"perhaps you meant {similar}" if similar else None
        listed = ", ".join(sorted(known)) or "none"
        raise ConfigError(kind.word, name, f"{kind.form}, or installed ({listed})", remedy)
    plugin = known[name]
    with user_code(f"{kind.word} {name}"):
        return plugin.load() if isinstance(plugin, EntryPoint) else plugin


def installed(kind: PluginKind) -> list[str]:
    """Return the names under which installed packages offer classes or objects."""
    return sorted({point.name for point in entry_points(group=kind.group)})


def offered(kind: PluginKind, class_name: str, field_names: set[str]) -> str | None:
    """Return the name of the entry point of a class with these fields.

    None if no installed package has such an entry point, or if there are several.
    """
    names = []
    for point in entry_points(group=kind.group):
        if point.value.rpartition(":")[2] == class_name:
            with user_code(f"{kind.word} {point.name}"):
                plugin = point.load()
            if is_dataclass(plugin) and {field.name for field in fields(plugin)} == field_names:
                names.append(point.name)
    return names[0] if len(names) == 1 else None


def naming(kind: PluginKind, class_name: str) -> str:
    """Return the flag that names a class which no package offers, or the strategies of teams."""
    if class_name == "Teams":
        return "--strategy NAME=SHARE NAME=SHARE"
    return f"--{kind.word} FILE.py:{shown(class_name)}"


def _no_class(kind: PluginKind, path: Path, class_name: str, module: ModuleType) -> UserError:
    """Return the error about a file without a class of this name, which lists the others."""
    classes = [
        value.__name__
        for value in vars(module).values()
        if getattr(value, "__module__", "") == module.__name__
        and isinstance(value, type)
        and hasattr(value, kind.method)
    ]
    fact = f"{path} has no {class_name}" if class_name else f"{kind.word} {path} names no class"
    if classes:
        choice = f"its {kind.plural} are {', '.join(classes)}; write {path}:{classes[0]}"
    else:
        choice = f"it has no class with a method {kind.method}; write {path}:CLASS"
    return UserError(f"{fact}; {choice}")


def _find_in_file(kind: PluginKind, path: Path, class_name: str) -> Any:
    """Return a class or an object of a file.

    Raises:
        UserError: the file cannot be imported, or has no class of this name.
    """
    module = _import_file(kind, path)
    plugin = getattr(module, class_name, None) if class_name else None
    if plugin is None:
        raise _no_class(kind, path, class_name, module)
    if not (isinstance(plugin, type) or is_dataclass(plugin) or makes_strategies(plugin)):
        fact = f"{path}:{class_name} is a {type(plugin).__name__}"
        raise UserError(f"{fact}; name a class, see {kind.base}")
    return plugin


def _import_file(kind: PluginKind, path: Path) -> ModuleType:
    """Execute a file, and return its module.

    Raises:
        UserError: the file does not exist, cannot be read or is not Python, or its code fails.
    """
    fault = "does not exist"
    module = None
    try:
        if path.is_file():
            check_file(path)
            fault = "is not Python"
            with user_code(f"{kind.word} file {path.name}"):
                module = import_file(path)
    except OSError as error:
        fault = f"cannot be read ({error.strerror or error})"
    if module is None:
        raise UserError(f"{kind.word} file {shown(path)} {fault}; give {kind.form}")
    return module
