"""Controls of the page, found from what settings declare: their types, ranges, choices and docstrings."""

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib.metadata import entry_points
from typing import Any, NamedTuple

from iswarm_mj.engines.registry import ENGINES
from iswarm_mj.player.scenario import Scenario
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.simulation.common import PER_WORLD_FIELDS
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.library import STRATEGIES, Offer
from iswarm_mj.strategy.pytrees import is_static_field
from iswarm_mj.strategy.rules import Rules
from iswarm_mj.tasks.library import TASKS
from iswarm_mj.utils.constraints import choices, constraint_of
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

    @property
    def label(self) -> str:
        """Name on the page."""
        name = self.name.rpartition(".")[2].replace("_", " ")
        return f"{name} [{self.unit}]" if self.unit else name


def is_live(scenario: Scenario, name: str) -> bool:
    """Whether a setting may change while a run goes on: what programs take as arrays, see `PER_WORLD_FIELDS`."""
    group, _, own = name.rpartition(".")
    if group:
        rules = Rules._fields if scenario.strategy is None and group == "strategy" else ()
        return own in PER_WORLD_FIELDS[group] and (own in Conditions._fields or own in rules)
    if scenario.strategy is None:
        return name in Rules._fields and name not in AT_START
    own = {f.name: f for f in fields(scenario.strategy)} if is_dataclass(scenario.strategy) else {}
    return name in own and not is_static_field(type(scenario.strategy), own[name])


def controls(scenario: Scenario) -> list[Control]:
    """Return the controls of all settings that have an effect in a scenario."""
    engines = tuple(dict.fromkeys((*ENGINES, scenario.engine_name)))
    found = [
        Control("seed", "World", scenario.seed, 0, 2**32 - 2, text=field_docs(RunSettings)["seed"]),
        Control("task", "World", scenario.named(TASKS), choices=_offers(TASKS, scenario), text="What the robots do."),
        Control("strategy", "World", scenario.named(STRATEGIES), choices=_offers(STRATEGIES, scenario), text="How."),
        Control("robots", "World", scenario.n_robots, 1, 200_000, text="Number of robots."),
        Control("engine", "World", scenario.engine_name, choices=engines, text="Physics engine."),
    ]
    if scenario.strategy is None:
        found += _of(scenario, scenario.genome, "", "Rules of the strategy")
    else:
        found += _of(scenario, scenario.strategy, "", f"Rules of {type(scenario.strategy).__name__}")
    found += _of(scenario, scenario.task, "", f"Task {type(scenario.task).__name__}")
    unused = set(getattr(scenario.task, "unused", ())) | ({"strategy"} if scenario.strategy is not None else set())
    for group, part in vars(scenario.config).items():
        if group not in unused:
            found += [one for one in _of(scenario, part, f"{group}.", group.capitalize()) if one.name not in unused]
    return found


def _offers(offer: Offer, scenario: Scenario) -> tuple[str, ...]:
    """Names of strategies or tasks that packages offer, and that of the scenario."""
    return tuple(dict.fromkeys([scenario.named(offer), *sorted(p.name for p in entry_points(group=offer.group))]))


def _of(scenario: Scenario, given: Any, prefix: str, group: str) -> Iterator[Control]:
    """Controls of a part of a scenario, whose names have a prefix."""
    for control in declared(given):
        name = prefix + control.name
        yield control._replace(name=name, group=group, is_live=is_live(scenario, name))


def declared(given: Any) -> Iterator[Control]:
    """Yield the controls of the fields of a dataclass that are numbers, flags or words."""
    cls = type(given)
    for f in fields(given) if is_dataclass(given) else ():
        value, limits, words = getattr(given, f.name), constraint_of(cls, f.name), choices(cls, f.name)
        if f.name in _HIDDEN or not f.init or not (words or isinstance(value, bool | int | float)):
            continue
        low, high, unit = (limits.low, limits.high, limits.unit) if limits else (-math.inf, math.inf, "")
        yield Control(f.name, "", value, low, high, words, unit, field_docs(cls).get(f.name, ""))


def parsed(scenario: Scenario, name: str, text: str) -> Any:
    """Return the value of a setting that a text states.

    Raises:
        UserError: there is no such control, or the text is no value of its type.
    """
    known = {one.name: one for one in controls(scenario)}
    if name not in known:
        raise UserError(f"there is no setting {name} to change; allowed are {', '.join(known)}")
    control = known[name]
    if control.choices:
        if text not in control.choices:
            raise ConfigError(name, text, f"one of {', '.join(control.choices)}")
        return text
    if isinstance(control.value, bool):
        if text not in ("true", "false"):
            raise ConfigError(name, text, "true or false")
        return text == "true"
    try:
        return int(text) if isinstance(control.value, int) else float(text)
    except ValueError:
        raise ConfigError(name, text, "a number") from None
