"""The command line, run in this process, as a user sees it."""

import json
import re

from iswarm_mj.commands import main as cli
from support.small import FLAGS

ARENA_FLAGS = ["--threads=1", *FLAGS]
SMALL = [*ARENA_FLAGS, "--robots=30"]
WALK = """
from dataclasses import dataclass
import jax.numpy as jnp
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command

@dataclass
class Walk(Strategy):
    speed: float = 1.0

    def init(self, n_robots, key):
        return jnp.zeros(n_robots)

    def picks(self, memory):
        return memory < jnp.inf

    def act(self, memory, seen, key):
        return memory + self.speed, Command(memory, jnp.full_like(memory, self.speed))
"""
"""A strategy of a user: all robots go straight on."""


def code_of(*arguments):
    """Return the exit code of `iswarm` with these arguments."""
    try:
        cli.main([str(a) for a in arguments])
    except SystemExit as end:
        return end.code
    return 0


def result(path="runs/clean"):
    """Return the content of a run's result.json."""
    with open(f"{path}/result.json") as file:
        return json.load(file)


def refused(capfd, here, *arguments):
    """Return the one sentence with which `iswarm` refuses; it creates no file below `here`."""
    before = sorted(here.rglob("*"))
    assert code_of(*arguments) == 2
    out, error = capfd.readouterr()
    assert out == ""
    assert sorted(here.rglob("*")) == before
    assert re.fullmatch(r"iswarm: [^\n]*\n", error), error
    return error
