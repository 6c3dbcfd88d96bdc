"""`--help` fits on a screen and shows the main flags; `--help-all` shows each with its range and its unit."""

import re
import resource
import subprocess
import sys
from dataclasses import fields, is_dataclass
from typing import get_args, get_type_hints

import pytest
from helpers_cli import code_of

from iswarm_mj.commands.flags import flag, settings
from iswarm_mj.commands.main import COMMANDS
from iswarm_mj.utils.constraints import constraint_of

SCREEN = 42
"""Lines of a terminal."""


def shown(capfd, *arguments):
    assert code_of(*arguments) == 0
    return re.sub(r"[\s│╭╮╰╯]+", " ", out := capfd.readouterr().out), out.count("\n")


def flags_of(command):
    positional = {"name", "directory"} & {f.name for f in fields(COMMANDS[command])}
    return [flag(name) for name, *_ in settings(COMMANDS[command]()) if name not in positional]


@pytest.mark.parametrize("command", COMMANDS)
def test_all_flags_and_the_main_ones(capfd, command):
    flags = flags_of(command)
    everything, _ = shown(capfd, command, "--help-all")
    assert [name for name in flags if f"{name} " not in everything and f"{name}," not in everything] == []
    text, lines = shown(capfd, command, "--help")
    assert lines <= SCREEN and "--config" in text and COMMANDS[command].__doc__.split(";")[0][:40] in text
    main = getattr(COMMANDS[command], "MAIN", ())
    left_out = [name for name in flags if f"{name} " not in text and f"{name}," not in text]
    assert bool(left_out) == bool(main) == ("--help-all" in text)


def numbers_of(cls, prefix=""):
    """Names of the numbers in a class of flags and in the groups beneath, and their constraints."""
    for name, kind in get_type_hints(cls).items():
        if {int, float} & {kind, *get_args(kind)} and (hasattr(cls, name) or is_dataclass(cls)):
            yield f"{prefix}{name}", constraint_of(cls, name)
        elif isinstance(kind, type) and (is_dataclass(kind) or hasattr(kind, "_fields")):
            yield from numbers_of(kind, f"{prefix}{name}.")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_number_has_a_range_and_its_help_tells_it(command, capfd):
    text, _ = shown(capfd, command, "--help-all")
    for name, limits in numbers_of(COMMANDS[command]):
        assert limits is not None, name
        own = text[text.index(f"{flag(name)} ") :][:900]
        assert str(limits).split(", since")[0] in own, name


def test_flags_of_a_strategy_are_main_flags(capfd, here):
    (here / "own.py").write_text("from iswarm_mj.strategy.genome import TYPE2")
    text, _ = shown(capfd, "clean", "--strategy", "own.py:TYPE2", "--help")
    assert re.search(r"--fraction-scouts FLOAT \w[^-]*\(between 0 and 1; default 0\.27\)", text)
    assert "--arena.size" not in text


@pytest.mark.parametrize("arguments", [["--help"], ["clean", "--help"], ["bench", "--help-all"]])
def test_is_quick_and_imports_little(arguments):
    code = (
        "import sys\nfrom iswarm_mj.commands.main import main\n"
        f"try:\n    main({arguments})\n"
        "except SystemExit as end:\n"
        "    print('code', end.code, sorted({'jax', 'mujoco', 'rerun', 'scipy'} & set(sys.modules)))\n"
    )
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.rstrip().endswith("code 0 []") and done.stderr == ""
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before < 3  # of processor time, 0.5 s usually


@pytest.mark.parametrize("shell", ["x", ""])
@pytest.mark.parametrize("command", [[], ["clean"]])
def test_a_completion_for_an_unknown_shell(command, shell, capfd):
    assert code_of(*command, "--tyro-print-completion", shell) == 2
    assert "bash, zsh" in capfd.readouterr().err
