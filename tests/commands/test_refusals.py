"""Refusals of commands: exit code 2, one sentence with the remedy, nothing written.

The sentences stand in refusals.txt, all on one page.
"""

import importlib.util
import io
import os
import sys

import pytest
from support.cli import code_of, refused
from support.refusals import answer, matches, read_page, write_page
from support.refused_files import write_files
from support.small import FLAGS

from iswarm_mj.commands.command_settings import ineffective_settings, settings
from iswarm_mj.commands.flags import in_flags
from iswarm_mj.commands.main import parse
from iswarm_mj.utils.errors import ConfigError, FaultKind, SimulationFault, UserError

SENTENCES = read_page()
QUICK_VARIABLES = ("JAX_PLATFORMS=nonsense,cpu", "NUMBA_DISABLE_JIT=1")
"""Variables of the environment that the everyday suite sets, each in a process of its own."""


def is_slow(command):
    """Return whether a command line sets variables, and is not one of every day."""
    sets_variables = not command.startswith("iswarm")
    return sets_variables and not command.startswith(QUICK_VARIABLES)


COMMANDS = [
    pytest.param(command, marks=pytest.mark.slow) if is_slow(command) else command
    for command in SENTENCES
]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Return a directory with the files that command lines of the page name."""
    directory = tmp_path_factory.mktemp("files")
    write_files(directory)
    return directory


@pytest.fixture(scope="module")
def changed_sentences():
    """Return a dict for sentences that differ from the page, which are written to it on demand."""
    sentences = {}
    yield sentences
    if os.environ.get("WRITE_REFUSALS"):
        write_page(sentences)


def fail_as_accepted(*_):
    """Take the place of the steps of a run."""
    raise AssertionError("the command line is accepted")


@pytest.mark.parametrize("command", COMMANDS)
def test_refusal(command, files, changed_sentences, capfd, monkeypatch):
    monkeypatch.chdir(files)
    monkeypatch.setattr("iswarm_mj.workflows.clean.advance_and_record", fail_as_accepted)
    before = sorted(files.rglob("*"))
    code, output, error = answer(command, capfd)
    assert (code, output) == (2, ""), error
    assert sorted(files.rglob("*")) == before

    assert error.startswith("iswarm: ") and error.endswith("\n")
    sentence = error.removeprefix("iswarm: ").removesuffix("\n")
    assert "\n" not in sentence
    if not matches(sentence, SENTENCES[command]):
        changed_sentences[command] = sentence
        assert os.environ.get("WRITE_REFUSALS"), sentence


@pytest.mark.parametrize(
    "line",
    [
        "message-time --optics.slots 16",
        "resolved-grasps --gripper.bench c",
        "types --strategy.random-turn 60",
    ],
)
def test_settings_that_some_runs_of_an_experiment_need_have_an_effect(line):
    command = parse(["experiment", *line.split()])
    assert not ineffective_settings(command)
    assert command.configs


class TestTaskWithoutDust:
    def test_a_small_arena_needs_its_dust_areas_moved(self, files, monkeypatch):
        """Dust areas lie within the walls, also in tasks that do not use them."""
        monkeypatch.chdir(files)
        without_balls = [word for word in FLAGS if "n-dust" not in word]
        command = parse(["run", "--task", "glow.py:Glow", "--robots", "4", *without_balls])
        assert command.number_of_robots() == 4

    def test_a_reading_may_move_them(self, files, monkeypatch):
        monkeypatch.chdir(files)
        command = parse(["run", "--task", "glow.py:Glow", "--reading", "initial"])
        assert command.config.arena.dust_area_offset == 16


def test_warp_that_is_not_installed(capfd, here, monkeypatch):
    find_spec = importlib.util.find_spec

    def find_spec_without_warp(name, *package):
        return None if name == "warp" else find_spec(name, *package)

    monkeypatch.setattr(importlib.util, "find_spec", find_spec_without_warp)
    flags = [*FLAGS, "--robots=30", "--engine=planar", "--impl=warp"]
    assert (
        refused(capfd, here, "clean", *flags)
        == 'iswarm: the package warp-lang is not installed; run pip install "iswarm-mj[warp]"\n'
    )


@pytest.mark.parametrize(
    "arguments",
    [
        ["replay", "--title", "a\udcff"],
        ["sweep", "clean", "--over", "seed=1,2", "--out", "a\udcff"],
        ["\udc80"],
    ],
)
def test_arguments_that_are_no_text(capfd, here, arguments):
    assert "must be text in UTF-8 (got" in refused(capfd, here, *arguments)


@pytest.mark.parametrize("arguments", [["clean", "--config"], ["clean", "--steps"], ["clean"], []])
@pytest.mark.parametrize("word", ["x" * 5000, "\x1b[31mred", "\x1b[31m" * 2000])
def test_an_echoed_word_is_short_and_controls_no_terminal(arguments, word, capfd):
    assert code_of(*arguments, word) == 2
    error = capfd.readouterr().err
    assert "\x1b" not in error
    assert len(error) < 3000
    if "--config" in arguments:  # the remedy stays where the word is cut
        assert error.endswith("or a result.json\n")


def test_one_sentence_where_the_output_is_not_utf_8(monkeypatch):
    """Tyro draws boxes of other characters there."""
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), "latin-1"))
    fact = r"--steps must be a whole number \(got 'x'\)"
    remedy = "`iswarm clean --help-all` explains the flags"
    with pytest.raises(UserError, match=f"^{fact}; {remedy}$"):
        parse(["clean", "--steps", "x"])


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (ConfigError("arena.dump_size", 7, "small"), "--arena.dump-size must be small (got 7)"),
        (
            ConfigError("n_robots", 0, "at least `n_worlds`"),
            "--robots must be at least --worlds (got 0)",
        ),
        (
            ConfigError("worlds", 2, "1", "use `jax.pmap`"),
            "--worlds must be 1 (got 2); use `jax.pmap`",
        ),
        (ConfigError("strategy", "x", "known"), "--strategy must be known (got 'x')"),
        (
            SimulationFault(kind=FaultKind.TOO_MANY_CONTACTS),
            "contact buffer full; use fewer robots, or with mjx increase --contact-capacity",
        ),
    ],
)
def test_settings_in_messages_are_flags(error, sentence):
    command = parse(["clean", "--engine", "mjx"])
    names = [setting.name for setting in settings(command)]
    assert in_flags(error, names) == sentence
