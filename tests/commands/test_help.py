"""`--help` shows the main flags; `--help-all` shows each with its range and its unit."""

import re
from dataclasses import fields, is_dataclass
from typing import get_args, get_type_hints

import pytest
from support.cli import code_of

from iswarm_mj.commands.command_settings import settings
from iswarm_mj.commands.flags import flag
from iswarm_mj.commands.main import COMMANDS
from iswarm_mj.utils.constraints import constraint_of

POSITIONAL = {"name", "directory", "command", "command_arguments", "candidates", "table"}
"""Fields of commands that are no flags."""
LENGTH = 900
"""Number of characters within which the help of a flag has its range."""
FRACTION_SCOUTS = r"--fraction-scouts FLOAT \w[^-]*\(between 0 and 1; default 0\.27\)"
"""Help of a parameter of the genome type 2."""


def help_text(capfd, *arguments):
    """Return help without its boxes and line breaks."""
    assert code_of(*arguments) == 0
    return re.sub(r"[\s│╭╮╰╯]+", " ", capfd.readouterr().out)


def flags_of(command):
    """Return the flags of a command, but not those of its plug-ins."""
    positional = POSITIONAL & {field.name for field in fields(COMMANDS[command])}
    names = [setting.name for setting in settings(COMMANDS[command]())]
    return [flag(name) for name in names if name not in positional]


def limits_of_numbers(cls, prefix=""):
    """Yield names and limits of the numbers in a class of flags, and in the groups beneath."""
    for name, kind in get_type_hints(cls).items():
        is_number = bool({int, float} & {kind, *get_args(kind)})
        is_group = isinstance(kind, type) and (is_dataclass(kind) or hasattr(kind, "_fields"))
        if is_number and (hasattr(cls, name) or is_dataclass(cls)):
            yield f"{prefix}{name}", constraint_of(cls, name)
        elif is_group:
            yield from limits_of_numbers(kind, f"{prefix}{name}.")


def missing_flags(flags, text):
    """Return the flags that a help text does not show."""
    return [name for name in flags if f"{name} " not in text and f"{name}," not in text]


@pytest.mark.parametrize("command", COMMANDS)
def test_short_help_has_the_main_flags_and_long_help_all(capfd, command):
    flags = flags_of(command)
    command_class = COMMANDS[command]
    long_help = help_text(capfd, command, "--help-all")
    short_help = help_text(capfd, command, "--help")
    assert missing_flags(flags, long_help) == []
    is_shorter = missing_flags(flags, short_help) != []
    assert is_shorter == bool(getattr(command_class, "MAIN", ()))
    assert is_shorter == ("--help-all" in short_help)

    for name, limits in limits_of_numbers(command_class):
        assert limits is not None, name
        start = long_help.index(f"{flag(name)} ")
        range_and_unit = str(limits).split(", since")[0]
        assert range_and_unit in long_help[start : start + LENGTH], name


def test_help_on_a_genome_has_its_flags(capfd):
    """The first of them is `--genome`, which chooses another."""
    text = help_text(capfd, "clean", "--genome", "type2", "--help")
    assert re.search(rf"--genome .*{FRACTION_SCOUTS}", text)


def test_flags_of_a_strategy_are_main_flags(capfd, here):
    (here / "own.py").write_text("from iswarm_mj.strategy.genome import TYPE2")
    text = help_text(capfd, "clean", "--strategy", "own.py:TYPE2", "--help")
    assert re.search(FRACTION_SCOUTS, text)
    assert "--arena.size" not in text
    assert "--genome " not in text
