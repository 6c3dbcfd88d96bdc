"""Reading the arguments of a command.

Which flags a command has depends on its arguments: an engine, a strategy and a task have flags of
their own, and a file of `--config` gives values to any of them. Arguments are therefore read in
stages: the flags that decide, what they name, the flags that there are then, and their values.
"""

import re
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stderr
from dataclasses import MISSING, fields
from io import StringIO
from itertools import groupby
from pathlib import Path
from typing import Any

import tyro

from iswarm_mj.commands.command_settings import PART_OF_FIELD, settings
from iswarm_mj.commands.config_file import ConfigFile
from iswarm_mj.commands.flags import SETTING_OF_FLAG, flag, in_flags, names
from iswarm_mj.commands.tyro_rules import ShortHelp, TeamFlags, TyroRules
from iswarm_mj.config.setting_names import Parts, canonical_name, names_of, setting_names
from iswarm_mj.config.swarm import INTERPRETATIONS
from iswarm_mj.engines.registry import SETTINGS as ENGINE_SETTINGS
from iswarm_mj.engines.registry import check_settings, find_engine
from iswarm_mj.strategy.genome import Genome, load_genome
from iswarm_mj.utils.constraints import check_kind
from iswarm_mj.utils.errors import UserError, closest, shown
from iswarm_mj.utils.user_code import user_code

HELP = {"-h", "--help"}
HELP_ALL = {"--help-all", "--help_all"}
_DECIDING_FLAGS = ("config", "reading", "engine", "genome", *SETTING_OF_FLAG)
"""Flags that decide which others there are, and which defaults they have."""
_NEED_VALUE = {
    "config": "a TOML file or a result.json",
    "strategy": "FILE.py:CLASS, or an installed strategy",
}
"""Flags that need a value, which tyro does not ask for, and what the value names."""
_UNKNOWN_WORDS = "Unrecognized options: "
"""Beginning of tyro's message on words that no flag takes, flags that are not known included."""
_REWORDED = (
    (r"Missing value for argument '(.+)'\..*", r"\1 has no value"),
    (r"invalid choice (.+) for argument '(.+)'\..*of \((.+)\)", r"\2 must be one of \3 (got \1)"),
    (r"(\S+): invalid literal for int\(\).*: (.+)", r"\1 must be a whole number (got \2)"),
    (r"(\S+): could not convert string to float: (.+)", r"\1 must be a number (got \2)"),
    (r"(\S+): Could not find valid parse for arguments: \[(.+)\]", r"\1 cannot be \2"),
    (r"(\S+): it must be (.+)", r"\1 must be \2"),
)
"""Patterns of tyro's messages, and how those say it that do not come from tyro."""
_FLAGS_OF_PLUGIN = {
    "strategy_plugin": ("strategy", "genome"),
    "task_plugin": ("task",),
    "engine_plugin": ("engine",),
}
"""Flags that name the plug-in in a field of a command."""


def parse(name: str, command_class: type, arguments: Sequence[str]) -> Any:
    """Return the command that arguments describe.

    Args:
        name: of the command.
        command_class: dataclass of its flags.
        arguments: after the name.

    Raises:
        UserError: a value is not allowed, a file cannot be read, or a flag is given twice.
        SystemExit: help was printed.
    """
    reader = _Reader(name, command_class, arguments)
    try:
        return reader.read()
    except UserError as error:
        raise UserError(in_flags(error, reader.defaults)) from None


