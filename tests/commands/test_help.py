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


def shown(capfd, *arguments):
    assert code_of(*arguments) == 0
    return re.sub(r"[\s│╭╮╰╯]+", " ", capfd.readouterr().out)


def flags_of(command):
    positional = {"name", "directory", "command", "given"} & {
        f.name for f in fields(COMMANDS[command])
    }
    return [flag(name) for name, *_ in settings(COMMANDS[command]()) if name not in positional]


def numbers_of(cls, prefix=""):
    """Names of the numbers in a class of flags and in the groups beneath, and their constraints."""
    for name, kind in get_type_hints(cls).items():
        if {int, float} & {kind, *get_args(kind)} and (hasattr(cls, name) or is_dataclass(cls)):
            yield f"{prefix}{name}", constraint_of(cls, name)
        elif isinstance(kind, type) and (is_dataclass(kind) or hasattr(kind, "_fields")):
            yield from numbers_of(kind, f"{prefix}{name}.")


@pytest.mark.parametrize("command", COMMANDS)
def test_all_flags_with_their_ranges_and_the_main_ones(capfd, command):
    flags, cls = flags_of(command), COMMANDS[command]
    everything, text = shown(capfd, command, "--help-all"), shown(capfd, command, "--help")
    assert [
        name for name in flags if f"{name} " not in everything and f"{name}," not in everything
    ] == []
    left_out = [name for name in flags if f"{name} " not in text and f"{name}," not in text]
    assert bool(left_out) == bool(getattr(cls, "MAIN", ())) == ("--help-all" in text)
    for name, limits in numbers_of(cls):
        assert limits is not None, name
        own = everything[everything.index(f"{flag(name)} ") :][:900]
        assert str(limits).split(", since")[0] in own, name


def test_help_on_a_genome_has_its_flags_and_how_to_choose_another(capfd):
    text = shown(capfd, "clean", "--genome", "type2", "--help")
    assert re.search(
        r"--genome .*--fraction-scouts FLOAT \w[^-]*\(between 0 and 1; default 0\.27\)", text
    )


def test_flags_of_a_strategy_are_main_flags(capfd, here):
    (here / "own.py").write_text("from iswarm_mj.strategy.genome import TYPE2")
    text = shown(capfd, "clean", "--strategy", "own.py:TYPE2", "--help")
    assert re.search(r"--fraction-scouts FLOAT \w[^-]*\(between 0 and 1; default 0\.27\)", text)
    assert "--arena.size" not in text and "--genome " not in text
