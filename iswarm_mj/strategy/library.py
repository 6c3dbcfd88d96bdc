"""Strategies and tasks by name: a class in a file, or an entry point of an installed package."""

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
    """What users and packages offer."""

    word: str
    plural: str
    """Under `iswarm_mj.` also the group of entry points: classes, or objects whose fields are the
    defaults."""
    method: str
    """That only such classes have."""
    example: str
    """How a class in a file is named."""
    base: str
    """Public name of the class that documents its methods."""

    @property
    def group(self) -> str:
        """Of entry points."""
        return f"iswarm_mj.{self.plural}"

    @property
    def form(self) -> str:
        """In which a class in a file is named, with an example."""
        return f"FILE.py:CLASS, as {self.example}"


STRATEGIES = PluginKind("strategy", "strategies", "act", "walk.py:Walk", "iswarm_mj.Strategy")
TASKS = PluginKind("task", "tasks", "lay_out", "gather.py:Gather", "iswarm_mj.Task")


def find_strategy(name: str) -> Any:
    """Return a class of strategies, or an object whose values are defaults, see `find`."""
    return find(STRATEGIES, name)


def find_teams(words: Sequence[str]) -> dict[str, tuple[float | int, Any]]:
    """Return share, and class or object, of teams by their names, those of the strategies.

    Args:
        words: names of strategies with the share of the robots or their number, as
            `walk.py:Walk=0.5`; of one strategy without a share there are no teams.

    Raises:
        UserError: a share is missing or no number, or there is no such strategy.
    """
    found: dict[str, tuple[float | int, Any]] = {}
    for word in words:
        match = re.fullmatch(r"(.+)=(\d+|\d*\.\d+)", word)
        if match is None and len(words) == 1:
            return {}
        if match is None:
            form = (
                "NAME=SHARE or NAME=ROBOTS for each of several strategies, as a.py:A=0.7 b.py:B=0.3"
            )
            raise ConfigError("strategy", word, form)
        name, size = match[1], int(match[2]) if match[2].isdecimal() else float(match[2])
        team = re.sub(r"\W", "_", name.rpartition(":")[2])
        n_same = sum(one == team or one.removeprefix(team).isdecimal() for one in found)
        found[f"{team}{n_same + 1}" if n_same else team] = size, find_strategy(name)
    return found


def find(offer: PluginKind, name: str, shipped: Mapping[str, Any] | None = None) -> Any:
    """Return a class, or an object whose values are defaults.

    Args:
        offer: what is looked for.
        name: `FILE.py:CLASS`, or the name of an entry point.
        shipped: what else can be named.

    Raises:
        UserError: there is no such file, class or name, or the file cannot be imported.
    """
    path, colon, cls = name.rpartition(":")
    if colon or name.endswith(".py") or "/" in name:
        return _of_file(offer, Path(path), cls) if colon else _of_file(offer, Path(name), "")
    installed = {point.name: point for point in entry_points(group=offer.group)} | dict(
        shipped or {}
    )
    if name not in installed:
        similar = closest(name, installed)
        remedy = f"perhaps you meant {similar}" if similar else None
        known = ", ".join(sorted(installed)) or "none"
        raise ConfigError(offer.word, name, f"{offer.form}, or installed ({known})", remedy)
    found = installed[name]
    with user_code(f"{offer.word} {name}"):
        return found.load() if isinstance(found, EntryPoint) else found


def offered(offer: PluginKind, cls: str, names: set[str]) -> str | None:
    """Return the name under which an installed package offers a class with these fields; None
    without just one."""
    found = []
    for point in entry_points(group=offer.group):
        if point.value.rpartition(":")[2] == cls:
            with user_code(f"{offer.word} {point.name}"):
                loaded = point.load()
            if is_dataclass(loaded) and {f.name for f in fields(loaded)} == names:
                found.append(point.name)
    return found[0] if len(found) == 1 else None


def naming(offer: PluginKind, cls: str) -> str:
    """Return the flag that names a class which no package offers, or the strategies of teams."""
    return (
        "--strategy NAME=SHARE NAME=SHARE"
        if cls == "Teams"
        else f"--{offer.word} FILE.py:{shown(cls)}"
    )


def _of_file(offer: PluginKind, path: Path, name: str) -> Any:
    module = _imported(offer, path)
    found = getattr(module, name, None) if name else None
    if found is None:
        own = [
            value
            for value in vars(module).values()
            if getattr(value, "__module__", "") == module.__name__
        ]
        classes = [
            value.__name__
            for value in own
            if isinstance(value, type) and hasattr(value, offer.method)
        ]
        fact = f"{path} has no {name}" if name else f"{offer.word} {path} names no class"
        listed = f"its {offer.plural} are {', '.join(classes)}"
        there = listed if classes else f"it has no class with a method {offer.method}"
        raise UserError(f"{fact}; {there}; write {path}:{classes[0] if classes else 'CLASS'}")
    if not (isinstance(found, type) or is_dataclass(found) or makes_strategies(found)):
        raise UserError(
            f"{path}:{name} is a {type(found).__name__}; name a class, see {offer.base}"
        )
    return found


def _imported(offer: PluginKind, path: Path) -> ModuleType:
    """Return the module of a file, which is executed.

    Raises:
        UserError: it does not exist, cannot be read, or is not Python; or it raises an exception.
    """
    fault = "does not exist"
    module = None
    try:
        if path.is_file():
            check_file(path)
            fault = "is not Python"
            with user_code(f"{offer.word} file {path.name}"):
                module = import_file(path)
    except OSError as error:
        fault = f"cannot be read ({error.strerror or error})"
    if module is None:
        raise UserError(f"{offer.word} file {shown(path)} {fault}; give {offer.form}")
    return module
