"""Sessions of the page without a page, and the state of their runs."""

import re
import shlex

import jax
import numpy as np

from iswarm_mj.commands.main import parse
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from support.page import CONFIG

PAGE_SCENARIO = PageScenario(CONFIG, robots=20, seed=3, engine=PlanarSettings())
"""Scenario of most sessions."""


def steps(session, n):
    """Take control steps, and return the session."""
    for _ in range(n):
        session.advance()
    return session


def begun(scenario=PAGE_SCENARIO, n=1, **settings):
    """Return a session that has taken control steps, by default one."""
    return steps(Session(scenario, **settings), n)


def state(run):
    """Return all arrays of a run: conditions, rules and state."""
    params, state = run.arrays()
    leaves = jax.tree.leaves((params.conditions, params.strategy, state))
    return [np.asarray(leaf) for leaf in leaves]


def assert_same(arrays, expected):
    """Assert that two lists of arrays are equal, bit by bit."""
    for array, expected_array in zip(arrays, expected, strict=True):
        np.testing.assert_array_equal(array, expected_array)


def names_of(changes):
    """Return changes as texts."""
    return [str(change) for change in changes]


def assert_copies_repeat(session, folder):
    """Assert that the command and the file that a session offers give its state, bit by bit.

    Args:
        session: session that has taken some steps.
        folder: folder for the file.
    """
    command = re.sub(r"^iswarm (run|play)|--steps \d+", "", session.command())
    file = folder / "play.toml"
    file.write_text(re.sub(r"steps = \d+", "", session.toml()))
    for arguments in (shlex.split(command), ["--config", str(file)]):
        copy = steps(parse(["play", *arguments]).session(), session.step)
        for change in copy.waiting:  # those after the last step
            copy.change(change.name, change.value)
        assert_same(state(copy.run), state(session.run))
