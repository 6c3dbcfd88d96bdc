"""Allowed values of settings, declared in their annotations and checked where an object is made."""

import functools
import math
import numbers
from dataclasses import dataclass, is_dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

from iswarm_mj.utils.errors import ConfigError


@dataclass(frozen=True)
class Within:
    """Numbers from `low` to `high`, both included; in an annotation, as `Annotated[float, Within(0, 10, "rd")]`."""

    low: float
    high: float = math.inf
    unit: str = ""
    reason: str = ""
    """Why there is no more, where that is not obvious."""

    def allows(self, value: Any) -> bool:
        """Return whether the value lies within; NaN, infinite values and whole numbers beyond all floats never do."""
        try:
            return self.low <= value <= self.high and math.isfinite(value)
        except OverflowError:
            return False

    def __str__(self) -> str:
        limits = f"at least {_text(self.low)}"
        if math.isfinite(self.high):
            limits = self._limits()
        return " ".join(filter(None, [limits, self.unit])) + (f", since {self.reason}" if self.reason else "")

    def _limits(self) -> str:
        return f"between {_text(self.low)} and {_text(self.high)}"


TINY = 1e-12
"""Difference from a limit that is excluded; what is nearer may be the limit itself in single precision."""


@dataclass(frozen=True)
class Above(Within):
    """Numbers above `low`, by at least `TINY`, and up to `high`, which is included."""

    @property
    def least(self) -> float:
        """The smallest of them."""
        return self.low + TINY

    def allows(self, value: Any) -> bool:
        """Return whether the value lies within."""
        return value >= self.least and super().allows(value)

    def _limits(self) -> str:
        return f"above {_text(self.low)} and at most {_text(self.high)}"


@dataclass(frozen=True)
class Needs:
    """In an annotation: a setting has an effect only where another one of its class has one of some values."""

    setting: str
    values: tuple[Any, ...] = ()
    """Which; where there are none, any but None, False and 0."""
    why: str = ""
    """When there is no effect, to be read after "has no effect", where name and value of the other do not say it."""

    def unmet(self, settings: Any, group: str = "") -> str:
        """Return why the setting has no effect in an object; nothing if it has one."""
        value, name = getattr(settings, self.setting), f"`{group}{self.setting}`"
        if value in self.values if self.values else value:
            return ""
        shown = "" if value is True or not value else f" {value}"
        return self.why or f"{'with' if value else 'without'} {name}{shown}"


def check(name: str, value: Any, constraint: str, ok: bool) -> None:
    """Raise a `ConfigError` unless `ok`, or if the value is a float that is not finite."""
    if not ok or (isinstance(value, float) and not math.isfinite(value)):
        raise ConfigError(name, value, constraint)


def check_kind(name: str, value: Any, kind: type | tuple[type, ...]) -> None:
    """Raise a `ConfigError` unless a value is an object of a class, or of one of several."""
    if not isinstance(value, kind):
        kinds = kind if isinstance(kind, tuple) else (kind,)
        raise ConfigError(name, value, f"a {' or '.join(cls.__name__ for cls in kinds)}")


def is_whole(value: Any) -> bool:
    """Whether a value is a whole number of any type, but no truth value."""
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def validate(settings: Any, group: str = "") -> None:
    """Check the fields of a dataclass against their types and their `Within`; to be called by `__post_init__`.

    Fields of named tuples in it are checked with it, since these have no `__post_init__`.

    Args:
        settings: the object.
        group: its name as part of a configuration, which precedes the fields' names in errors.

    Raises:
        ConfigError: a field is out of range, not one of a `Literal`'s values, or of another type. Whole numbers do
            as floats, and None where the type allows it. Of a tuple each element is checked.
    """
    for name, (kind, _) in _declared(type(settings)).items():
        value, constraint = getattr(settings, name), constraint_of(type(settings), name)
        full = f"{group}.{name}" if group else name
        if kind is bool:
            check(full, value, "true or false", isinstance(value, bool))
        elif get_origin(kind) is Literal:
            check(full, value, " or ".join(get_args(kind)), isinstance(value, str) and value in get_args(kind))
        elif isinstance(kind, type) and is_dataclass(kind):
            check_kind(full, value, kind)
        elif isinstance(kind, type) and hasattr(kind, "_fields"):
            check_kind(full, value, kind)
            validate(value, full)
        elif constraint is not None and get_origin(kind) is tuple:
            check_kind(full, value, tuple)
            for element in value:
                _check_number(full, element, get_args(kind)[0], constraint)
        elif constraint is not None and not (value is None and type(None) in get_args(kind)):
            _check_number(full, value, kind, constraint)


def _check_number(name: str, value: Any, kind: Any, constraint: Within) -> None:
    whole = "a whole number " if {*(get_args(kind) or [kind])} <= {int, type(None)} else ""
    is_number = is_whole(value) or (not whole and isinstance(value, numbers.Real) and not isinstance(value, bool))
    if not (is_number and constraint.allows(value)):  # else its text would take most of the time
        raise ConfigError(name, value, f"{whole}{constraint}")


def spaced(text: str, most: int = 10_000) -> list[str]:
    """Return the numbers that START:STOP:COUNT describes, both ends included, as texts.

    Raises:
        ValueError: it is none, or there are more than `most`.
    """
    first, last, number = text.split(":")
    low, high, count = float(first), float(last), int(number)
    if not 1 <= count <= most:
        raise ValueError(count)
    return [f"{low + (high - low) * k / max(1, count - 1):.10g}" for k in range(count)]


def choices(cls: type, name: str) -> tuple[Any, ...]:
    """Values that a field of a dataclass may have whose type is a `Literal`; none for another type, or no field."""
    kind, _ = _declared(cls).get(name, (None, ()))
    return get_args(kind) if get_origin(kind) is Literal else ()


def type_of(cls: type, name: str) -> Any:
    """Return the type of a field of a dataclass, without its annotations."""
    kind, _ = _declared(cls)[name]
    return kind


@functools.cache
def constraint_of(cls: type, name: str) -> Within | None:
    """Limits of a field of a dataclass, or of the elements of a tuple; None for a field without limits."""
    _, extras = _declared(cls).get(name, (None, ()))
    return next((one for one in extras if isinstance(one, Within)), None)


def needs_of(cls: type, name: str) -> list[Needs]:
    """What a setting of a class needs in order to have an effect."""
    _, extras = _declared(cls).get(name, (None, ()))
    return [one for one in extras if isinstance(one, Needs)]


@functools.cache
def _declared(cls: type) -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Type of each field without annotations, and these, by name."""
    annotated = get_type_hints(cls, include_extras=True)
    return {name: (kind, getattr(annotated[name], "__metadata__", ())) for name, kind in get_type_hints(cls).items()}


def _text(number: float) -> str:
    return str(number) if isinstance(number, int) else f"{number:g}"
