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
from iswarm_mj.strategy.library import STRATEGIES, TASKS, Offer
from iswarm_mj.strategy.pytrees import is_static_field
from iswarm_mj.strategy.rules import Rules
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
    unused = set(scenario.task.unused) | (set() if scenario.genome else {"strategy"})
    whose = "the strategy" if scenario.genome else type(scenario.strategy).__name__
    parts = [("", scenario.strategy, f"Rules of {whose}")]
    parts += [("", scenario.task, f"Task {type(scenario.task).__name__}")]
    parts += [(f"{k}.", part, k.capitalize()) for k, part in vars(scenario.config).items() if k not in unused]
    for prefix, part, group in parts:
        named = [(prefix + one.name, one) for one in declared(part) if prefix + one.name not in unused]
        found += [one._replace(name=name, group=group, is_live=is_live(scenario, name)) for name, one in named]
    return found


def _offers(offer: Offer, scenario: Scenario) -> tuple[str, ...]:
    """Names of strategies or tasks that packages offer, and that of the scenario."""
    return tuple(dict.fromkeys([scenario.named(offer), *sorted(p.name for p in entry_points(group=offer.group))]))


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
