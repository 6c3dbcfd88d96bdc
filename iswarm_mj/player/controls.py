"""Controls of the page, from what settings declare: types, ranges, choices and docstrings."""

import math
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib.metadata import entry_points
from typing import Any, NamedTuple

from iswarm_mj.config.setting_names import CONFIG_NAMES, PARTS
from iswarm_mj.engines.registry import ENGINES
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
USUAL_MOST_ROBOTS = 200_000
"""Largest number of robots, unless density and arena make more."""
_HIDDEN = {"obstacles", "bench", "bench_capacity"}
"""Settings without a control: clicks put obstacles, and pages need no other bench."""


class Control(NamedTuple):
    """A setting as the page offers it."""

    name: str
    """Name of the setting as flags have it, such as `optics.baud_rate`."""
    group: str
    """Heading under which the control stands."""
    value: Any
    """Present value: bool, int, float, or a word; None where a number is left to a rule."""
    low: float = -math.inf
    """Least value."""
    high: float = math.inf
    """Largest value."""
    choices: tuple[str, ...] = ()
    """Words that can be chosen, for a setting that is a word."""
    unit: str = ""
    """Unit of the value."""
    text: str = ""
    """Docstring of the setting."""
    is_live: bool = False
    """The setting changes at once; others wait for a reset."""
    step: float = 0.0
    """Least difference of values on a slider; 0 for a 200th of the range."""

    def check(self, value: Any) -> Any:
        """Return a value that somebody sent, as a value of this setting.

        Args:
            value: anything, since any browser may have sent it.

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
        """Name on the page, with its part where two parts have a field of one name."""
        part, _, field_name = self.name.rpartition(".")
        is_shared = part in PARTS and self.name not in CONFIG_NAMES
        name = f"{part} {field_name}" if is_shared else field_name
        name = name.replace("_", " ")
        return f"{name} [{self.unit}]" if self.unit else name


def is_live(scenario: PageScenario, name: str) -> bool:
    """Return whether a setting may change while a run goes on.

    Those may that compiled programs take as arrays (`PER_WORLD_FIELDS`, `Conditions`, `Rules`).
    """
    match scenario.path_of(name):
        case ("config", group, field_name):
            has_rules = scenario.genome and group == "strategy"
            is_rule = has_rules and field_name in Rules._fields
            is_array = field_name in Conditions._fields or is_rule
            return field_name in PER_WORLD_FIELDS[group] and bool(is_array)
        case ("strategy", field_name) if scenario.genome:
            return field_name in Rules._fields and field_name not in AT_START
        case ("strategy" | "task" as part, field_name):
            cls = type(getattr(scenario, part))
            (declaration,) = [f for f in fields(cls) if f.name == field_name]
            return not is_static_field(cls, declaration)
    return False


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
        low=0,
        high=2**32 - 2,
        text=field_docs(RunSettings)["seed"],
    )
    robots = Control(
        name="robots",
        group="World",
        value=scenario.n_robots,
        low=1,
        high=max(USUAL_MOST_ROBOTS, scenario.n_robots),
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
    unused: set[str] = set(scenario.task.unused)
    if scenario.genome is None:
        unused.add("strategy")
    owner = "the strategy" if scenario.genome else type(scenario.strategy).__name__
    parts: list[tuple[tuple[str, ...], Any, str]] = [
        (("strategy",), scenario.strategy, f"Rules of {owner}"),
        (("task",), scenario.task, f"Task {type(scenario.task).__name__}"),
    ]
    for group, part in vars(scenario.config).items():
        if group not in unused:
            parts.append((("config", group), part, group.capitalize()))

    name_of = {path: name for name, path in scenario.paths().items()}
    settings: list[Control] = []
    for path, part, group in parts:
        for control in declared(part):
            name = name_of[*path, control.name]
            if name not in unused:
                is_rule = is_live(scenario, name)
                settings.append(control._replace(name=name, group=group, is_live=is_rule))
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
        words = choices(cls, f.name)
        can_be_shown = words or isinstance(value, bool | int | float)
        if f.name in _HIDDEN or not f.init or not can_be_shown:
            continue

        # Users may write a whole number where a field is a float, and move it to other floats.
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        if is_whole and type_of(cls, f.name) is float:
            value = float(value)

        control = Control(
            name=f.name,
            group="",
            value=value,
            choices=words,
            text=field_docs(cls).get(f.name, ""),
        )
        limits = constraint_of(cls, f.name)
        if limits:
            control = control._replace(low=limits.low, high=limits.high, unit=limits.unit)
        yield control


def parsed(scenario: PageScenario, name: str, text: str) -> Any:
    """Return the value of a setting that a text states, for a change while the run goes on.

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
