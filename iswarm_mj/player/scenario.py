"""The scenario of the page: its settings by the names of their controls."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, Self

from iswarm_mj.engines.registry import find_engine
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.scenario_flags import (
    engine_name,
    made_of,
    paths_of,
    strategy_name,
    task_name,
    value_at,
)
from iswarm_mj.strategy.library import STRATEGIES, TASKS, PluginKind
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.utils.errors import UserError, shown

STEPS = 1_000_000
"""Control steps of a run at most."""
_OWN = ("seed", "robots")
"""Settings that are fields of a scenario, and of no part of it."""


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
        if not isinstance(scenario.worlds, int) or scenario.worlds != 1 or scenario.strategy_per_world:
            raise UserError("the page shows one world; give a scenario with worlds=1")
        if scenario.goal is not None:
            raise UserError("the page goes on for as long as it is watched; give a scenario without goal")
        values: dict[str, Any] = {one.name: getattr(scenario, one.name) for one in fields(Scenario)}
        values["steps"] = Scenario.steps
        return cls(**values)

    def run(self) -> Run:
        """Return the run at its start.

        Raises:
            UserError: settings that do not fit each other.
        """
        return Run(replace(self, steps=STEPS, engine=self.engine.in_chunks(1)))

    def paths(self) -> dict[str, tuple[str, ...]]:
        """Return where settings are that are fields of its parts, as attributes of attributes."""
        return paths_of(self)

    def at(self, path: Iterable[str]) -> Any:
        """Return what is at a path; None where there is nothing."""
        return value_at(self, path)

    def named(self, offer: PluginKind) -> str:
        """Return the name of its strategy or its task, as flags take it."""
        return task_name(self) if offer is TASKS else strategy_name(self)

    def get(self, name: str) -> Any:
        """Return the value of a setting."""
        if name == "strategy":
            return strategy_name(self)
        if name == "task":
            return task_name(self)
        if name == "engine":
            return engine_name(self.engine)
        return self.at(self.paths().get(name, (name,)))

    def set(self, name: str, value: Any) -> Self:
        """Return this scenario with another value of a setting.

        Raises:
            UserError: there is no such setting, or the value is out of range.
        """
        if name == "engine":
            return self if value == engine_name(self.engine) else replace(self, engine=find_engine(value).usual())
        if name == "strategy":
            return replace(self, strategy=made_of(STRATEGIES, value), strategy_name=value)
        if name == "task":
            return replace(self, task=made_of(TASKS, value), task_name=value)
        path = self.paths().get(name, (name,) if name in _OWN else ())
        if not path:
            strategy, task = type(self.strategy).__name__, type(self.task).__name__
            raise UserError(f"{strategy} and {task} have no setting {shown(name)}")
        before = replace(self, robots=None) if name == "density_of_robots" else self
        with user_code(type(self.at(path[:-1])).__name__):
            return _with(before, path, value)

    def with_part(self, name: str, other: Scenario) -> Self:
        """Return this scenario with the strategy, the task or the engine of another one."""
        found = {name: getattr(other, name)}
        if name != "engine":
            found[f"{name}_name"] = getattr(other, f"{name}_name")
        return replace(self, **found)

    def shares(self, name: str, other: "PageScenario") -> bool:
        """Return whether a setting belongs to parts of the same class in two scenarios."""
        path, other_path = self.paths().get(name, ()), other.paths().get(name, ())
        return path == other_path and type(self.at(path[:-1])) is type(other.at(path[:-1]))


def _with(given: Any, path: tuple[str, ...], value: Any) -> Any:
    """A dataclass in which something else is at a path."""
    name, *rest = path
    return replace(given, **{name: _with(getattr(given, name), tuple(rest), value) if rest else value})
