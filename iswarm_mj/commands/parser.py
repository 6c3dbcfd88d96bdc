"""What arguments of a command say: its flags, those of an engine, a strategy and a task, of a file, of a reading."""

from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from dataclasses import MISSING, fields, is_dataclass
from io import StringIO
from itertools import groupby
from pathlib import Path
from typing import Any

import tyro

from iswarm_mj.commands.config_file import ConfigFile
from iswarm_mj.commands.flags import SETTINGS, flag, in_flags, names, settings
from iswarm_mj.commands.rules import Rules, TeamFlags
from iswarm_mj.config.swarm import INTERPRETATIONS
from iswarm_mj.engines.registry import SETTINGS as OF_ENGINES
from iswarm_mj.engines.registry import check_settings, find_engine
from iswarm_mj.strategy.genome import Genome, load_genome
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.utils.constraints import check_kind
from iswarm_mj.utils.errors import UserError, closest

HELP = {"-h", "--help"}
HELP_ALL = {"--help-all", "--help_all"}
_NAMED = {"config": "a TOML file or a result.json", "strategy": "FILE.py:CLASS, or an installed strategy"}
"""Flags that need a value which no error of the parser asks for, and what they name."""


def parse(name: str, cls: type, given: Sequence[str]) -> Any:
    """Return the command that arguments describe.

    Args:
        name: of the command.
        cls: of its flags.
        given: the arguments.

    Raises:
        UserError: a value is not allowed, a file cannot be read, or a flag is given twice.
        SystemExit: help was printed.
    """
    known: dict[str, Any] = {}
    try:
        arguments, named = list(given), names(given)
        if twice := [one for one, n in Counter(named).items() if n > 1]:
            word = next(word.partition("=")[0] for word in given if names([word]) == [twice[0]])
            raise UserError(f"{word} is given twice; give it once, with all its values if it takes several")
        words = _words(given)
        for word, remedy in _NAMED.items():
            if word in named and not words[word]:
                raise UserError(f"--{word} has no value; name {remedy}")
        path = words.pop("config")
        file = ConfigFile.read(Path(path[0]), named) if path else None
        if file is not None:
            words = {word: found or file.words(word) for word, found in words.items()}
        settable = {f.name for f in fields(cls)}
        reading = next(iter(words["reading"]), "")
        is_known = "reading" in settable and reading in INTERPRETATIONS
        default = cls(reading=reading, **vars(INTERPRETATIONS[reading])) if is_known else cls()
        known = dict.fromkeys(settable)
        own = _own(words, default, settable)
        known = {name: value for name, value, *_ in settings(default)}
        for found in own.values():
            known |= _flags_of(found, name, known)
        keys = () if file is None or file.is_result else file.values
        if "physics" in own and (others := {*named, *keys} & {*OF_ENGINES} - {*known}):
            engine = next(iter(words["engine"]), default.engine)
            raise UserError(f"{flag(min(others))} has no effect with --engine {engine}; leave it out")
        if file is not None:
            arguments += file.arguments(name, known, named)  # after words, which flags of several values would take
        asked = {*given} & {*HELP, *HELP_ALL}
        everything = not asked or bool(asked & HELP_ALL)
        named_by = {"own": ("strategy", "genome"), "own_task": ("task",), "physics": ("engine",)}
        shown = {part: one for part, one in own.items() if everything or any(words[word] for word in named_by[part])}
        rules = Rules(cls, shown, everything, bool(words["strategy"]))
        arguments = ["--help"] if asked else arguments
        named = {"prog": f"iswarm {name}", "description": cls.__doc__}
        return explained(tyro.cli, cls, default=default, registry=rules, args=arguments, **named)
    except UserError as error:
        raise UserError(in_flags(error, known)) from None


