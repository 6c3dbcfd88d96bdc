"""Rules by which tyro makes the flags of a command, with their ranges, units and defaults."""

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

    teams: dict[str, tuple[float | int, Any]]
    """Share or number of robots, and class or object of the strategy, by the name of the team."""

    @property
    def strategies(self) -> dict[str, Any]:
        """Class or object of the strategy by the name of the team."""
        return {name: strategy for name, (_, strategy) in self.teams.items()}

    def struct(self) -> StructConstructorSpec:
        """Return the flags of the strategies, each below the name of its team."""
        from iswarm_mj.strategy.teams import Teams

        def make(**strategies: Any) -> Any:
            return Teams(
                {name: (share, strategies[name]) for name, (share, _) in self.teams.items()}
            )

        flags = [
            _plugin_flags(name, strategy, tyro.conf.arg())
            for name, strategy in self.strategies.items()
        ]
        return StructConstructorSpec(make, tuple(flags))


class TyroRules(ConstructorRegistry):
    """Rules for the flags of one command.

    Args:
        command_class: dataclass of its flags; its `MAIN` names those of short help, if it has one.
        plugins: classes, or objects that have the defaults, by the fields that hold them.
        shown: fields of those plug-ins that have flags.
        shows_all: whether there are all flags, or those of short help.
        has_strategy: whether a strategy is named, which takes the place of the genome.
    """

    def __init__(
        self,
        command_class: type,
        plugins: dict[str, Any],
        *,
        shown: Collection[str],
        shows_all: bool = True,
        has_strategy: bool = False,
    ):
        super().__init__()
        self._command_class = command_class
        self._names = _names_of_settings(plugins)
        self._plugins = {name: plugin for name, plugin in plugins.items() if name in shown}
        self._has_strategy = has_strategy
        self._main = () if shows_all else getattr(command_class, "MAIN", ())
        self._with_flags = list(self._plugins.values())
        for plugin in self._plugins.values():
            if isinstance(plugin, TeamFlags):
                self._with_flags += plugin.strategies.values()

        self.struct_rule(self._struct)
        self.primitive_rule(_path)
        self.primitive_rule(_devices)

    def _struct(self, info: StructTypeInfo) -> StructConstructorSpec | None:
        """Return the flags of a dataclass or a named tuple."""
        cls: Any = info.type
        plugin = next((each for each in self._with_flags if cls in (each, type(each))), None)
        has_fields = isinstance(cls, type) and (is_dataclass(cls) or hasattr(cls, "_fields"))
        if plugin is None and not has_fields:
            return None
        if cls is self._command_class:
            return self._command_flags(info.default)
        if isinstance(plugin, TeamFlags):
            return plugin.struct()

        default = info.default
        is_whole = plugin is not None and not isinstance(plugin, type) and not is_dataclass(plugin)
        if is_whole:  # an object without flags, such as a learned policy
            return StructConstructorSpec(lambda: default, ())
        if plugin is None:
            flags = [_flag(cls, *member) for member in _members(cls, default)]
            return StructConstructorSpec(cls, tuple(flags))
        name_of = self._names_in(plugin)
        flags = []
        for name, annotation, value in _members(cls, default):
            flags.append(_flag(cls, name, annotation, value, name_of.get(name)))
        return StructConstructorSpec(_checked_constructor(cls, name_of), tuple(flags))

    def _names_in(self, plugin: Any) -> dict[str, str]:
        """Return the names of the settings of a plug-in by its fields; those of teams are plain."""
        for field_name, each in self._plugins.items():
            if each is plugin:
                return self._names[PART_OF_FIELD[field_name]]
        return {}

    def _command_flags(self, default: Any) -> StructConstructorSpec:
        """Return the flags of the command, those of its plug-ins included."""
        hidden = set(PART_OF_FIELD)
        if self._main and self._has_strategy:
            hidden.add("genome")

        flags = {}
        for name, annotation, value in _members(self._command_class, default):
            if name not in hidden and (not self._main or name in self._main):
                flags[name] = _flag(self._command_class, name, annotation, value)
        if self._main:
            flags = {name: flags[name] for name in self._main if name in flags}
        for name, plugin in self._plugins.items():
            flags[name] = _plugin_flags(name, plugin, tyro.conf.arg(name=""))

        common = [_flag(CommonFlags, *member) for member in _members(CommonFlags, None)]
        if not self._main:
            common = common[:1]  # all flags are shown: `help_all` would show no more

        def make(**values: Any) -> Any:
            for name in CommonFlags._fields:
                values.pop(name, None)
            return self._command_class(**values)

        return StructConstructorSpec(make, (*flags.values(), *common))


def _members(cls: Any, default: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield name, annotation and default of each field of a dataclass or a named tuple.

    Args:
        cls: the class; one that is neither has no fields.
        default: an object whose values are the defaults, if it is of this class.
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
        if type(default) is cls:
            value = getattr(default, name)
        yield name, annotations[name], MISSING_NONPROP if value is MISSING else value


def _plugin_flags(name: str, plugin: Any, argument: object) -> StructFieldSpec:
    """Return the flags of a plug-in: a class, or an object whose values are the defaults."""
    cls: Any = plugin if isinstance(plugin, type) else type(plugin)
    default = MISSING_NONPROP if plugin is cls else plugin
    return StructFieldSpec(name, _annotated(cls, argument), default)


def _names_of_settings(plugins: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the names of the settings of each part of a scenario by its fields."""
    parts = {PART_OF_FIELD[field_name]: plugin for field_name, plugin in plugins.items()}
    names: dict[str, dict[str, str]] = {part: {} for part in parts}
    for name, setting in setting_names(parts).items():
        names[setting.part][setting.field] = name
    return names


def _flag(
    cls: Any, name: str, annotation: Any, default: Any, setting: str | None = None
) -> StructFieldSpec:
    """Return a flag with its text, range, unit and default.

    Args:
        cls: dataclass or named tuple.
        name: name of its field.
        annotation: annotation of the field.
        default: default of the field.
        setting: name of the setting, where it is not that of the field.
    """
    limits = str(constraint_of(cls, name) or "").split(", since")[0]
    text = field_docs(cls).get(name, "")

    def hint(shown_default: str) -> str:
        facts = [limits] if limits else []
        if shown_default not in ("None", "") and cls is not CommonFlags:
            facts.append(f"default {shown_default}")
        return f"({'; '.join(facts)})" if facts else ""

    flag_name = None
    if setting is not None and setting != name:
        flag_name = flag(setting).removeprefix("--")
    argument = tyro.conf.arg(name=flag_name, help_behavior_hint=hint)
    return StructFieldSpec(name, _annotated(annotation, argument), default, text)


def _annotated(annotation: Any, argument: object) -> Any:
    """Return an annotation that tells tyro more of a flag, as a value of any type for checkers."""
    return Annotated[annotation, argument]


def _checked_constructor(cls: type, name_of: Mapping[str, str]) -> Callable[..., Any]:
    """Return what makes a strategy, a task or an engine of a user, and checks its values.

    It explains errors of the user's own code by their line.

    Args:
        cls: class of the plug-in.
        name_of: names of its settings by its fields.
    """
    from iswarm_mj.utils.user_code import user_code

    def make(**values: Any) -> Any:
        try:
            with user_code(cls.__name__):
                plugin = cls(**values)
            if is_dataclass(plugin):
                validate(plugin)
        except ConfigError as error:
            name = name_of.get(error.field, error.field)
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