class _Reader:
    """The stages of reading the arguments of one command.

    Attributes:
        defaults: by the names of the settings that are known so far, which messages call by their
            flags; None where no default is known.
    """

    def __init__(self, name: str, command_class: type, arguments: Sequence[str]):
        self.defaults: dict[str, Any] = {}
        self._name = name
        self._command_class = command_class
        self._arguments = list(arguments)
        self._field_names = {field.name for field in fields(command_class)}
        self._flag_names = names(arguments)

    def read(self) -> Any:
        """Return the command."""
        self._refuse_repeated_flags()
        words = _deciding_words(self._arguments)
        self._refuse_missing_values(words)

        config_file = None
        if path := words.pop("config"):
            config_file = ConfigFile.read(Path(path[0]), self._name, self._flag_names)
            words = {word: values or config_file.words(word) for word, values in words.items()}

        command = self._command_with_reading(words)
        self.defaults = dict.fromkeys(self._field_names)
        plugins = self._find_plugins(words, command)

        self.defaults = {setting.name: setting.value for setting in settings(command)}
        parts = {PART_OF_FIELD[field_name]: plugin for field_name, plugin in plugins.items()}
        _refuse_flags_of_command(parts, self._name, self.defaults)
        self.defaults |= _defaults_of_parts(parts)

        # From here on settings have one name each, with their part only where it is needed.
        self._arguments = [_by_canonical_name(word, parts) for word in self._arguments]
        self._flag_names = names(self._arguments)
        self._refuse_repeated_flags()
        if config_file is not None:
            config_file = config_file.by_canonical_names(parts)
        self._refuse_flags_of_other_engines(words, command, plugins, config_file)

        arguments = self._arguments
        if config_file is not None:
            # At the end, since a flag before them could take them for further values of its own.
            of_file = config_file.arguments(self._name, self.defaults, self._flag_names)
            arguments = [*arguments, *of_file]
        return self._read_values(arguments, words, command, plugins)

    def _refuse_repeated_flags(self) -> None:
        repeated = [name for name, n in Counter(self._flag_names).items() if n > 1]
        if not repeated:
            return
        word = next(word for word in self._arguments if names([word]) == [repeated[0]])
        raise UserError(
            f"{word.partition('=')[0]} is given twice; give it once, with all its values if it "
            "takes several"
        )

    def _refuse_missing_values(self, words: dict[str, list[str]]) -> None:
        for name, allowed in _NEED_VALUE.items():
            if name in self._flag_names and not words[name]:
                raise UserError(f"--{name} has no value; name {allowed}")

    def _command_with_reading(self, words: dict[str, list[str]]) -> Any:
        """Return the command with the defaults of the reading of the paper that is named."""
        reading = _first_word(words["reading"], default="")
        if "reading" in self._field_names and reading in INTERPRETATIONS:
            return self._command_class(reading=reading, **vars(INTERPRETATIONS[reading]))
        return self._command_class()

    def _find_plugins(self, words: dict[str, list[str]], command: Any) -> dict[str, Any]:
        """Return the engine, the strategy and the task, which have flags of their own.

        Returns:
            Classes, or objects that have the defaults, by the fields of the command that hold them.
        """
        plugins: dict[str, Any] = {}
        if "engine_plugin" in self._field_names:
            plugins["engine_plugin"] = _engine_defaults(
                _first_word(words["engine"], command.engine)
            )
        if "strategy_plugin" in self._field_names and words["strategy"]:
            plugins["strategy_plugin"] = _find_strategy(words["strategy"])
        elif {"strategy_plugin", "genome"} <= self._field_names:
            plugins["strategy_plugin"] = load_genome(_first_word(words["genome"], command.genome))
        if "task_plugin" in self._field_names and words["task"]:
            plugins["task_plugin"] = _find_task(words["task"][0])
        return plugins

    def _refuse_flags_of_other_engines(
        self,
        words: dict[str, list[str]],
        command: Any,
        plugins: dict[str, Any],
        config_file: ConfigFile | None,
    ) -> None:
        if "engine_plugin" not in plugins:
            return
        named = set(self._flag_names)
        if config_file is not None and not config_file.is_result:
            named |= config_file.values.keys()
        of_others = (named & set(ENGINE_SETTINGS)) - self.defaults.keys()
        if of_others:
            engine = _first_word(words["engine"], command.engine)
            word = flag(min(of_others))
            raise UserError(f"{word} has no effect with --engine {engine}; leave it out")

    def _read_values(
        self,
        arguments: list[str],
        words: dict[str, list[str]],
        command: Any,
        plugins: dict[str, Any],
    ) -> Any:
        """Let tyro read the values of all flags, or print the help that is asked for."""
        asks_for_help = bool(set(self._arguments) & (HELP | HELP_ALL))
        short_help = None
        if asks_for_help and not set(self._arguments) & HELP_ALL:
            named_plugins = [
                field_name
                for field_name in plugins
                if any(words[word] for word in _FLAGS_OF_PLUGIN[field_name])
            ]
            short_help = ShortHelp(named_plugins, names_strategy=bool(words["strategy"]))

        rules = TyroRules(self._command_class, plugins, short_help)
        return explained(
            tyro.cli,
            self._command_class,
            default=command,
            registry=rules,
            args=["--help"] if asks_for_help else arguments,
            prog=f"iswarm {self._name}",
            description=self._command_class.__doc__,
        )


