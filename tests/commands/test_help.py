"""`--help` fits on a screen and shows the main flags; `--help-all` shows each with its range and its unit."""

import re
from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_type_hints

import pytest

from iswarm_mj.commands.arguments import flag_kinds
from iswarm_mj.commands.help import described
from iswarm_mj.commands.main import COMMANDS, main, parse
from iswarm_mj.config import SwarmConfig
from iswarm_mj.utils.constraints import constraint_of

SCREEN = 42
"""Lines of a terminal."""


def shown(capfd, *arguments):
    with pytest.raises(SystemExit) as end:
        parse([*arguments])
    assert end.value.code == 0
    return re.sub(r"[\s│╭╮╰╯]+", " ", out := capfd.readouterr().out), out.count("\n")


@pytest.mark.parametrize("command", COMMANDS)
def test_the_short_help_fits_on_a_screen_and_names_the_long_one(capfd, command):
    text, lines = shown(capfd, command, "--help")
    assert lines <= SCREEN and "--config FILE" in text
    is_all = all(f"--{name.replace('_', '-')}" in text for name, _ in flag_kinds(COMMANDS[command]))
    assert ("--help-all" in text) is not is_all


@pytest.mark.parametrize("command", COMMANDS)
def test_what_the_short_help_leaves_out_is_not_parsed(command):
    """Flags that are hidden would have no type but that of their defaults, of which tyro's cache takes 0 for False."""
    assert Any not in get_type_hints(described(COMMANDS[command], everything=False)).values()


@pytest.mark.parametrize("command", COMMANDS)
def test_the_long_help_has_every_flag(capfd, command):
    text, _ = shown(capfd, command, "--help-all")
    missing = [name for name, _ in flag_kinds(COMMANDS[command]) if f"--{name.replace('_', '-')}" not in text]
    assert missing == []


def test_ranges_and_units_are_those_of_the_annotations(capfd):
    text, _ = shown(capfd, "clean", "--help-all")
    checked = 0
    groups = get_type_hints(SwarmConfig)
    for group in sorted(groups.keys() & get_type_hints(COMMANDS["clean"]).keys()):
        for f in fields(config := groups[group]):
            if (constraint := constraint_of(config, f.name)) is not None:
                flag = f"--{group}.{f.name.replace('_', '-')} "
                own = text[text.index(flag) :].split(" --")[0]
                assert f"({str(constraint).split(', since')[0]}; default " in own
                checked += 1
    assert checked > 40
    assert "--robots INT Number of robots; by default it follows from the density. (at least 1)" in text


@pytest.mark.parametrize("command", COMMANDS)
def test_every_number_has_a_range(command):
    """So that the help shows it, and that it is checked before anything runs."""
    own = {name: kind for name, kind in flag_kinds(COMMANDS[command]) if "." not in name}
    of_numbers = [
        f.name
        for f in fields(COMMANDS[command])
        if {int, float} & {own.get(f.name), *get_args(own.get(f.name))} and f.name in own
    ]
    assert [name for name in of_numbers if constraint_of(COMMANDS[command], name) is None] == []


def numbers_of(cls, prefix=""):
    """Names of the numbers in a class of flags and in the groups beneath, each with its constraint."""
    for name, kind in get_type_hints(cls).items():
        if {int, float} & {kind, *get_args(kind)} and hasattr(cls, name):
            yield f"{prefix}{name}", constraint_of(cls, name)
        elif isinstance(kind, type) and (is_dataclass(kind) or hasattr(kind, "_fields")):
            yield from numbers_of(kind, f"{prefix}{name}.")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_number_of_every_group_has_a_range(command):
    assert [name for name, constraint in numbers_of(COMMANDS[command]) if constraint is None] == []


def test_the_bench_shows_ranges_of_its_contacts_and_keeps_to_them(capfd):
    text, _ = shown(capfd, "grasp", "--help-all")
    assert "(between 0 and 1e+18 Ohm; default 60000000000.0)" in text[text.index("--contacts.leak ") :].split(" --")[0]
    assert "(between 0 and 1e-06 m; default 0.0)" in text[text.index("--plate.roughness ") :].split(" --")[0]
    with pytest.raises(SystemExit) as end:
        main(["grasp", "--contacts.leak", "-5"])
    assert end.value.code == 2
    assert "iswarm: --contacts.leak must be between 0 and 1e+18 Ohm (got -5.0)" in capfd.readouterr().err


def test_flags_of_a_strategy_are_main_flags(capfd, tmp_path):
    (tmp_path / "own.py").write_text("from iswarm_mj.strategy.genome import TYPE2")
    text, _ = shown(capfd, "clean", "--strategy", f"{tmp_path}/own.py:TYPE2", "--help")
    assert "--fraction-scouts FLOAT Share of the robots that scout. (between 0 and 1; default 0.27)" in text
    assert "--arena.size" not in text
