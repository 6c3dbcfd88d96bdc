"""Allowed values of settings, declared in their annotations and checked where an object is made."""

import functools
import math
import numbers
from dataclasses import dataclass, is_dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

from iswarm_mj.utils.errors import ConfigError


@dataclass(frozen=True)
class Within:
    """Numbers from `low` to `high`, both included.

    To be used in an annotation, such as `Annotated[float, Within(0, 10, "rd")]`.
    """

    low: float
    high: float = math.inf
    unit: str = ""
    reason: str = ""
    """Reason for the limit, where it is not obvious."""

    def allows(self, value: Any) -> bool:
        """Return whether a value lies within.

        NaN, infinite values and whole numbers beyond all floats never do.
        """
        try:
            return self.low <= value <= self.high and math.isfinite(value)
        except OverflowError:
            return False

    def __str__(self) -> str:
        limits = self._limits() if math.isfinite(self.high) else f"at least {_text(self.low)}"
        unit = f" {self.unit}" if self.unit else ""
        reason = f", since {self.reason}" if self.reason else ""
        return f"{limits}{unit}{reason}"

    def _limits(self) -> str:
        if self.low == self.high:
            return _text(self.low)
        return f"between {_text(self.low)} and {_text(self.high)}"


TINY = 1e-12
"""Distance from an excluded limit: a nearer value may be the limit itself in single precision."""


@dataclass(frozen=True)
class Above(Within):
    """Numbers above `low`, by at least `TINY`, and up to `high`, which is included."""

    @property
    def least(self) -> float:
        """Smallest number that is allowed."""
        return self.low + TINY

    def allows(self, value: Any) -> bool:
        """Return whether the value lies within."""
        return value >= self.least and super().allows(value)

    def _limits(self) -> str:
        return f"above {_text(self.low)} and at most {_text(self.high)}"


@dataclass(frozen=True)
class Needs:
    """Condition under which a setting has an effect: a value of another setting of its class.

    To be used in an annotation.
    """

    setting: str
    values: tuple[Any, ...] = ()
    """Values that are needed; where there are none, any but None, False and 0."""
    why: str = ""
    """Reason to be read after "has no effect", where name and value of the other setting do not say
    it."""

    def unmet(self, settings: Any, group: str = "") -> str:
        """Return why the setting has no effect in an object; an empty text if it has one.

        Args:
            settings: the object.
            group: prefix of its settings in messages, such as `arena.`.
        """
        value = getattr(settings, self.setting)
        is_met = value in self.values if self.values else bool(value)
        if is_met:
            return ""
        if self.why:
            return self.why
        name = f"`{group}{self.setting}`"
        if not value:
            return f"without {name}"
        return f"with {name}" if value is True else f"with {name} {value}"


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
    """Return whether a value is a whole number of any type, but no Boolean."""
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def validate(settings: Any, group: str = "") -> None:
    """Check the fields of a dataclass against their types and their `Within`.

    To be called by `__post_init__`. Fields of named tuples in it are checked, too, since these have
    no `__post_init__`.

    Args:
        settings: the object.
        group: its name as part of a configuration, which precedes the fields' names in errors.

    Raises:
        ConfigError: a field is out of range, not one of a `Literal`'s values, or of another type.
            Whole numbers do as floats, and None where the type allows it. Of a tuple each element
            is checked.
    """
    for name, (kind, _) in _declared(type(settings)).items():
        value = getattr(settings, name)
        full_name = f"{group}.{name}" if group else name
        if kind is bool:
            check(full_name, value, "true or false", isinstance(value, bool))
        elif get_origin(kind) is Literal:
            words = get_args(kind)
            is_allowed = isinstance(value, str) and value in words
            check(full_name, value, " or ".join(words), is_allowed)
        elif isinstance(kind, type) and is_dataclass(kind):
            check_kind(full_name, value, kind)
        elif isinstance(kind, type) and hasattr(kind, "_fields"):
            check_kind(full_name, value, kind)
            validate(value, full_name)
        else:
            _check_numbers(full_name, value, kind, constraint_of(type(settings), name))


def _check_numbers(name: str, value: Any, kind: Any, constraint: Within | None) -> None:
    """Check a number, or each number of a tuple, against its limits, if it has any."""
    is_optional = type(None) in get_args(kind)
    if constraint is None or (is_optional and value is None):
        return
    if get_origin(kind) is tuple:
        check_kind(name, value, tuple)
        for element in value:
            _check_number(name, element, get_args(kind)[0], constraint)
    else:
        _check_number(name, value, kind, constraint)


def _check_number(name: str, value: Any, kind: Any, constraint: Within) -> None:
    """Check a number against its type and its limits."""
    must_be_whole = {*(get_args(kind) or [kind])} <= {int, type(None)}
    is_number = is_whole(value)
    if not must_be_whole:
        is_number |= isinstance(value, numbers.Real) and not isinstance(value, bool)

    if not (is_number and constraint.allows(value)):
        # The text is made here alone: it would take most of the time of a check.
        is_one_value = constraint.low == constraint.high
        kind_of_number = "a whole number " if must_be_whole and not is_one_value else ""
        raise ConfigError(name, value, f"{kind_of_number}{constraint}")


def spaced(text: str, most: int = 10_000) -> list[str]:
    """Return the numbers that START:STOP:COUNT describes, both ends included, as texts.

    Raises:
        ValueError: it is none, or there are more than `most`.
    """
    first, last, count = text.split(":")
    start = float(first)
    stop = float(last)
    n = int(count)
    if not 1 <= n <= most:
        raise ValueError(n)
    return [f"{start + (stop - start) * k / max(1, n - 1):.10g}" for k in range(n)]


def choices(cls: type, name: str) -> tuple[Any, ...]:
    """Return the values that a field of a dataclass may have whose type is a `Literal`.

    For a field of another type, and for no field, there are none.
    """
    kind, _ = _declared(cls).get(name, (None, ()))
    return get_args(kind) if get_origin(kind) is Literal else ()


def type_of(cls: type, name: str) -> Any:
    """Return the type of a field of a dataclass, without its annotations."""
    kind, _ = _declared(cls)[name]
    return kind


@functools.cache
def constraint_of(cls: type, name: str) -> Within | None:
    """Return the limits of a field of a dataclass, or of the elements of a tuple; None without
    any."""
    _, extras = _declared(cls).get(name, (None, ()))
    return next((extra for extra in extras if isinstance(extra, Within)), None)


def needs_of(cls: type, name: str) -> list[Needs]:
    """Return what a setting of a class needs in order to have an effect."""
    _, extras = _declared(cls).get(name, (None, ()))
    return [extra for extra in extras if isinstance(extra, Needs)]


@functools.cache
def _declared(cls: type) -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Return the type of each field, and what `Annotated` adds to it, by name."""
    annotated = get_type_hints(cls, include_extras=True)
    return {
        name: (kind, getattr(annotated[name], "__metadata__", ()))
        for name, kind in get_type_hints(cls).items()
    }


def _text(number: float) -> str:
    """Return a limit as text."""
    return str(number) if isinstance(number, int) else f"{number:g}"