def explained(cli: Callable[..., Any], *arguments: Any, **settings: Any) -> Any:
    """Return what one of tyro's parsers returns.

    Raises:
        UserError: it cannot read the arguments, or the completion of an unknown shell is asked for.
        SystemExit: help was printed.
    """
    errors = StringIO()
    try:
        with redirect_stderr(errors):
            return cli(*arguments, **settings)
    except AssertionError as error:
        if "Shell should be" not in str(error):
            raise
        shell = str(error).rpartition("but got ")[2]
        raise UserError(
            f"there are completions for the shells bash, zsh, tcsh and fish (got {shown(shell)})"
        ) from None
    except SystemExit:
        if text := errors.getvalue():
            raise UserError(_sentence(text, settings["prog"])) from None
        raise  # after help


def _sentence(text: str, command: str) -> str:
    """Return the mistake that tyro describes in a box, as one sentence.

    Args:
        text: the box.
        command: its name, for the remedy.
    """
    lines = _lines_in_box(text)
    paragraphs = [" ".join(part) for is_text, part in groupby(lines, bool) if is_text]
    first = paragraphs[0]
    remedy = f"`{command} --help-all` explains the flags"

    if first.startswith(_UNKNOWN_WORDS):
        words = first.removeprefix(_UNKNOWN_WORDS).split(", ")
        similar_flags = [line.split()[0].rstrip(",") for line in lines if line.startswith("--")]
        if similar_flags:
            remedy = f"perhaps you meant {closest(words[0], similar_flags) or similar_flags[0]}"
        return f"{_unknown_words(words)}; {remedy}"

    fact = first.removeprefix("Error parsing ").rstrip(".")
    if len(paragraphs) > 1 and paragraphs[1].startswith("Got errors:"):
        # Of several possible types, the error of the last one says most.
        flag_name = fact.partition(":")[0]
        last_error = paragraphs[1].rpartition(">: ")[2]
        fact = f"{flag_name}: {last_error}"
    return f"{_reworded(fact)}; {remedy}"


def _lines_in_box(text: str) -> list[str]:
    """Return the lines in a box of tyro, without its title; rules are empty lines."""
    lines = [line.strip("│╭╮╰╯─ ") for line in text.splitlines()][1:]
    return [line if line.strip("-") else "" for line in lines]  # rules where it is not UTF-8


def _reworded(fact: str) -> str:
    """Return a message of tyro in the words of the other messages."""
    for pattern, template in _REWORDED:
        match = re.fullmatch(pattern, fact)
        if match:
            fact = match.expand(template)
    return fact


def _unknown_words(words: Sequence[str]) -> str:
    """Return the fact that no flags have these names, or else that no flag takes these words."""
    flags = [word for word in words if word.startswith("-")]
    if not flags:
        return f"no flag takes {' '.join(words)}"
    return f"there {'is no flag' if len(flags) == 1 else 'are no flags'} {', '.join(flags)}"


