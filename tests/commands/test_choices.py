"""Flags that allow only some words: every one of every command refuses others by one sentence."""

from typing import Literal, get_args, get_origin

import pytest

from iswarm_mj.commands.arguments import check_choices, flag_kinds
from iswarm_mj.commands.main import COMMANDS, main
from iswarm_mj.utils.errors import ConfigError

CHOICES = [
    (command, name, kind)
    for command, cls in COMMANDS.items()
    for name, kind in flag_kinds(cls)
    if any(get_origin(of) is Literal for of in (kind, *get_args(kind)))
]


@pytest.mark.parametrize("command, name, kind", CHOICES, ids=[f"{command}-{name}" for command, name, _ in CHOICES])
def test_another_word_is_refused_by_one_sentence(command, name, kind, capfd):
    flag = f"--{name.replace('_', '-')}"
    with pytest.raises(SystemExit) as end:
        main([command, flag, "lunch"])
    out, error = capfd.readouterr()
    assert end.value.code == 2 and out == "" and error.count("\n") == 1
    assert error.startswith(f"iswarm: {flag} must be ") and error.endswith(" (got 'lunch')\n")
    assert all(
        str(word) in error for of in (kind, *get_args(kind)) if get_origin(of) is Literal for word in get_args(of)
    )


def test_choices_of_all_groups_are_among_them():
    assert {("clean", "reading"), ("clean", "gripper.resolution"), ("evolve", "method")} <= {row[:2] for row in CHOICES}


def test_a_word_of_a_file_is_refused_alike(tmp_path, capfd):
    (tmp_path / "mine.toml").write_text('[gripper]\nresolution = "lunch"\n')
    with pytest.raises(SystemExit) as end:
        main(["clean", "--config", str(tmp_path / "mine.toml")])
    assert end.value.code == 2
    sentence = "--gripper.resolution must be quasi-static or dynamic (got 'lunch')"
    assert capfd.readouterr().err == f"iswarm: {sentence}\n"


def test_what_allows_none_says_so_and_what_is_missing_is_left_to_the_parser():
    kinds = {"side": Literal["left", "right"] | None, "name": str}
    check_choices(kinds, ["--side", "left", "--name", "lunch", "--side=None", "--name", "--side"])
    check_choices(kinds, ["--side", "--name", "lunch"])
    with pytest.raises(ConfigError, match=r"--side must be left or right or None \(got 'up'\)"):
        check_choices(kinds, ["--side", "up"])
