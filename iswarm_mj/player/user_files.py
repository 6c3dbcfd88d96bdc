"""Strategies and tasks of users' files, which are made again when the files have changed."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.simulation.scenario_flags import default_of, forget_made, is_same, made_of
from iswarm_mj.strategy.library import STRATEGIES, TASKS
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.utils.operating_system import split_words
from iswarm_mj.utils.user_code import user_code

Stamps = dict[Path, tuple[int, int]]
"""Time of the latest change [ns] and size [bytes] of each file."""

_KINDS = {"strategy": STRATEGIES, "task": TASKS}
"""Parts of a scenario that users may write."""


def stamps_of(scenario: PageScenario) -> Stamps:
    """Return the stamps of the files of a scenario's strategy and task; a lost file has (0, 0)."""
    stamps = {}
    for part in _KINDS:
        for path in _files_of(scenario, part):
            try:
                status = path.stat()
                stamps[path] = (status.st_mtime_ns, status.st_size)
            except OSError:  # an editor may just replace it
                stamps[path] = (0, 0)
    return stamps


def renewed(scenario: PageScenario) -> PageScenario:
    """Return a scenario whose strategy and task are of the present content of their files.

    Fields keep the values that somebody changed; others have their new defaults. Parts whose files
    have not changed stay the very objects.

    Raises:
        UserError: a file cannot be read or executed, or no longer has the class.
    """
    parts = {}
    for part, kind in _KINDS.items():
        if not any(True for _ in _files_of(scenario, part)):
            continue
        before = getattr(scenario, part)
        after = made_of(kind, scenario.get(part))
        if _classes(after) != _classes(before):
            parts[part] = _with_values_of(before, after)
    if not parts:
        return scenario
    forget_made()
    return replace(scenario, **parts)


def _files_of(scenario: PageScenario, part: str) -> Iterator[Path]:
    """Yield the files that the name of a strategy or a task states."""
    name = scenario.get(part)
    words = split_words(name) if isinstance(getattr(scenario, part), Teams) else [name]
    for word in words:
        path = Path(word.rpartition(":")[0] or word)
        if path.suffix == ".py" and path.exists():
            yield path


def _classes(plugin: Any) -> list[type]:
    """Return the class of a strategy or a task, or those of teams."""
    if isinstance(plugin, Teams):
        return [type(team.strategy) for team in plugin.teams]
    return [type(plugin)]


def _with_values_of(before: Any, after: Any) -> Any:
    """Return an object of newer code with the values that were changed in the older one."""
    if isinstance(before, Teams) and isinstance(after, Teams):
        older = {team.name: team.strategy for team in before.teams}
        teams = {}
        for team in after.teams:
            strategy = _with_values_of(older.get(team.name), team.strategy)
            teams[team.name] = (team.share, strategy)
        return Teams(teams)
    if not is_dataclass(before) or not is_dataclass(after):
        return after

    kept_fields = {f.name for f in fields(after) if f.init}
    changed = {}
    for f in fields(before):
        value = getattr(before, f.name)
        if f.name in kept_fields and not is_same(value, default_of(before, f.name)):
            changed[f.name] = value
    with user_code(type(after).__name__):
        return replace(after, **changed)
