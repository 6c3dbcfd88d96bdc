"""The scenario of the page: its settings by the names of their controls."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Self

from iswarm_mj.config.setting_names import canonical_name, names_of
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.simulation.run import Run, check_scenario
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.scenario_flags import (
    engine_name,
    made_of,
    parts_of,
    paths_of,
    strategy_name,
    task_name,
    value_at,
)
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.strategy.library import STRATEGIES, TASKS
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.utils.errors import UserError, shown
from iswarm_mj.utils.user_code import user_code

MOST_STEPS = 1_000_000
"""Largest number of control steps of a run."""
_WITHOUT_PART = ("seed", "robots")
"""Settings that are fields of the scenario itself, and of no part of it."""


@dataclass(frozen=True)
class PageScenario(Scenario):
    """One world of a scenario, which the page shows for as long as it is watched.

    Settings are called as flags of `iswarm run`, with dots within groups.
    """

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """Return the scenario of the page; its steps are without end.

        Raises:
            UserError: it has several worlds or a goal, which the page does not.
        """
        if (
            not isinstance(scenario.worlds, int)
            or scenario.worlds != 1
            or scenario.strategy_per_world
        ):
            raise UserError("the page shows one world; give a scenario with worlds=1")
        if scenario.goal is not None:
            raise UserError(
                "the page goes on for as long as it is watched; give a scenario without goal"
            )
        values: dict[str, Any] = {f.name: getattr(scenario, f.name) for f in fields(Scenario)}
        values["steps"] = Scenario.steps
        return cls(**values)

    def run(self) -> Run:
        """Return the run at its start.

        Raises:
            UserError: settings that do not fit each other.
        """
        return Run(replace(self, steps=MOST_STEPS, engine=self.engine.in_chunks(1)))

    def check(self) -> None:
        """Check that a run could begin with these settings.

        Raises:
            UserError: settings that do not fit each other.
        """
        check_scenario(replace(self, steps=MOST_STEPS, engine=self.engine.in_chunks(1)))

    def paths(self) -> dict[str, tuple[str, ...]]:
        """Return the path of attributes to each setting that is a field of a part, by its name.

        The name `task.range` has the path ("task", "range"); the plain name `range` stands in its
        place where no other part has a field of this name. Fields of teams are called
        `TEAM.FIELD`, and their paths are ("strategy", TEAM, FIELD).
        """
        paths = paths_of(self)
        if isinstance(self.strategy, Teams):
            for team in self.strategy.teams:
                for name in names_of(team.strategy):
                    # A team may have the name of a group of the configuration.
                    paths.setdefault(f"{team.name}.{name}", ("strategy", team.name, name))
        return paths

    def path_of(self, name: str) -> tuple[str, ...]:
        """Return the path of attributes to a setting of a part by any of its names.

        The path is empty where there is none, or where several parts have a setting of this name.
        """
        paths = self.paths()
        if name in paths:
            return paths[name]

        # Names with the part work for all settings, also for those that are called without it.
        part, _, field_name = name.partition(".")
        full_path = (part, field_name)
        return full_path if full_path in paths.values() else ()

    def has(self, name: str) -> bool:
        """Return whether there is a setting with a name, other than strategy, task and engine."""
        return name in _WITHOUT_PART or bool(self.path_of(self.canonical_name(name)))

    def canonical_name(self, name: str) -> str:
        """Return the name of a control by any name of its setting.

        Raises:
            UserError: several parts have a setting of this name.
        """
        return canonical_name(name, parts_of(self))

    def at(self, path: Iterable[str]) -> Any:
        """Return the value at a path of `paths`, or of a part of one; None where there is none."""
        names = tuple(path)
        if names[:1] == ("strategy",) and names[1:] and isinstance(self.strategy, Teams):
            return value_at(self.strategy.strategy_of(names[1]), names[2:])
        return value_at(self, names)

    def get(self, name: str) -> Any:
        """Return the value of a setting."""
        if name == "strategy":
            return strategy_name(self)
        if name == "task":
            return task_name(self)
        if name == "engine":
            return engine_name(self.engine)
        return self.at(self.path_of(name) or (name,))

    def set(self, name: str, value: Any) -> Self:
        """Return this scenario with another value of a setting.

        Raises:
            UserError: there is no such setting, or the value is out of range.
        """
        if name == "engine":
            if value == engine_name(self.engine):
                return self
            return replace(self, engine=find_engine(value).usual())
        if name == "strategy":
            return replace(self, strategy=made_of(STRATEGIES, value), strategy_name=value)
        if name == "task":
            return replace(self, task=made_of(TASKS, value), task_name=value)
        if name in _WITHOUT_PART:
            return replace(self, **{name: value})
        path = self.path_of(self.canonical_name(name))
        if not path:
            strategy = type(self.strategy).__name__
            task = type(self.task).__name__
            raise UserError(f"{strategy} and {task} have no setting {shown(name)}")
        before = self
        if self.genome and path == ("strategy", "density_of_robots"):
            before = replace(self, robots=None)  # which would outweigh the density
        with user_code(type(self.at(path[:-1])).__name__):
            if path[0] == "strategy" and isinstance(before.strategy, Teams):
                _, team, field_name = path
                strategy = replace(before.strategy.strategy_of(team), **{field_name: value})
                return replace(before, strategy=before.strategy.with_strategy(team, strategy))
            return _with_value(before, path, value)

    @property
    def density(self) -> float:
        """Robots per cell of the free floor, from which their number follows by default."""
        return (self.genome or TYPE1).density_of_robots

    @property
    def strategy_label(self) -> str:
        """Short name of the strategy, or names and shares of teams."""
        if not isinstance(self.strategy, Teams):
            return Path(self.get("strategy")).name
        shares = []
        for team in self.strategy.teams:
            is_number = isinstance(team.share, int)
            share = f"{team.share} robots" if is_number else f"{100 * team.share:g} %"
            shares.append(f"{team.name} {share}")
        return " and ".join(shares)

    @property
    def task_label(self) -> str:
        """Short name of the task."""
        return Path(self.get("task")).name

    def with_part(self, name: str, other: Scenario) -> Self:
        """Return this scenario with the strategy, the task or the engine of another one."""
        changed = {name: getattr(other, name)}
        if name != "engine":
            changed[f"{name}_name"] = getattr(other, f"{name}_name")
        return replace(self, **changed)

    def shared_name(self, name: str, other: "PageScenario") -> str | None:
        """Return the name here of a setting of another scenario.

        Args:
            name: name of a control of the other scenario.
            other: scenario that has the setting.

        Returns:
            The name; None where the setting belongs to a part that is of another class here.
        """
        path = other.path_of(name)
        if not path:  # of the scenario itself
            return name
        if type(self.at(path[:-1])) is not type(other.at(path[:-1])):
            return None
        return next(own_name for own_name, own_path in self.paths().items() if own_path == path)


def _with_value(settings: Any, path: tuple[str, ...], value: Any) -> Any:
    """Return a dataclass with another value at a path of attributes."""
    name, *rest = path
    if rest:
        value = _with_value(getattr(settings, name), tuple(rest), value)
    return replace(settings, **{name: value})
