"""The page of all sentences with which commands refuse bad input: read, compared, written again."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

PAGE = Path(__file__).parents[1] / "commands" / "refusals.txt"
PROMPT = "$ "
ANY_TEXT = "[...]"
"""Placeholder for text of libraries, machines and versions, which may be any."""
WIDTH = 100
"""Width to which the page sets the sentences, in characters."""
_PROGRESS = re.compile(r"iswarm: (placing|preparing) [^\n]*\n")


class Answer(NamedTuple):
    """End of a command."""

    code: int
    """Exit code."""
    output: str
    error: str
    """What it printed on stderr, without lines that report progress."""


def read_page():
    """Return the sentences of the page by their command lines."""
    sentences = {}
    for block in _blocks():
        command, sentence = _split(block)
        if command:
            assert command not in sentences, f"{command} stands on the page twice"
            sentences[command] = sentence
    return sentences


def write_page(sentences):
    """Replace sentences on the page, given by their command lines."""
    blocks = []
    for block in _blocks():
        command, sentence = _split(block)
        if command:
            sentence = sentences.get(command, sentence)
            block = f"{PROMPT}{command}\n{_set(sentence)}"
        blocks.append(block)
    PAGE.write_text("\n\n".join(blocks) + "\n")


def matches(sentence, pattern):
    """Return whether a sentence is that of the page, which may have placeholders."""
    parts = [re.escape(part) for part in pattern.split(ANY_TEXT)]
    return re.fullmatch(".*".join(parts), sentence) is not None


def answer(command, capfd):
    """Return how a command line of the page ends, in the working directory.

    It runs in this process, unless it sets variables of the environment, which libraries read when
    they are imported.
    """
    words = shlex.split(command, comments=True)
    program = words.index("iswarm")
    variables = dict(word.split("=", 1) for word in words[:program])
    arguments = words[program + 1 :]
    if variables:
        process = subprocess.run(
            [sys.executable, "-m", "iswarm_mj", *arguments],
            env=os.environ | variables,
            capture_output=True,
            text=True,
        )
        return Answer(process.returncode, process.stdout, _PROGRESS.sub("", process.stderr))

    from support.cli import code_of

    code = code_of(*arguments)
    output, error = capfd.readouterr()
    return Answer(code, output, _PROGRESS.sub("", error))


def _blocks():
    """Return the parts of the page that empty lines separate."""
    return PAGE.read_text().rstrip("\n").split("\n\n")


def _split(block):
    """Return the command line of a block and its sentence; empty texts for a block of text."""
    if not block.startswith(PROMPT):
        return "", ""
    command, _, sentence = block.removeprefix(PROMPT).partition("\n")
    return command, " ".join(sentence.split())


def _set(sentence):
    """Return a sentence in lines of the page's width."""
    return fill(sentence, WIDTH, break_long_words=False, break_on_hyphens=False)
