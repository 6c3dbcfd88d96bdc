"""Misspelt flags, and values that are no numbers: one sentence each."""

import shlex

import pytest
from helpers_cli import refused
from helpers_command_lines import flags_of

from iswarm_mj.commands.arguments import flag_kinds
from iswarm_mj.commands.main import COMMANDS
from iswarm_mj.commands.mistakes import check_numbers, misspelt

OWN = "run --strategy beeclust --task aggregation"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "line, given, meant",
    [
        ("clean --stepz 10", "--stepz", "--steps"),
        ("clean --stepz=10", "--stepz", "--steps"),
        ("clean --step 3", "--step", "--steps"),
        ("evolve --mehtod random", "--mehtod", "--method"),
        ("clean --arena.dump 4", "--arena.dump", "--arena.dump-size"),
        ("clean --record_grasp 3", "--record_grasp", "--record-grasps"),
        ("clean --no-recrod", "--no-recrod", "--record"),
        ("clean --optics.no-line-of-sigt", "--optics.no-line-of-sigt", "--optics.line-of-sight"),
        ("clean --density None --stepz -3", "--stepz", "--steps"),
        ("experiment --seedd 3 types", "--seedd", "--seed"),
        ("picture --stap 3 there", "--stap", "--step"),
        ("inspect --dir there", "--dir", None),
        ("clean -s 3", "-s", None),
        ("clean --xyzzy", "--xyzzy", None),
        (f"{OWN} --robotss 3", "--robotss", "--robots"),
    ],
)
def test_a_misspelt_flag(line, given, meant, capfd, here):
    command, *arguments = shlex.split(line)
    hint = f"; perhaps you meant {meant}" if meant else ""
    sentence = f"{given} is not a flag of iswarm {command}{hint}; `iswarm {command} --help-all` lists all flags."
    assert refused(capfd, here, command, *arguments) == f"iswarm: {sentence}\n"


def test_a_word_too_many(capfd, here):
    assert refused(capfd, here, "clean", "extra").startswith("iswarm: iswarm clean does not know what 'extra' is for; ")


@pytest.mark.parametrize("command", COMMANDS)
def test_all_flags_of_the_parser_are_known(command):
    kinds = dict(flag_kinds(COMMANDS[command]))
    names = [name for flag in flags_of(command) for name in flag.names if name != "--help"]
    assert (
        misspelt(
            kinds,
            [*names, *(f"{name}=3" for name in names)],
        )
        == []
    )
    assert misspelt(kinds, [f"{name}-x" for name in names]) == [f"{name}-x" for name in names]


def test_values_may_begin_with_a_dash():
    kinds = {"steps": int, "rh": tuple[float, ...], "out": str}
    line = "--rh -1 -2.5 -inf --out -name --steps -3 - there -- --stepz"
    assert misspelt(kinds, line.split()) == []
    check_numbers(kinds, line.split())


@pytest.mark.parametrize(
    "line, sentence",
    [
        ("clean --steps abc", "--steps must be a whole number (got 'abc')"),
        ("clean --steps=1.5", "--steps must be a whole number (got '1.5')"),
        ("clean --density some", "--density must be a number (got 'some')"),
        ("clean --p-vector-forget=None3", "--p-vector-forget must be a number (got 'None3')"),
        ("clean --arena.obstacles 1 2 3 --seed 2", "--arena.obstacles must be lists of 5 numbers (got '1 2 3')"),
        ("clean --lanes 1 b", "--lanes must be whole numbers (got '1 b')"),
        ("grasp --rh ten", "--rh must be numbers (got 'ten')"),
        ("clean --steps --seed 3", "--steps needs a whole number."),
        (f"{OWN} --steps many", "--steps must be a whole number (got 'many')"),
    ],
)
def test_what_is_no_number(line, sentence, capfd, here):
    assert refused(capfd, here, *line.split()) == f"iswarm: {sentence}\n"


def test_none_stands_where_it_is_allowed():
    line = "--robots None --density=None --use-hop-count None"
    check_numbers(dict(flag_kinds(COMMANDS["clean"])), line.split())
