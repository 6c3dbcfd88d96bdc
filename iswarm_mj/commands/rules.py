"""How tyro makes flags of settings: with their ranges and units, the main ones alone where help is short."""

from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_type_hints

import tyro
from tyro.constructors import (
    MISSING_NONPROP,
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from iswarm_mj.engines.settings import Devices
from iswarm_mj.utils.constraints import constraint_of, validate
from iswarm_mj.utils.docstrings import field_docs
from iswarm_mj.utils.jax_setup import devices


class Common(NamedTuple):
    """Flags that each command has; `parser.parse` has used them."""

    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Defaults of all flags: a TOML file, or the result.json of an earlier run."""
    help_all: tyro.conf.FlagCreatePairsOff[bool] = False
    """Show all flags, with their groups."""


class TeamFlags(NamedTuple):
    """Teams that arguments name; the values of their strategies' flags are still to come."""

    teams: dict[str, tuple[float | int, Any]]
    """Share, and class or object, by name."""

    @property
    def strategies(self) -> dict[str, Any]:
        """Class or object by name."""
        return {name: found for name, (_, found) in self.teams.items()}

    def struct(self) -> StructConstructorSpec:
        """Flags of the strategies, with the names of the teams before them."""
        from iswarm_mj.strategy.teams import Teams

        def make(**given: Any) -> Any:
            return Teams({name: (share, given[name]) for name, (share, _) in self.teams.items()})

        return StructConstructorSpec(make, tuple(_own(*one, tyro.conf.arg()) for one in self.strategies.items()))


class Rules(ConstructorRegistry):
    """Rules for one command.

    Args:
        command: class of its flags; `MAIN` names the main ones, of a few all are.
        own: classes or objects, whose values are defaults, that take the places of its fields of these names.
        everything: whether there are all flags, or the main ones.
        has_strategy: whether a strategy was named, which takes the place of the genome.
    """

    def __init__(self, command: type, own: dict[str, Any], everything: bool = True, has_strategy: bool = False):
        super().__init__()
        self._main = () if everything else getattr(command, "MAIN", ())
        self._command, self._own, self._has_strategy = command, own, has_strategy
        teams = [found for one in own.values() if isinstance(one, TeamFlags) for found in one.strategies.values()]
        self._found = [*own.values(), *teams]
        self.struct_rule(self._struct)
        self.primitive_rule(_path)
        self.primitive_rule(_devices)

    def _struct(self, info: StructTypeInfo) -> StructConstructorSpec | None:
        """Flags of a dataclass or a named tuple."""
        cls: Any = info.type
        own = next((one for one in self._found if cls in (one, type(one))), None)
        if own is None and not (isinstance(cls, type) and (is_dataclass(cls) or hasattr(cls, "_fields"))):
            return None
        if cls is self._command:
            return self._of_command(info.default)
        if isinstance(own, TeamFlags):
            return own.struct()
        default = info.default
        if own is not None and not isinstance(own, type) and not is_dataclass(own):  # whole, as a learned policy
            return StructConstructorSpec(lambda: default, ())
        made = [_flag(cls, *member) for member in _members(cls, default)]
        return StructConstructorSpec(cls if own is None else _explained(cls), tuple(made))

    def _of_command(self, default: Any) -> StructConstructorSpec:
        hidden = {"own", "own_task", "physics"}
        if self._main and self._has_strategy:
            hidden.add("genome")
        made = {
            name: _flag(self._command, name, kind, usual)
            for name, kind, usual in _members(self._command, default)
            if name not in hidden and (not self._main or name in self._main)
        }
        made = {name: made[name] for name in self._main or made if name in made}
        for name, found in self._own.items():
            made[name] = _own(name, found, tyro.conf.arg(name=""))
        common = [_flag(Common, *member) for member in _members(Common, None)]
        shown = common if self._main else common[:1]

        def command(**given: Any) -> Any:
            return self._command(**{name: value for name, value in given.items() if name not in Common._fields})

        return StructConstructorSpec(command, (*made.values(), *shown))


def _members(cls: Any, default: Any) -> Iterator[tuple[str, Any, Any]]:
    """Name, annotation and default of each field of a dataclass or a named tuple; none of another class."""
    hints = get_type_hints(cls, include_extras=True)
    usual: dict[str, Any] = dict(getattr(cls, "_field_defaults", {}))
    for f in fields(cls) if is_dataclass(cls) else ():
        usual[f.name] = f.default if f.default_factory is MISSING else f.default_factory()
    for name in [f.name for f in fields(cls) if f.init] if is_dataclass(cls) else getattr(cls, "_fields", ()):
        value = getattr(default, name) if type(default) is cls else usual.get(name, MISSING)
        yield name, hints[name], MISSING_NONPROP if value is MISSING else value


def _own(name: str, found: Any, how: object) -> StructFieldSpec:
    """The flags of a class, or of an object whose values are defaults."""
    cls: Any = found if isinstance(found, type) else type(found)
    return StructFieldSpec(name, _annotated(cls, how), MISSING_NONPROP if found is cls else found)


def _flag(cls: Any, name: str, kind: Any, default: Any) -> StructFieldSpec:
    """A flag with its text, range, unit and default."""
    limits, text = constraint_of(cls, name), field_docs(cls).get(name, "")

    def hint(shown: str) -> str:
        has_default = shown not in ("None", "") and cls is not Common
        facts = [str(limits or "").split(", since")[0], f"default {shown}" * has_default]
        return f"({'; '.join(filter(None, facts))})" * any(facts)

    return StructFieldSpec(name, _annotated(kind, tyro.conf.arg(help_behavior_hint=hint)), default, text)


def _annotated(kind: Any, extra: object) -> Any:
    return Annotated[kind, extra]


def _explained(cls: type) -> Callable[..., Any]:
    """What makes a strategy, a task or an engine: the values are checked, and errors of its own code explained."""
    from iswarm_mj.strategy.user_code import user_code

    def make(**given: Any) -> Any:
        with user_code(cls.__name__):
            made = cls(**given)
        if is_dataclass(made):
            validate(made)
        return made

    return make


def _path(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec | None:
    """Names of files; none is empty, which would be the working directory."""
    if info.type is not Path:
        return None

    def read(words: list[str]) -> Path:
        if not words[0] or "\0" in words[0]:
            raise ValueError("it must be the name of a file or directory, `.` for this one")
        return Path(words[0])

    return PrimitiveConstructorSpec(1, "PATH", read, lambda value: isinstance(value, Path), lambda value: [str(value)])


def _devices(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec | None:
    """Devices of JAX by their number, or all."""
    if info.type != Devices:
        return None

    def read(words: list[str]) -> Devices:
        return tuple(devices(words[0]))

    def shown(value: Any) -> list[str]:
        return ["all" if value is None else str(len(value))]

    return PrimitiveConstructorSpec(1, "all|INT", read, lambda value: value is None or isinstance(value, tuple), shown)
