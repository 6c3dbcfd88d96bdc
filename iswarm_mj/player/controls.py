"""Controls of the page, found from what settings declare: their types, ranges, choices and docstrings."""

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib.metadata import entry_points
from typing import Any, NamedTuple

from iswarm_mj.engines.registry import ENGINES, OFFER
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.shared_settings import PER_WORLD_FIELDS
from iswarm_mj.strategy.library import STRATEGIES, TASKS
from iswarm_mj.strategy.pytrees import is_static_field
from iswarm_mj.strategy.rules import Rules
from iswarm_mj.utils.constraints import Within, check, choices, constraint_of, type_of
from iswarm_mj.utils.docstrings import field_docs
from iswarm_mj.utils.errors import ConfigError, UserError

AT_START = {"density_of_robots", "fraction_scouts"}
"""Parameters of the genome that a world has from its start."""
_HIDDEN = {"obstacles", "bench", "bench_capacity"}


class Control(NamedTuple):
    """A setting as the page offers it."""

    name: str
    """As a flag, as `optics.baud_rate`."""
    group: str
    """Heading under which it stands."""
    value: Any
    """bool, int, float, or a word; None where a number is left to a rule."""
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    unit: str = ""
    text: str = ""
    """Its docstring."""
    is_live: bool = False
    """Changes at once; others wait for a reset."""
    step: float = 0.0
    """Least difference of values on a slider; 0 for a 200th of the range."""

    def check(self, value: Any) -> Any:
        """Return a value that somebody sent, as a value of this setting.

        Args:
            value: of any type, since it may come from anywhere.

        Raises:
            ConfigError: it is none of the choices, of another type, or out of range.
        """
        if self.choices:
            is_allowed = isinstance(value, str) and value in self.choices
            check(self.name, value, " or ".join(self.choices), is_allowed)
            return value
        if isinstance(self.value, bool):
            check(self.name, value, "true or false", isinstance(value, bool))
            return value

        # JavaScript has one kind of numbers: 5 may arrive as 5.0, and 5.0 as 5.
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        limits = Within(self.low, self.high, self.unit)
        allowed = str(limits) if math.isfinite(self.low) else "finite"
        if isinstance(self.value, int):
            is_whole = is_number and (isinstance(value, int) or value.is_integer())
            check(self.name, value, f"a whole number, {allowed}", is_whole and limits.allows(value))
            return int(value)
        check(self.name, value, f"a number, {allowed}", is_number and limits.allows(value))
        return float(value)

    @property
    def label(self) -> str:
        """Name on the page."""
        name = self.name.rpartition(".")[2].replace("_", " ")
        return f"{name} [{self.unit}]" if self.unit else name


def is_live(scenario: PageScenario, name: str) -> bool:
    """Whether a setting may change while a run goes on: what programs take as arrays, see `PER_WORLD_FIELDS`."""
    match scenario.paths().get(name):
        case ("config", group, own):
            rules = Rules._fields if scenario.genome and group == "strategy" else ()
            return own in PER_WORLD_FIELDS[group] and (own in Conditions._fields or own in rules)
        case ("strategy", own) if scenario.genome:
            return own in Rules._fields and own not in AT_START
        case ("strategy" | "task" as part, own):
            cls = type(getattr(scenario, part))
            return not is_static_field(cls, next(f for f in fields(cls) if f.name == own))
    return False


def controls(scenario: PageScenario, start: PageScenario | None = None) -> list[Control]:
    """Return the controls of all settings that have an effect in a scenario.

    Args:
        scenario: whose values they show.
        start: whose strategy, task and engine can be chosen, too, beside those that packages offer.
    """
    found = [
        Control(
            name="seed",
            group="World",
            value=scenario.seed,
            low=0,
            high=2**32 - 2,
            text=field_docs(RunSettings)["seed"],
        ),
        _choice_of_part("task", TASKS.group, scenario, start, "What the robots do."),
        _choice_of_part("strategy", STRATEGIES.group, scenario, start, "How."),
        Control(
            name="robots",
            group="World",
            value=scenario.n_robots,
            low=1,
            high=max(200_000, scenario.n_robots),  # a dense swarm in a large arena has more
            text="Number of robots.",
        ),
        _choice_of_part("engine", OFFER.group, scenario, start, "Physics engine."),
    ]

    # Settings of the strategy and of the task, then those of the configuration.
    unused: set[str] = set(scenario.task.unused)
    if scenario.genome is None:
        unused.add("strategy")
    owner = "the strategy" if scenario.genome else type(scenario.strategy).__name__
    parts = [
        ("", scenario.strategy, f"Rules of {owner}"),
        ("", scenario.task, f"Task {type(scenario.task).__name__}"),
    ]
    for group, part in vars(scenario.config).items():
        if group not in unused:
            parts.append((f"{group}.", part, group.capitalize()))

    for prefix, part, group in parts:
        for control in declared(part):
            name = prefix + control.name
            if name not in unused:
                is_rule = is_live(scenario, name)
                found.append(control._replace(name=name, group=group, is_live=is_rule))
    return found


def _choice_of_part(name: str, group: str, scenario: PageScenario, start: PageScenario | None, text: str) -> Control:
    """Return the control that chooses a strategy, a task or an engine by its name.

    Args:
        name: of the part.
        group: of entry points of installed packages.
        scenario: that has a part of this kind.
        start: that has another one, perhaps of a user's file.
        text: explains the control.
    """
    names = [scenario.get(name)]
    if start is not None:
        names.append(start.get(name))
    names += ENGINES if name == "engine" else sorted(point.name for point in entry_points(group=group))
    return Control(name=name, group="World", value=names[0], choices=tuple(dict.fromkeys(names)), text=text)


def declared(given: Any) -> Iterator[Control]:
    """Yield the controls of the fields of a dataclass that are numbers, flags or words."""
    cls = type(given)
    for f in fields(given) if is_dataclass(given) else ():
        value = getattr(given, f.name)
        limits = constraint_of(cls, f.name)
        words = choices(cls, f.name)
        if f.name in _HIDDEN or not f.init or not (words or isinstance(value, bool | int | float)):
            continue

        # Whole numbers do where fields are floats, and are changed to other floats.
        if isinstance(value, int) and not isinstance(value, bool) and type_of(cls, f.name) is float:
            value = float(value)
        low, high, unit = (limits.low, limits.high, limits.unit) if limits else (-math.inf, math.inf, "")
        yield Control(f.name, "", value, low, high, words, unit, field_docs(cls).get(f.name, ""))


def parsed(scenario: PageScenario, name: str, text: str) -> Any:
    """Return the value of a setting that a text states, for a change while the run goes on.

    Raises:
        UserError: the setting cannot change so, or the text is no value of its type.
    """
    live = {one.name: one.value for one in controls(scenario) if one.is_live}
    if name not in live:
        raise UserError(f"{name} cannot change while the run goes on; {', '.join(live)} can")
    kind = type(live[name])
    try:
        return {"true": True, "false": False}[text] if kind is bool else kind(text)
    except (KeyError, ValueError):
        raise ConfigError(name, text, f"like {str(live[name]).lower()}") from None
