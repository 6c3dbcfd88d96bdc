"""Rules by which tyro makes the flags of a command, with their ranges, units and defaults.

Tyro asks for the flags of each type that it meets: the class of the command, the groups of its
settings, and the plug-ins (engine, strategy and task), which arguments choose. `TyroRules` answers.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
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

from iswarm_mj.commands.command_settings import PART_OF_FIELD
from iswarm_mj.commands.flags import flag
from iswarm_mj.config.setting_names import setting_names
from iswarm_mj.engines.settings import Devices
from iswarm_mj.utils.constraints import constraint_of, validate
from iswarm_mj.utils.docstrings import field_docs
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.jax_setup import devices


class CommonFlags(NamedTuple):
    """Flags that each command has, and that `parser.parse` has used before tyro reads them."""

    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Defaults of all flags: a TOML file, or the result.json of an earlier run."""
    help_all: tyro.conf.FlagCreatePairsOff[bool] = False
    """Show all flags, with their groups."""


class TeamFlags(NamedTuple):
    """Teams that arguments name, before the values of their strategies are read."""

    shares: dict[str, float | int]
    """Share or number of robots by the name of the team."""
    strategies: dict[str, Any]
    """Class of the strategy, or object that has the defaults, by the name of the team."""


class ShortHelp(NamedTuple):
    """Contents of short help, beside the flags that `MAIN` of the command names."""

    plugins: Collection[str]
    """Fields of the plug-ins whose flags it shows: those that arguments name."""
    names_strategy: bool
    """Arguments name a strategy, which takes the place of the genome: --genome is left out."""


class TyroRules(ConstructorRegistry):
    """Rules for the flags of one command.

    Args:
        command_class: dataclass of its flags. Its `MAIN` lists those of short help in their order;
            a command without it shows all of them there. A command whose `HAS_CONFIG` is false
            takes no `--config`.
        plugins: classes, or objects that have the defaults, by the fields of the command that will
            hold them.
        short_help: contents of the help that is to be printed; None where all flags are shown, or
            are read.
    """

    def __init__(
        self, command_class: type, plugins: dict[str, Any], short_help: ShortHelp | None = None
    ):
        super().__init__()
        self._command_class = command_class
        self._main = getattr(command_class, "MAIN", ())
        self._has_config = getattr(command_class, "HAS_CONFIG", True)
        self._short_help = short_help if self._main else None
        self._plugins = plugins
        if short_help is not None:
            self._plugins = {name: plugins[name] for name in short_help.plugins}
        self._flag_names = _flag_names_by_class(self._plugins, _names_of_settings(plugins))

        self.struct_rule(self._struct)
        self.primitive_rule(_path)
        self.primitive_rule(_devices)

    def _struct(self, info: StructTypeInfo) -> StructConstructorSpec | None:
        """Return the flags of a type; None leaves it to tyro's own rules."""
        cls: Any = info.type
        default: Any = info.default
        if not isinstance(cls, type):
            return None
        if cls is self._command_class:
            return self._command_flags(default)
        if cls is TeamFlags:
            return _team_flags(default)
        if cls in self._flag_names:
            return _plugin_flags(cls, default, self._flag_names[cls])
        if _has_fields(cls):
            return StructConstructorSpec(cls, _flags_of_fields(cls, default))
        return None

    def _command_flags(self, default: Any) -> StructConstructorSpec:
        """Return the flags of the command, those of its plug-ins included."""
        flags = {}
        for spec in _flags_of_fields(self._command_class, default):
            if spec.name not in PART_OF_FIELD:
                flags[spec.name] = spec

        common_flags = {spec.name: spec for spec in _flags_of_fields(CommonFlags, None)}
        if not self._has_config:
            del common_flags["config"]
        if self._short_help is None:
            del common_flags["help_all"]  # it would show no more
        else:
            flags = self._flags_of_short_help(flags, self._short_help)

        # The empty name leaves out the prefix: `--range`, not `--task-plugin.range`.
        without_prefix = tyro.conf.arg(name="")
        for name, plugin in self._plugins.items():
            flags[name] = _field_of_plugin(name, plugin, without_prefix)

        def make(**values: Any) -> Any:
            for name in common_flags:
                del values[name]
            return self._command_class(**values)

        return StructConstructorSpec(make, (*flags.values(), *common_flags.values()))

    def _flags_of_short_help(
        self, flags: dict[str, StructFieldSpec], short_help: ShortHelp
    ) -> dict[str, StructFieldSpec]:
        """Return the flags that short help shows of a command, in the order of its `MAIN`."""
        names: list[str] = list(self._main)
        if short_help.names_strategy and "genome" in names:
            names.remove("genome")
        return {name: flags[name] for name in names if name in flags}


