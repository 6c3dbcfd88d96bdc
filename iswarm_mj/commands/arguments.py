"""Arguments before they are parsed: the file of `--config`, words for Booleans, flags with a choice of words."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import tyro

from iswarm_mj.utils.errors import ConfigError, UserError

WORDS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
"""What stands for a Boolean, in any case of letters."""
_POSITIONAL = get_args(tyro.conf.Positional[str])[1:]


def flag_kinds(command: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Names of a command's flags, as `arena.n_dust`, and their types, without its positional arguments."""
    hints = get_type_hints(command, include_extras=True)
    for f in fields(command):
        kind, extras = hints[f.name], getattr(hints[f.name], "__metadata__", ())
        if tyro.conf.Suppress in extras:
            continue
        if get_origin(kind) is Annotated:
            kind = get_args(kind)[0]
        named = [extra.name for extra in extras if getattr(extra, "name", None) is not None]
        name = named[-1] if named else f.name
        group = kind if is_dataclass(kind) else type(f.default_factory()) if callable(f.default_factory) else None
        if isinstance(kind, type) and hasattr(kind, "_fields"):  # a named tuple
            yield from ((f"{prefix}{name}.{part}", of) for part, of in get_type_hints(kind).items())
        elif group is not None and is_dataclass(group):
            yield from flag_kinds(group, f"{prefix}{name}." if name else prefix)
        elif not set(_POSITIONAL) & set(extras):
            yield f"{prefix}{name}", kind


def with_booleans(kinds: Mapping[str, Any], arguments: Sequence[str]) -> list[str]:
    """Return arguments in which a Boolean's word has become the parser's: `--record false` is `--no-record`."""
    found: list[str] = []
    left = list(arguments)
    while left:
        argument = left.pop(0)
        flag, equals, value = argument.partition("=")
        name = flag.removeprefix("--").replace("-", "_")
        options = {kinds.get(name), *get_args(kinds.get(name))} if flag.startswith("--") else set()
        if bool in options and not equals and left and left[0].lower() in WORDS:
            value = left.pop(0)
        if bool not in options or value.lower() not in WORDS:
            found.append(argument)
        elif type(None) in options:
            found.append(f"{flag}={WORDS[value.lower()]}")
        else:
            found.append(flag if WORDS[value.lower()] else negated(flag))
    return found


def check_choices(kinds: Mapping[str, Any], arguments: Sequence[str]) -> None:
    """Check the words of flags that allow only some.

    Raises:
        ConfigError: one is not among them.
    """
    for argument, after in zip_longest(arguments, arguments[1:]):
        flag, equals, value = argument.partition("=")
        kind = kinds.get(flag.removeprefix("--").replace("-", "_")) if flag.startswith("--") else None
        given = value if equals else after
        options = [of for of in (kind, *get_args(kind)) if get_origin(of) is Literal]
        if not options or given is None or given.startswith("--"):
            continue
        allowed = [str(word) for of in options for word in get_args(of)]
        allowed += ["None"] * (type(None) in get_args(kind))
        if given not in allowed:
            raise ConfigError(flag.replace("_", "-"), given, " or ".join(allowed))


def negated(flag: str) -> str:
    """Return the flag that switches another one off: `--arena.no-x` of `--arena.x`."""
    group, dot, name = flag.removeprefix("--").rpartition(".")
    return f"--{group}{dot}no-{name}"


def without_config(arguments: Sequence[str]) -> tuple[list[str], Path | None]:
    """Return the arguments without `--config FILE`, and the file, if there is one.

    Raises:
        UserError: there is no name, or there are two.
    """
    left, given, paths = list(arguments), [], []
    while left:
        argument = left.pop(0)
        if argument == "--config":
            if not left:
                raise UserError("--config needs the name of a TOML file or of a result.json.")
            paths.append(left.pop(0))
        elif argument.startswith("--config="):
            paths.append(argument.partition("=")[2])
        else:
            given.append(argument)
    if len(paths) > 1:
        raise UserError(f"--config is given {len(paths)} times; put all into one file.")
    return given, Path(paths[0]) if paths else None