def explained(cli: Callable[..., Any], *arguments: Any, **settings: Any) -> Any:
    """Return what one of tyro's parsers does.

    Raises:
        UserError: it cannot read the arguments, or a completion is asked for a shell that there is none for.
        SystemExit: help was printed.
    """
    said = StringIO()
    try:
        with redirect_stderr(said):
            return cli(*arguments, **settings)
    except AssertionError as error:
        if "Shell should be" not in str(error):
            raise
        raise UserError(f"there are completions for the shells bash, zsh, tcsh and fish ({error})") from None
    except SystemExit:
        if text := said.getvalue():
            raise UserError(_sentence(text, settings["prog"])) from None
        raise  # after help


def _sentence(text: str, command: str) -> str:
    """What tyro says of a mistake in a box: its first paragraph, of several possible types the last one's error."""
    lines = [line.strip("│╭╮╰╯─ ") for line in text.splitlines()][1:]
    lines = [line if line.strip("-") else "" for line in lines]  # its rules where the output is not UTF-8
    first, *more = [" ".join(part) for is_text, part in groupby(lines, bool) if is_text]
    fact = first.removeprefix("Error parsing ").rstrip(".")
    if more and more[0].startswith("Got errors:"):
        fact = f"{fact.partition(':')[0]}: {more[0].rpartition('>: ')[2]}"
    offered = [line.split()[0].rstrip(",") for line in lines if line.startswith("--")]
    if first.startswith("Unrecognized") and offered:
        given = first.partition(": ")[2].split(", ")[0]
        return f"{fact}; perhaps you meant {closest(given, offered) or offered[0]}"
    return f"{fact}; `{command} --help-all` explains the flags"


def _words(arguments: Sequence[str]) -> dict[str, list[str]]:
    """Values of the flags that decide which others there are, and thus precede the parser."""
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    for word in ("config", "reading", "engine", "genome", *SETTINGS):
        parser.add_argument(f"--{word}", nargs="*", default=[])
    return vars(parser.parse_known_args(list(arguments))[0])


def _own(words: dict[str, list[str]], default: Any, settable: set[str]) -> dict[str, Any]:
    """What has flags of its own, by the fields of the command that hold it: classes, or objects with the defaults.

    The settings of the engine are those for this machine.
    """
    found: dict[str, Any] = {}
    if "physics" in settable:
        engine = find_engine(next(iter(words["engine"]), default.engine))
        with user_code(engine.__name__):
            usual = engine.usual()
        check_kind(f"{engine.__name__}.usual()", usual, engine)
        check_settings(usual)
        found["physics"] = usual
    if "own" in settable and words["strategy"]:
        from iswarm_mj.strategy.library import find_strategy, find_teams
        from iswarm_mj.strategy.pytrees import check_methods

        teams = TeamFlags(find_teams(words["strategy"]))
        found["own"] = teams if teams.teams else find_strategy(words["strategy"][0])
        for one in [*teams.strategies.values()] or [found["own"]]:
            if not isinstance(one, Genome):
                check_methods(one)
    elif {"own", "genome"} <= settable:
        found["own"] = load_genome(next(iter(words["genome"]), default.genome))
    if "own_task" in settable and words["task"]:
        from iswarm_mj.strategy.library import TASKS, find
        from iswarm_mj.tasks.signatures import check_methods

        found["own_task"] = find(TASKS, words["task"][0])
        check_methods(found["own_task"])
    return found


def _flags_of(found: Any, command: str, known: dict[str, Any]) -> dict[str, Any]:
    """Flags of an engine, a strategy or a task and their defaults, None for those that must be given.

    Raises:
        UserError: one is a flag of the command, too.
    """
    if isinstance(found, TeamFlags):
        flags = {name: _flags_of(one, command, {}) for name, one in found.strategies.items()}
        return {f"{name}.{field}": default for name, own in flags.items() for field, default in own.items()}
    cls = found if isinstance(found, type) else type(found)
    if not is_dataclass(cls):
        return {}
    own = {f.name: None if f.default is MISSING else f.default for f in fields(cls)}
    if clashes := [flag(name) for name in own if flag(name) in map(flag, known)]:
        name = clashes[0].removeprefix("--").replace("-", "_")
        raise UserError(
            f"{cls.__name__} has a field {name}, but {clashes[0]} is already a flag of iswarm {command}; "
            "rename the field"
        )
    return own
