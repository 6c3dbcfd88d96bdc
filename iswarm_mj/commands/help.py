"""What `--help` and `--help-all` show: flags with their ranges and units, made of the fields and their annotations."""

import re
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, make_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import tyro

from iswarm_mj.utils.constraints import constraint_of
from iswarm_mj.utils.docstrings import field_docs

HELP, HELP_ALL = ("-h", "--help"), "--help-all"
_UNIT = re.compile(r"\s*\[[^\]]*\]\.?$")
_SENTENCE = re.compile(r"(?<=[a-z0-9)\]`])\. ")
_MANY = 12
"""Flags of a command that all are shown by `--help`."""


@dataclass(frozen=True)
class Common:
    """Flags that each command has."""

    config_file: Annotated[Path | None, tyro.conf.arg(name="config", metavar="FILE")] = None
    """Defaults of all flags: a TOML file, or the result.json of an earlier run."""
    help_all: tyro.conf.FlagCreatePairsOff[bool] = False
    """Show all flags, with their groups."""


def shown(command: type, arguments: Sequence[str]) -> tuple[type, list[str]] | None:
    """Return a class to parse in place of a command, and its arguments, if these ask for help; else None."""
    asked = [argument for argument in arguments if argument in (*HELP, HELP_ALL)]
    return None if not asked else (described(command, HELP_ALL in asked), ["--help"])


def described(command: type, everything: bool = True) -> type:
    """Return a command's flags for its help: each with range and unit, and only the main ones unless `everything`.

    The main flags are those that the class names as `MAIN`; all, where it names none and there are few.
    """
    known = [f.name for f in fields(command)]
    main = getattr(command, "MAIN", known if len(known) <= _MANY else ())
    all_of_it = everything or set(known) <= set(main)
    chosen = known if all_of_it else [*main, "own", "own_task"]
    listed = [_described(command, f, all_of_it) for f in fields(command) if f.name in chosen]
    common = [(f.name, _annotated(Common, f, True), _default(f)) for f in fields(Common)]
    if all_of_it:
        common = common[:1] if not everything else []
    # The order of the flags is that of MAIN where not all are shown.
    place = {name: k for k, name in enumerate(main)}
    listed.sort(key=lambda spec: 0 if all_of_it else place.get(spec[0], len(place)))
    cls = make_dataclass(command.__name__, [*listed, *common], frozen=True, kw_only=True)
    cls.__doc__ = command.__doc__
    return cls


def _described(owner: type, f: Any, everything: bool) -> tuple[str, Any, Any]:
    """Name, annotation and default of a field for the help."""
    annotation = get_type_hints(owner, include_extras=True)[f.name]
    kind = get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation
    default = _default(f)
    value = f.default_factory() if f.default_factory is not MISSING else f.default
    if isinstance(kind, type) and hasattr(kind, "_fields"):
        kind, value = _of_named_tuple(kind), _of_named_tuple(kind)(*value)
    if not is_dataclass(value) and not is_dataclass(kind):
        return f.name, _annotated(owner, f, everything), default
    group: Any = kind if isinstance(value, type) or not is_dataclass(value) else type(value)
    members = [_described(group, g, everything) for g in fields(group)]
    inner = make_dataclass(group.__name__, members, frozen=True, kw_only=True)
    inner.__doc__ = group.__doc__
    extras = getattr(annotation, "__metadata__", ())
    shown_values = {g.name: getattr(value, g.name) for g in fields(group)} if is_dataclass(value) else None
    factory = field(default_factory=lambda: inner(**shown_values)) if shown_values is not None else default
    return f.name, _with(inner, extras), factory


def _of_named_tuple(kind: type) -> type:
    """Return a dataclass with the fields of a named tuple."""
    defaults = getattr(kind, "_field_defaults", {})
    named = [
        (name, hint, field(default=defaults.get(name, MISSING)))
        for name, hint in get_type_hints(kind, include_extras=True).items()
    ]
    return make_dataclass(kind.__name__, named, namespace={"described_by": kind, "__doc__": kind.__doc__}, frozen=True)


def _annotated(owner: type, f: Any, everything: bool) -> Any:
    """Annotation of a flag for the help: its text, range, unit and default."""
    annotation = get_type_hints(owner, include_extras=True)[f.name]
    extras = getattr(annotation, "__metadata__", ())
    kind = get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation
    constraint = constraint_of(getattr(owner, "described_by", owner), f.name) or constraint_of(owner, f.name)
    text = field_docs(getattr(owner, "described_by", owner)).get(f.name)
    if text is None and constraint is not None and constraint.source is not None:  # the setting that the flag sets
        text = field_docs(constraint.source[0])[constraint.source[1]]
    text = text or ""
    text = _UNIT.sub(".", text) if constraint is not None and constraint.unit else text
    if not everything:
        text = _SENTENCE.split(text)[0].rstrip(".") + "."
    limits = "" if constraint is None else str(constraint).split(", since")[0]

    def hint(default: str) -> str:
        facts = [limits, "" if default in ("None", "") or owner is Common else f"default {default}"]
        return f"({'; '.join(filter(None, facts))})" if any(facts) else ""

    settings: dict[str, Any] = {"help": text.strip(". ") and text, "help_behavior_hint": hint}
    metavar = _metavar(kind)
    if metavar:
        settings["metavar"] = metavar
    return _with(kind, (tyro.conf.arg(**settings), *extras))


def _metavar(kind: Any) -> str:
    """What stands for the value of an optional flag; nothing for others, of which tyro knows."""
    options = get_args(kind)
    if type(None) not in options:
        return ""
    (inner, *_) = [option for option in options if option is not type(None)]
    if inner is bool:
        return "{true,false}"
    if get_origin(inner) is Literal:
        return "{" + ",".join(map(str, get_args(inner))) + "}"
    return getattr(inner, "__name__", "value").upper()


def _with(kind: Any, extras: tuple[Any, ...]) -> Any:
    for extra in extras:
        kind = Annotated[kind, extra]
    return kind


def _default(f: Any) -> Any:
    if f.default_factory is not MISSING:
        return field(default_factory=f.default_factory)
    return field(default=tyro.MISSING if f.default is MISSING else f.default)