def _deciding_words(arguments: Sequence[str]) -> dict[str, list[str]]:
    """Return the values of the flags that decide which others there are."""
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    for name in _DECIDING_FLAGS:
        parser.add_argument(f"--{name}", nargs="*", default=[])
    known, _ = parser.parse_known_args(list(arguments))
    return vars(known)


def _first_word(words: Sequence[str], default: str) -> str:
    """Return the value of a flag that takes one; the default where it is not given."""
    return words[0] if words else default


def _engine_defaults(name: str) -> Any:
    """Return the settings of an engine for this machine."""
    engine = find_engine(name)
    with user_code(engine.__name__):
        defaults = engine.usual()
    check_kind(f"{engine.__name__}.usual()", defaults, engine)
    check_settings(defaults)
    return defaults


def _find_strategy(words: Sequence[str]) -> Any:
    """Return the strategy that words name, or the teams."""
    from iswarm_mj.strategy.library import find_strategy, find_teams
    from iswarm_mj.strategy.validation import check_methods

    teams = find_teams(words)
    if teams:
        shares = {name: share for name, (share, _) in teams.items()}
        plugin: Any = TeamFlags(shares, {name: strategy for name, (_, strategy) in teams.items()})
        strategies = list(plugin.strategies.values())
    else:
        plugin = find_strategy(words[0])
        strategies = [plugin]

    for strategy in strategies:
        if not isinstance(strategy, Genome):
            check_methods(strategy)
    return plugin


def _find_task(name: str) -> Any:
    """Return the class of the task that a word names."""
    from iswarm_mj.strategy.library import TASKS, find
    from iswarm_mj.tasks.validation import check_methods

    task = find(TASKS, name)
    check_methods(task)
    return task


def _by_canonical_name(word: str, parts: Parts) -> str:
    """Return an argument; a flag without its part where the setting's name does without it.

    Raises:
        UserError: it is the flag of settings of several parts.
    """
    for name in names([word]):
        if canonical_name(name, parts, written=flag) != name:
            part, _, _ = name.partition(".")
            return word.replace(f"{part}.", "", 1)
    return word


def _refuse_flags_of_command(parts: Parts, command: str, taken: Iterable[str]) -> None:
    """Refuse fields of strategy, task and engine that have the name of another flag.

    Args:
        parts: classes, or objects that have the defaults.
        command: its name, for messages.
        taken: settings that the command has already.

    Raises:
        UserError: a field has.
    """
    taken_flags = {flag(name) for name in taken}
    for owner in parts.values():
        for field_name in names_of(owner):
            if flag(field_name) in taken_flags:
                cls = owner if isinstance(owner, type) else type(owner)
                raise UserError(
                    f"{cls.__name__} has a field {field_name}, "
                    f"but {flag(field_name)} is already a flag of iswarm {command}; "
                    "rename the field"
                )


def _defaults_of_parts(parts: Parts) -> dict[str, Any]:
    """Return the defaults of the settings of strategy, task and engine by their names.

    Those that must be given have None.

    Args:
        parts: classes, objects that have the defaults, or teams as the strategy.
    """
    defaults: dict[str, Any] = {}
    for name, setting in setting_names(parts).items():
        defaults[name] = _default_of(parts[setting.part], setting.field)

    teams = parts.get("strategy")
    if isinstance(teams, TeamFlags):
        for team, strategy in teams.strategies.items():
            for field_name in names_of(strategy):
                defaults[f"{team}.{field_name}"] = _default_of(strategy, field_name)
    return defaults


def _default_of(owner: Any, name: str) -> Any:
    """Return the default of a field of a class or of an object's class; None where it has none."""
    (declaration,) = [field for field in fields(owner) if field.name == name]
    return None if declaration.default is MISSING else declaration.default
