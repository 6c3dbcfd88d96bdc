"""Controls of the page, from what settings declare: types, ranges, choices and docstrings."""

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj.config.setting_names import CONFIG_NAMES, PARTS
from iswarm_mj.engines.registry import ENGINES
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.shared_settings import PER_WORLD_FIELDS
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.library import STRATEGIES, TASKS
from iswarm_mj.strategy.pytrees import is_static_field
from iswarm_mj.strategy.rules import Rules
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.utils import constraints
from iswarm_mj.utils.constraints import Within
from iswarm_mj.utils.docstrings import field_docs
from iswarm_mj.utils.errors import ConfigError, UserError

_FIXED_AT_START = {"density_of_robots", "fraction_scouts"}
"""Parameters of the genome that have their effect as a world begins: a change needs a reset."""
USUAL_MOST_ROBOTS = 200_000
"""Largest number of robots, unless density and arena make more."""
_ANY_FINITE = Within(-math.inf)
_HIDDEN = {"obstacles", "bench", "bench_capacity"}
"""Settings without a control: clicks put obstacles, and pages need no other bench."""


class _PageUnit(NamedTuple):
    """Unit of a quantity on the page."""

    name: str
    factor: float
    """Value on the page over that in SI."""


_UNITS = {
    "m": _PageUnit("µm", 1e6),
    "F": _PageUnit("µF", 1e6),
    "J": _PageUnit("µJ", 1e6),
    "W": _PageUnit("mW", 1e3),
    "J/m^2": _PageUnit("mJ/m²", 1e3),
}
"""Units on the page of the configuration's quantities, by their units in SI."""
_UNIT_OF_SETTING = {"tool_capacitance": _PageUnit("pF", 1e12)}
"""Units of settings that are much smaller than others of their kind."""


class Control(NamedTuple):
    """A setting as the page offers it."""

    name: str
    """Name of the setting as flags have it, such as `optics.baud_rate`."""
    group: str
    """Heading under which the control stands."""
    value: Any
    """Present value: bool, int, float, or a word."""
    limits: Within | None = None
    """Range and unit of a number; None where any finite one is allowed."""
    choices: tuple[str, ...] = ()
    """Words that can be chosen, for a setting that is a word."""
    text: str = ""
    """Docstring of the setting."""
    is_live: bool = False
    """A change has its effect at once; other settings wait for a reset."""
    step: float = 0.0
    """Least difference of values on a slider; 0 for a 200th of the range."""
    factor: float = 1.0
    """Value on the page over that of the setting, see `in_page_units`."""

    @property
    def low(self) -> float:
        """Limit below; it may be excluded (`constraints.Above`)."""
        return self.limits.low if self.limits else -math.inf

    @property
    def high(self) -> float:
        """Limit above."""
        return self.limits.high if self.limits else math.inf

    @property
    def unit(self) -> str:
        """Unit of the value; empty for one without a unit."""
        return self.limits.unit if self.limits else ""

    def convert(self, value: Any) -> Any:
        """Return a value that somebody sent, as a value of this setting.

        Args:
            value: anything, since any browser may have sent it.

        Raises:
            ConfigError: it is none of the choices, of another type, or out of range.
        """
        if self.choices:
            is_choice = isinstance(value, str) and value in self.choices
            constraints.check(self.name, value, " or ".join(self.choices), is_choice)
            return value
        if isinstance(self.value, bool):
            constraints.check(self.name, value, "true or false", isinstance(value, bool))
            return value

        limits = self.limits or _ANY_FINITE
        allowed = str(limits) if self.limits else "finite"
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not isinstance(self.value, int):
            is_allowed = is_number and limits.allows(value)
            constraints.check(self.name, value, f"a number, {allowed}", is_allowed)
            return float(value)

        # JavaScript has one kind of numbers: 5 may arrive as 5.0.
        is_whole = is_number and (isinstance(value, int) or value.is_integer())
        is_allowed = is_whole and limits.allows(value)
        constraints.check(self.name, value, f"a whole number, {allowed}", is_allowed)
        return int(value)

    def text_of(self, value: Any) -> str:
        """Return a value as a line of text shows it."""
        if isinstance(value, bool):
            return "on" if value else "off"
        if isinstance(value, str):
            return Path(value).name  # without the folder of a user's file
        return f"{value:.6g}" if isinstance(value, float) else str(value)

    def of_page(self, value: Any) -> Any:
        """Return the value on the page for a value of the setting."""
        return value if self.factor == 1 else _rounded(value * self.factor)

    def of_setting(self, value: Any) -> Any:
        """Return the value of the setting for a value on the page."""
        return value if self.factor == 1 else _rounded(value / self.factor)

    @property
    def label(self) -> str:
        """Name on the page, with its part where two parts have a field of one name."""
        part, _, field_name = self.name.rpartition(".")
        is_shared = part in PARTS and self.name not in CONFIG_NAMES
        name = f"{part} {field_name}" if is_shared else field_name
        name = name.replace("_", " ")
        return f"{name} [{self.unit}]" if self.unit else name


