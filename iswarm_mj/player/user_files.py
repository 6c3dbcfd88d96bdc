"""Strategies and tasks of users' files, which are made again when the files have changed."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.simulation.scenario_flags import default_of, forget_made, is_same, made_of
from iswarm_mj.strategy.library import STRATEGIES, TASKS
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.operating_system import split_words
from iswarm_mj.utils.user_code import user_code

Stamps = dict[Path, tuple[int, int]]
"""Time of the latest change [ns] and size [bytes] of each file; (0, 0) where there is none."""

_KINDS = {"strategy": STRATEGIES, "task": TASKS}
"""Parts of a scenario that users may write."""


class _Name(NamedTuple):
    """Name of a strategy or a task that is of users' files."""

    part: str
    """strategy or task."""
    name: str
    """Name as --strategy or --task takes it."""
    files: tuple[Path, ...]
    """Files that it states."""


class _Code(NamedTuple):
    """A strategy or a task as its files had it when they were read."""

    made: Any
    """What the name alone gives; None where a field has no default."""
    stamps: Stamps
    """Stamps of the files then."""


@dataclass(frozen=True)
class UserCode:
    """Strategies and tasks of users' files as they were when the files were read."""

    codes: Mapping[_Name, _Code] = field(default_factory=dict)
    """Code by its name."""

    def including(self, scenario: PageScenario) -> Self:
        """Return this code with that of a scenario, whose files have just been read."""
        codes = dict(self.codes)
        for name in names_of_files(scenario):
            if name not in codes:
                codes[name] = _Code(_made_or_none(name), stamps_of(name.files))
        return type(self)(codes)

    def changed_files(self, *scenarios: PageScenario) -> Stamps:
        """Return the present stamps of scenarios' files that have changed since they were read."""
        changed = {}
        for scenario in scenarios:
            for name in names_of_files(scenario):
                read = self.codes[name].stamps
                present = stamps_of(name.files)
                changed |= {path: present[path] for path in present if present[path] != read[path]}
        return changed

    def read_again(self, *scenarios: PageScenario) -> Self:
        """Return this code with the present content of scenarios' files that have changed.

        Raises:
            UserError: a file cannot be read or executed, or no longer has the class.
        """
        codes = dict(self.codes)
        for scenario in scenarios:
            for name in names_of_files(scenario):
                stamps = stamps_of(name.files)
                if stamps != codes[name].stamps:
                    codes[name] = _Code(made_of(_KINDS[name.part], name.name), stamps)
        forget_made()
        return type(self)(codes)

    def renewed(self, scenario: PageScenario, before: "UserCode") -> PageScenario:
        """Return a scenario with this code in place of an earlier one.

        Fields keep the values that somebody changed; others have their new defaults. Parts whose
        files have not changed stay the very objects.

        Args:
            scenario: scenario with the earlier code.
            before: the earlier code.

        Raises:
            UserError: the new code refuses a value.
        """
        parts = {}
        for name in names_of_files(scenario):
            code = self.codes[name]
            code_before = before.codes[name]
            if code is not code_before:
                part = getattr(scenario, name.part)
                parts[name.part] = _with_values_of(part, code_before.made, code.made)
        return replace(scenario, **parts) if parts else scenario


def names_of_files(scenario: PageScenario) -> list[_Name]:
    """Return the names of a scenario's strategy and task, of those that are of users' files."""
    names = []
    for part in _KINDS:
        name = scenario.get(part)
        words = split_words(name) if isinstance(getattr(scenario, part), Teams) else [name]
        paths = [Path(word.rpartition(":")[0] or word) for word in words]
        files = tuple(path for path in paths if path.suffix == ".py")
        if files:
            names.append(_Name(part, name, files))
    return names


def stamps_of(files: tuple[Path, ...]) -> Stamps:
    """Return the present stamps of files."""
    stamps = {}
    for path in files:
        try:
            status = path.stat()
            stamps[path] = (status.st_mtime_ns, status.st_size)
        except OSError:  # an editor may just replace it
            stamps[path] = (0, 0)
    return stamps


def _made_or_none(name: _Name) -> Any:
    """Return the strategy or the task that a name alone gives; None where it gives none."""
    try:
        return made_of(_KINDS[name.part], name.name)
    except UserError:
        return None


def _with_values_of(before: Any, made_before: Any, after: Any) -> Any:
    """Return an object of newer code with the values that were changed in the older one.

    Args:
        before: object of the older code.
        made_before: what the older code gave without changes; None if that is unknown.
        after: what the newer code gives.
    """
    if isinstance(before, Teams) and isinstance(after, Teams):
        return _teams_with_values_of(before, made_before, after)
    if not is_dataclass(before) or not is_dataclass(after):
        return after

    kept_fields = {f.name for f in fields(after) if f.init}
    changed = {}
    for f in fields(before):
        value = getattr(before, f.name)
        is_known = type(made_before) is type(before)
        default = getattr(made_before, f.name) if is_known else default_of(before, f.name)
        if f.name in kept_fields and not is_same(value, default):
            changed[f.name] = value
    instance: Any = after  # after `is_dataclass` pyright takes it for a class, too
    with user_code(type(after).__name__):
        return replace(instance, **changed)


def _teams_with_values_of(before: Teams, made_before: Any, after: Teams) -> Teams:
    """Return teams of newer code with the values that were changed in the older ones."""
    older = {team.name: team.strategy for team in before.teams}
    made = {}
    if isinstance(made_before, Teams):
        made = {team.name: team.strategy for team in made_before.teams}

    teams = {}
    for team in after.teams:
        strategy = _with_values_of(older.get(team.name), made.get(team.name), team.strategy)
        teams[team.name] = (team.share, strategy)
    return Teams(teams)
