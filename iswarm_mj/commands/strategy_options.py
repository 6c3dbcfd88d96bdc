"""Flags of the strategy and the task that `--strategy` and `--task` name, made from the fields of their dataclasses."""

from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, field, fields, is_dataclass, make_dataclass
from typing import Annotated, Any

import tyro

from iswarm_mj.commands.arguments import flag_kinds
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.constraints import validate
from iswarm_mj.utils.errors import UserError

OWN, OWN_TASK = OWNS = "own", "own_task"
"""Fields of a command that hold the strategy and the task."""
_REPLACED = ("genome", "override")
"""Fields that say what the paper's strategy is."""


def with_own(command: Any, arguments: Sequence[str]) -> Any:
    """Return a command with the flags of the strategy and of the task that `--strategy` and `--task` name.

    Without these arguments it is returned as it is. The flags of the genome go where a strategy takes its place.

    Raises:
        UserError: there is no such strategy or task, or a flag of its has the name of another flag of the command; or
            a flag of the genome is among the arguments, although a strategy takes its place.
    """
    known = {f.name for f in fields(command)}
    if "controller" in known and (name := _named("--strategy", arguments)) is not None:
        from iswarm_mj.strategy.library import find_strategy
        from iswarm_mj.strategy.pytrees import check_methods

        found = find_strategy(name)
        if not isinstance(found, Genome):
            check_methods(found)
        genomes, command = command, _extended(command, OWN, found, _REPLACED)
        gone = dict(flag_kinds(genomes)).keys() - dict(flag_kinds(command)).keys()
        for flag in (argument.partition("=")[0] for argument in arguments):
            if flag.startswith("--") and flag[2:].replace("-", "_") in gone:
                raise UserError(f"{flag} has no effect with --strategy; leave it out")
    if "task_name" in known and (name := _named("--task", arguments)) is not None:
        from iswarm_mj.tasks.library import find_task
        from iswarm_mj.tasks.signatures import check_methods

        found = find_task(name)
        check_methods(found)
        command = _extended(command, OWN_TASK, found)
    return command


def _named(flag: str, arguments: Sequence[str]) -> str | None:
    """What the last of these flags among the arguments names."""
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(flag, nargs="?", dest="name")
    return parser.parse_known_args(list(arguments))[0].name


def _extended(command: Any, place: str, found: Any, replaced: Sequence[str] = ()) -> Any:
    """A command with a further field for a class, or an object whose values are defaults; some of its flags go."""
    known = {f.name: f for f in fields(command)}
    cls: Any = found if isinstance(found, type) else type(found)
    taken = {_flag(f) for f in known.values() if f.name not in replaced}
    taken |= {f.name for own in OWNS if own in known for f in fields(known[own].type.__origin__)}
    clashes = [f.name for f in fields(cls) if f.name in taken] if is_dataclass(cls) else []
    if clashes:
        raise UserError(
            f"{cls.__name__} has a field {clashes[0]}, but --{clashes[0].replace('_', '-')} is already a flag of "
            f"iswarm {command.__name__.lower()}; rename the field"
        )
    hidden = [
        (key, Annotated[known[key].type, tyro.conf.Suppress], _default(known[key])) for key in replaced if key in known
    ]
    own = (place, Annotated[cls, tyro.conf.arg(name="")], _own(cls, found))
    extended = make_dataclass(command.__name__, [*hidden, own], bases=(command,), frozen=True)
    extended.__doc__ = command.__doc__
    return extended


@contextmanager
def explained_flags(command: Any) -> Iterator[None]:
    """Explain exceptions of the classes of strategy and task while their objects are made of the flags.

    Raises:
        UserError: there was one.
    """
    named = {f.name for f in fields(command)}
    if not named.intersection(OWNS):
        yield
        return
    from iswarm_mj.strategy.user_code import user_code

    with user_code("the strategy" if OWN in named else "the task"):
        yield


def check_flags(given: Any) -> None:
    """Check the fields of a strategy or a task against their annotations, see `constraints.validate`.

    Raises:
        ConfigError: a value is out of range.
    """
    if is_dataclass(given):
        validate(given)


def _own(cls: Any, found: Any) -> Any:
    """Field of the command for a strategy or task: its default, or none if it has parameters that must be given."""
    from iswarm_mj.strategy.user_code import user_code

    def make() -> Any:
        with user_code(cls.__name__):
            return cls()

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
    return {"controller": "strategy", "task_name": "task"}.get(f.name) or f.name