def in_page_units(control: Control) -> Control:
    """Return a control of the configuration in units in which its values are readable.

    SI units would make a capacitance of 1 uF a box that shows 0.0000010. Settings of users' own
    strategies and tasks keep their units.
    """
    field_name = control.name.rpartition(".")[2]
    unit = _UNIT_OF_SETTING.get(field_name) or _UNITS.get(control.unit)
    if control.limits is None or control.name not in CONFIG_NAMES or unit is None:
        return control
    limits = replace(
        control.limits,
        low=_rounded(control.low * unit.factor),
        high=_rounded(control.high * unit.factor),
        unit=unit.name,
    )
    return control._replace(
        value=_rounded(control.value * unit.factor),
        limits=limits,
        text=control.text.replace(f"[{control.unit}]", f"[{unit.name}]"),
        factor=unit.factor,
    )


def _rounded(value: float) -> float:
    """Return a number to twelve digits, without what another unit left behind them."""
    return float(f"{value:.12g}")


def may_change_at_once(scenario: PageScenario, name: str) -> bool:
    """Return whether a setting may change while the run goes on.

    Compiled programs take it as an array then: a field of `Conditions` or of `Rules`, or a field of
    a user's strategy or task that is not compiled in.
    """
    has_genome = scenario.genome is not None
    match scenario.path_of(name):
        case ("config", group, field_name):
            is_condition = field_name in Conditions._fields
            is_rule = has_genome and group == "strategy" and field_name in Rules._fields
            return field_name in PER_WORLD_FIELDS[group] and (is_condition or is_rule)
        case ("strategy", *_, field_name) | ("task", field_name):
            return _is_compiled_as_array(scenario.at(scenario.path_of(name)[:-1]), field_name)
    return False


def _is_compiled_as_array(owner: Any, field_name: str) -> bool:
    """Return whether compiled programs take a field of a strategy or a task as an array."""
    if isinstance(owner, Genome):
        return field_name in Rules._fields and field_name not in _FIXED_AT_START
    cls = type(owner)
    (declaration,) = [f for f in fields(cls) if f.name == field_name]
    return not is_static_field(cls, declaration)


def controls(scenario: PageScenario, start: PageScenario | None = None) -> list[Control]:
    """Return the controls of all settings that have an effect in a scenario.

    Args:
        scenario: scenario whose values they show.
        start: scenario whose strategy, task and engine can be chosen, too, beside those that
            packages offer.
    """
    return _controls_of_run(scenario, start) + _controls_of_parts(scenario)


def _controls_of_run(scenario: PageScenario, start: PageScenario | None) -> list[Control]:
    """Return the controls of seed, task, strategy, number of robots, and engine."""
    seed = Control(
        name="seed",
        group="World",
        value=scenario.seed,
        limits=Within(0, 2**32 - 2),
        text=field_docs(RunSettings)["seed"],
    )
    robots = Control(
        name="robots",
        group="World",
        value=scenario.n_robots,
        limits=Within(1, max(USUAL_MOST_ROBOTS, scenario.n_robots)),
        text="Number of robots.",
    )
    return [
        seed,
        _choice_of_part("task", scenario, start, "What the robots do."),
        _choice_of_part("strategy", scenario, start, "How."),
        robots,
        _choice_of_part("engine", scenario, start, "Physics engine."),
    ]


