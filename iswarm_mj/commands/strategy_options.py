"""Flags of the strategy that `--strategy` names, made from the fields of its dataclass."""

from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, field, fields, is_dataclass, make_dataclass
from typing import Annotated, Any

import tyro

from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.constraints import validate
from iswarm_mj.utils.errors import ConfigError, UserError

OWN = "own"
"""Field of a command that holds the strategy."""
_REPLACED = ("genome", "override")
"""Fields that say what the paper's strategy is."""


def with_strategy(command: Any, arguments: Sequence[str]) -> Any:
    """Return a command with the flags of the strategy that `--strategy` among the arguments names, else as it is.

    The flags of the genome go, since the strategy takes its place.

    Raises:
        UserError: there is no such strategy, or a flag of its has the name of a flag of the command.
    """
    if "controller" not in (known := {f.name: f for f in fields(command)}):
        return command
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--strategy", nargs="?")
    name = parser.parse_known_args(list(arguments))[0].strategy
    if name is None:
        return command
    from iswarm_mj.strategy.library import find_strategy
    from iswarm_mj.strategy.pytrees import check_methods

    found = find_strategy(name)
    cls: Any = found if isinstance(found, type) else type(found)
    if cls is not Genome:
        check_methods(found)
    taken = {_flag(f) for f in known.values() if f.name not in _REPLACED}
    clashes = [f.name for f in fields(cls) if f.name in taken] if is_dataclass(cls) else []
    if clashes:
        raise UserError(
            f"{cls.__name__} has a field {clashes[0]}, but --{clashes[0].replace('_', '-')} is already a flag of "
            f"iswarm {command.__name__.lower()}; rename the field"
        )
    hidden = [(key, Annotated[known[key].type, tyro.conf.Suppress], _default(known[key])) for key in _REPLACED]
    own = (OWN, Annotated[cls, tyro.conf.arg(name="")], _own(cls, found))
    extended = make_dataclass(command.__name__, [*hidden, own], bases=(command,), frozen=True)
    extended.__doc__ = command.__doc__
    return extended


@contextmanager
def explained_flags(command: Any) -> Iterator[None]:
    """Explain exceptions of the strategy's own class while its object is made of the flags.

    Raises:
        UserError: there was one.
    """
    if not any(f.name == OWN for f in fields(command)):
        yield
        return
    from iswarm_mj.strategy.explain import explained

    with explained("the strategy"):
        yield


def check_flags(strategy: Any) -> None:
    """Check the fields of a strategy against their annotations, see `constraints.validate`.

    Raises:
        ConfigError: a value is out of range; the error calls the field by its flag.
    """
    if not is_dataclass(strategy):
        return
    try:
        validate(strategy)
    except ConfigError as error:
        raise ConfigError(f"--{error.field.replace('_', '-')}", error.value, error.constraint, error.remedy) from None


def _own(cls: Any, found: Any) -> Any:
    """Field of the command for a strategy: its default, or none if it has parameters that must be given."""
    make: Any = cls
    if found is not cls:
        return field(default=found)
    if is_dataclass(cls) and any(f.default is MISSING and f.default_factory is MISSING for f in fields(cls) if f.init):
        return field(default=tyro.MISSING)
    return field(default_factory=make)


def _default(f: Any) -> Any:
    factory: Any = f.default_factory
    return field(default_factory=factory) if f.default is MISSING else field(default=f.default)


def _flag(f: Any) -> str:
    """Name of a field's flag."""
    return "strategy" if f.name == "controller" else f.name
