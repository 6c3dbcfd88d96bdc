"""Sentences on flags that a command does not have, and on values that are no numbers."""

import difflib
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

from iswarm_mj.commands.arguments import negated
from iswarm_mj.utils.errors import ConfigError, UserError


def misspelt(kinds: Mapping[str, Any], arguments: Sequence[str]) -> list[str]:
    """Return the flags among arguments that a command does not have.

    Args:
        kinds: names of its flags and their types.
        arguments: its own; what follows a flag may begin with a single dash.
    """
    known = {f"--{name}" for name in kinds} | {negated(f"--{name}") for name, kind in kinds.items() if kind is bool}
    known = {_name(flag) for flag in known}
    found = []
    for before, argument in pairwise(["", *arguments]):
        if argument == "--":
            break
        is_value = not argument.startswith("--") and (before.startswith("--") or _is(float, argument))
        if argument.startswith("-") and argument != "-" and not is_value and _name(argument) not in known:
            found.append(argument)
    return found


def unknown(command: str, names: Collection[str], left: Sequence[str]) -> UserError:
    """Return the error for arguments that a command does not know.

    Args:
        command: its name.
        names: of its flags, as `arena.n_dust`.
        left: the arguments that the parser left, at least one.
    """
    given = next((argument.partition("=")[0] for argument in left if argument.startswith("-")), left[0])
    listed = f"`iswarm {command} --help-all` lists all flags"
    if not given.startswith("-"):
        return UserError(f"iswarm {command} does not know what {given!r} is for; {listed}.")
    flags = sorted((f"--{name.replace('_', '-')}" for name in names), key=len)
    word = given.replace("_", "-")
    near = [flag for flag in flags if len(word) > 2 and flag.startswith(word)]
    near = near or difflib.get_close_matches(word, flags, n=1)
    meant = f"; perhaps you meant {near[0]}" if near else ""
    return UserError(f"{given} is not a flag of iswarm {command}{meant}; {listed}.")


def check_numbers(kinds: Mapping[str, Any], arguments: Sequence[str]) -> None:
    """Check the values of flags that take numbers.

    Raises:
        ConfigError: one is missing, or is no number.
    """
    for place, argument in enumerate(arguments):
        flag, equals, value = argument.partition("=")
        kind = kinds.get(_name(flag)) if flag.startswith("--") else None
        number, size, is_one = _numbers(kind)
        if number is None:
            continue
        what = "whole number" if number is int else "number"
        constraint = f"a {what}" if is_one else f"lists of {size} {what}s" if size > 1 else f"{what}s"
        values = [value] if equals else _values(arguments[place + 1 :])[: 1 if is_one else None]
        if not values and is_one:
            raise UserError(f"{flag} needs {constraint}.")
        is_read = all(_is(number, word) for word in values) and (equals or len(values) % size == 0)
        if not is_read and not (values == ["None"] and NoneType in get_args(kind)):
            raise ConfigError(flag.replace("_", "-"), " ".join(values), constraint)


def _numbers(kind: Any) -> tuple[type | None, int, bool]:
    """The type of a flag's numbers, how many belong together, and whether it takes one value only."""
    options = [of for of in get_args(kind) if of is not NoneType]
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        inner = get_args(parts[0]) if get_origin(parts[0]) is tuple else parts[:1]
        number, size = inner[0], len(inner)
        is_list = parts[1:] == (...,) and set(inner) == {number}
        return (number if is_list and number in (int, float) else None), size, False
    if len(options) == 1 and NoneType in get_args(kind):
        (kind,) = options
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    return (kind if kind in (int, float) else None), 1, True


def _name(argument: str) -> str:
    """Name of a flag among those of `arguments.flag_kinds`."""
    return argument.partition("=")[0].removeprefix("--").replace("-", "_")


def _values(arguments: Sequence[str]) -> list[str]:
    """The arguments before the next flag."""
    found = []
    for argument in arguments:
        if argument.startswith("-") and not _is(float, argument):
            break
        found.append(argument)
    return found


def _is(number: type, word: str) -> bool:
    try:
        number(word)
    except ValueError:
        return False
    return True