def _controls_of_parts(scenario: PageScenario) -> list[Control]:
    """Return the controls of settings of the strategy, the task and the configuration."""
    # A task lists groups of the configuration, such as "optics", and settings.
    unused: set[str] = set(scenario.task.unused)
    owner = "the strategy"
    if scenario.genome is None:
        # The group "strategy" has the paper's rules, which only robots with a genome follow.
        unused.add("strategy")
        owner = type(scenario.strategy).__name__
    parts: list[tuple[tuple[str, ...], Any, str]] = []
    if isinstance(scenario.strategy, Teams):
        for team in scenario.strategy.teams:
            parts.append((("strategy", team.name), team.strategy, f"Rules of team {team.name}"))
    else:
        parts.append((("strategy",), scenario.strategy, f"Rules of {owner}"))
    parts.append((("task",), scenario.task, f"Task {type(scenario.task).__name__}"))
    for group, part in vars(scenario.config).items():
        if group not in unused:
            parts.append((("config", group), part, group.capitalize()))

    name_of = {path: name for name, path in scenario.paths().items()}
    if isinstance(scenario.strategy, Teams):
        # Numbers of robots are those of the teams' shares.
        unused |= {f"{team.name}.density_of_robots" for team in scenario.strategy.teams}

    settings: list[Control] = []
    for path, part, group in parts:
        for control in declared(part):
            name = name_of[*path, control.name]
            if name not in unused:
                is_live = may_change_at_once(scenario, name)
                settings.append(control._replace(name=name, group=group, is_live=is_live))
    return settings


def _choice_of_part(
    name: str,
    scenario: PageScenario,
    start: PageScenario | None,
    text: str,
) -> Control:
    """Return the control that chooses a strategy, a task or an engine by its name.

    Args:
        name: name of the setting.
        scenario: scenario whose part is chosen at present.
        start: scenario that has another one, perhaps of a user's file.
        text: explanation of the control.
    """
    names = [scenario.get(name)]
    if start is not None:
        names.append(start.get(name))
    if name == "engine":
        names += ENGINES
    else:
        group = (TASKS if name == "task" else STRATEGIES).group
        names += sorted(point.name for point in entry_points(group=group))
    distinct = tuple(dict.fromkeys(names))
    return Control(name=name, group="World", value=names[0], choices=distinct, text=text)


def declared(settings: Any) -> Iterator[Control]:
    """Yield the controls of the fields of a dataclass that are numbers, flags or words."""
    if not is_dataclass(settings):
        return
    cls = type(settings)
    for f in fields(settings):
        value = getattr(settings, f.name)
        words = constraints.choices(cls, f.name)
        can_be_shown = words or isinstance(value, bool | int | float)
        if f.name in _HIDDEN or not f.init or not can_be_shown:
            continue

        # Users may write a whole number where a field is a float, and move it to other floats.
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        if is_whole and constraints.type_of(cls, f.name) is float:
            value = float(value)

        yield Control(
            name=f.name,
            group="",  # as the caller adds it, who knows where the object belongs
            value=value,
            limits=constraints.constraint_of(cls, f.name),
            choices=words,
            text=field_docs(cls).get(f.name, ""),
        )


def parsed(scenario: PageScenario, name: str, text: str) -> Any:
    """Return the value of a setting that a text states, for a change while the run goes on.

    Its range is not checked here: scenarios check it, when they take the value.

    Raises:
        UserError: the setting cannot change so, or the text is no value of its type.
    """
    values = {control.name: control.value for control in controls(scenario) if control.is_live}
    if name not in values:
        raise UserError(f"{name} cannot change while the run goes on; {', '.join(values)} can")
    kind = type(values[name])
    try:
        if kind is bool:
            return {"true": True, "false": False}[text]
        return kind(text)
    except (KeyError, ValueError):
        raise ConfigError(name, text, f"like {str(values[name]).lower()}") from None