def _has_fields(cls: type) -> bool:
    """Return whether a class is a dataclass or a named tuple."""
    return is_dataclass(cls) or hasattr(cls, "_fields")


class _Field(NamedTuple):
    """A field of a dataclass or of a named tuple."""

    name: str
    annotation: Any
    default: Any
    """Default; `MISSING_NONPROP`, tyro's word for it, where a value must be given."""


def _fields_of(cls: Any, owner: Any) -> Iterator[_Field]:
    """Yield the fields of a dataclass or a named tuple; a class that is neither has none.

    Args:
        cls: the class.
        owner: an object of this class, whose values are the defaults; anything else leaves those
            that the class declares.
    """
    annotations = get_type_hints(cls, include_extras=True)
    defaults: dict[str, Any] = dict(getattr(cls, "_field_defaults", {}))
    names = getattr(cls, "_fields", ())
    if is_dataclass(cls):
        names = [field.name for field in fields(cls) if field.init]
        for field in fields(cls):
            if field.default_factory is MISSING:
                defaults[field.name] = field.default
            else:
                defaults[field.name] = field.default_factory()

    for name in names:
        value = defaults.get(name, MISSING)
        if type(owner) is cls:
            value = getattr(owner, name)
        yield _Field(name, annotations[name], MISSING_NONPROP if value is MISSING else value)


def _names_of_settings(plugins: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the names of the settings of each plug-in by its fields.

    A setting has its part in its name where another plug-in has a field of this name.

    Args:
        plugins: classes, or objects that have the defaults, by the fields that hold them.
    """
    parts = {PART_OF_FIELD[field_name]: plugin for field_name, plugin in plugins.items()}
    names: dict[str, dict[str, str]] = {part: {} for part in parts}
    for name, setting in setting_names(parts).items():
        names[setting.part][setting.field] = name
    return {field_name: names[PART_OF_FIELD[field_name]] for field_name in plugins}


def _flag_names_by_class(
    plugins: dict[str, Any], names: dict[str, dict[str, str]]
) -> dict[type, Mapping[str, str]]:
    """Return the names of settings by their fields, for each class that tyro meets in plug-ins.

    Strategies of teams are among these classes. Their settings are called by their fields, and
    tyro puts the name of the team before them.

    Args:
        plugins: plug-ins that have flags, by the fields that hold them.
        names: names of the settings by their fields, by the fields that hold the plug-ins.
    """
    flag_names: dict[type, Mapping[str, str]] = {}
    for field_name, plugin in plugins.items():
        if isinstance(plugin, TeamFlags):
            for strategy in plugin.strategies.values():
                flag_names[_class_of(strategy)] = {}
        else:
            flag_names[_class_of(plugin)] = names[field_name]
    return flag_names


def _class_of(plugin: Any) -> type:
    """Return the class of a plug-in, which is a class or an object."""
    return plugin if isinstance(plugin, type) else type(plugin)


def _field_of_plugin(name: str, plugin: Any, argument: object) -> StructFieldSpec:
    """Return the field in which tyro puts a plug-in, and below which it has its flags.

    Args:
        name: name of the field.
        plugin: a class, or an object whose values are the defaults.
        argument: name and text of the group of flags, from `tyro.conf.arg`.
    """
    default = MISSING_NONPROP if isinstance(plugin, type) else plugin
    return StructFieldSpec(name, _annotated(_class_of(plugin), argument), default)


def _plugin_flags(cls: type, default: Any, flag_names: Mapping[str, str]) -> StructConstructorSpec:
    """Return the flags of an engine, a task or a strategy, and a function of their values for it.

    Args:
        cls: class of the plug-in.
        default: object that has the defaults, if there is one.
        flag_names: names of its settings by its fields.
    """
    # Only dataclasses have settings. Another object, such as a learned policy, stays as it is.
    if type(default) is cls and not is_dataclass(cls):
        return StructConstructorSpec(lambda: default, ())
    flags = _flags_of_fields(cls, default, flag_names)
    return StructConstructorSpec(_checked_constructor(cls, flag_names), flags)


def _team_flags(teams: TeamFlags) -> StructConstructorSpec:
    """Return the flags of the strategies of teams, each below the name of its team."""
    from iswarm_mj.strategy.teams import Teams  # it imports JAX, which help does without

    def make(**strategies: Any) -> Any:
        return Teams({name: (share, strategies[name]) for name, share in teams.shares.items()})

    as_named = tyro.conf.arg()  # `--Walk.range` for the team Walk
    strategies = [
        _field_of_plugin(name, strategy, as_named) for name, strategy in teams.strategies.items()
    ]
    return StructConstructorSpec(make, tuple(strategies))


def _flags_of_fields(
    cls: Any, default: Any, flag_names: Mapping[str, str] | None = None
) -> tuple[StructFieldSpec, ...]:
    """Return a flag of each field, with its text, range, unit and default.

    Args:
        cls: dataclass or named tuple.
        default: object of it that has the defaults, if there is one.
        flag_names: names of the settings by their fields, where they may differ from these.
    """
    names = flag_names or {}
    return tuple(
        _flag(cls, field, names.get(field.name, field.name)) for field in _fields_of(cls, default)
    )


def _flag(cls: Any, field: _Field, setting: str) -> StructFieldSpec:
    """Return the flag of a field.

    Args:
        cls: dataclass or named tuple that has the field.
        field: the field.
        setting: name of the setting.
    """
    limits = str(constraint_of(cls, field.name) or "").split(", since")[0]
    text = field_docs(cls).get(field.name, "")

    def hint(shown_default: str) -> str:
        """Return what stands in brackets after the text; tyro states the default."""
        facts = [limits] if limits else []
        if shown_default not in ("None", "") and cls is not CommonFlags:
            facts.append(f"default {shown_default}")
        return f"({'; '.join(facts)})" if facts else ""

    # Without a name here, tyro takes that of the field.
    flag_name = None
    if setting != field.name:
        flag_name = flag(setting).removeprefix("--")
    argument = tyro.conf.arg(name=flag_name, help_behavior_hint=hint)
    return StructFieldSpec(field.name, _annotated(field.annotation, argument), field.default, text)


def _annotated(annotation: Any, argument: object) -> Any:
    """Return an annotation that tells tyro more about a flag.

    It is a function of its own for type checkers, which take `Annotated[...]` for no value.
    """
    return Annotated[annotation, argument]


def _checked_constructor(cls: type, flag_names: Mapping[str, str]) -> Callable[..., Any]:
    """Return a function that makes a strategy, a task or an engine, and checks its values.

    Errors of a user's code name its line, and errors of values the flag.

    Args:
        cls: class of the plug-in.
        flag_names: names of its settings by its fields.
    """
    from iswarm_mj.utils.user_code import user_code

    def make(**values: Any) -> Any:
        try:
            with user_code(cls.__name__):
                plugin = cls(**values)
            if is_dataclass(plugin):
                validate(plugin)
        except ConfigError as error:
            name = flag_names.get(error.field, error.field)
            raise ConfigError(name, error.value, error.constraint, error.remedy) from None
        return plugin

    return make


def _path(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec | None:
    """Return how names of files are read: none is empty, which would be the working directory."""
    if info.type is not Path:
        return None

    def read(words: list[str]) -> Path:
        if not words[0] or "\0" in words[0]:
            raise ValueError("it must be the name of a file or directory, `.` for this one")
        return Path(words[0])

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="PATH",
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, Path),
        str_from_instance=lambda value: [str(value)],
    )


def _devices(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec | None:
    """Return how devices of JAX are read: by their number, or all."""
    if info.type != Devices:
        return None

    def read(words: list[str]) -> Devices:
        return tuple(devices(words[0]))

    def shown(value: Any) -> list[str]:
        return ["all" if value is None else str(len(value))]

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="all|INT",
        instance_from_str=read,
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=shown,
    )
