"""Misuse of the names that the package offers: refused in a sentence, before anything runs."""

import warnings
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import pytest
from hypothesis import event
from support.attacks import ODD_VALUES, attack, pick

from iswarm_mj import (
    PRESETS,
    MjxSettings,
    MujocoSettings,
    PlanarSettings,
    Run,
    Scenario,
    SwarmConfig,
    load,
    make_env,
    rollout,
)
from iswarm_mj.config.swarm import (
    ArenaConfig,
    DriveConfig,
    GripperConfig,
    OpticsConfig,
    StrategyConfig,
)
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.errors import UserError

CLASSES = [
    SwarmConfig,
    ArenaConfig,
    DriveConfig,
    OpticsConfig,
    GripperConfig,
    StrategyConfig,
    Genome,
    MjxSettings,
    MujocoSettings,
    PlanarSettings,
    Scenario,
]
"""Classes of settings."""
ODD = [
    *ODD_VALUES,
    b"bytes",
    object(),
    int,
    np.nan,
    np.inf,
    np.float32(1),
    np.int64(3),
    np.zeros(3),
    np.zeros((1, 3)),
    np.array(np.nan),
    1j,
    {1},
    (0,),
    (0, 0),
    ("a",),
    range(3),
    Path("none"),
    Path("/dev/zero"),
    lambda: 0,
    1e-320,
]
"""Values that are no settings, or unusual ones."""
N_ROBOTS = 5
SHARE_OF_CLASSES = 1 / 3
"""Share of cases that misuse a class of settings; others misuse a function or `Run`."""


class Reached(BaseException):
    """Everything was accepted."""


def reach(*_):
    """Take the place of what would start."""
    raise Reached


class Misuse(NamedTuple):
    """A call with an odd value."""

    text: str
    """The call, for messages."""
    call: Callable[[], Any]
    """Makes it."""


class Entry(NamedTuple):
    """A function or class, and good arguments."""

    call: Callable[..., Any]
    """Called with the arguments by their names."""
    arguments: dict[str, Any]
    """Arguments with which it works."""
    further_names: list[str]
    """Names of further arguments that it takes."""


def with_scenario(entry):
    """Return a function that takes the fields of an entry's scenario by name."""

    def call(**arguments):
        names = Scenario.__dataclass_fields__.keys() & arguments.keys()
        scenario = Scenario(**{name: arguments.pop(name) for name in names})
        return entry(scenario, **arguments)

    call.__name__ = entry.__name__
    return call


def entries(config):
    """Return all entries, with arguments for a small swarm."""
    of_scenario = ["task", "seed", "goal", "strategy_per_world", "robot_file"]
    run = {
        "config": config,
        "strategy": PRESETS["type1"],
        "robots": N_ROBOTS,
        "steps": 2,
        "engine": MujocoSettings(1),
    }
    worlds = jax.random.split(jax.random.key(0), 2)
    env = {
        "config": config,
        "robots": N_ROBOTS,
        "n_starts": 2,
        "worlds": 2,
        "engine": PlanarSettings(1),
    }
    return [
        Entry(
            with_scenario(Run),
            run,
            [*of_scenario, "worlds", "record_worlds", "capacity"],
        ),
        Entry(
            with_scenario(rollout),
            run | {"worlds": worlds},
            [*of_scenario, "every", "poses_of", "record"],
        ),
        Entry(make_env, env, [*of_scenario, "scenario", "payload", "steps"]),
        Entry(load, {}, ["path"]),
    ]


def odd_settings(rng, cls):
    """Return settings of a class with one or two odd values."""
    names = [f.name for f in fields(cls)]
    n_odd = rng.integers(1, 3)
    odd_values = {pick(rng, names): pick(rng, ODD) for _ in range(n_odd)}
    return replace(cls(), **odd_values)


def drawn_misuse(rng, config):
    """Return a misuse of a class of settings, or of an entry with one odd argument."""
    if rng.random() < SHARE_OF_CLASSES:
        cls = pick(rng, CLASSES)
        return Misuse(cls.__name__, lambda: odd_settings(rng, cls))
    entry = pick(rng, entries(config))
    name = pick(rng, [*entry.arguments, *entry.further_names])
    value = pick(rng, ODD)
    arguments = entry.arguments | {name: value}
    text = f"{entry.call.__name__}({name}={value!r:.60})"
    return Misuse(text, lambda: entry.call(**arguments))


def assert_sentence(error, misuse):
    """Assert that an error is one line of fair length, but for what was given."""
    words = str(error).replace("ä\n", "").replace("9" * 5000, "")
    assert "\n" not in words, misuse.text
    assert len(words) < 1000, misuse.text


def assert_finite(settings):
    """Assert that all numbers in settings are finite."""
    if not is_dataclass(settings):
        return
    for f in fields(settings):
        value = getattr(settings, f.name)
        if isinstance(value, float | np.floating):
            assert np.isfinite(value), f.name
        assert_finite(value)


@attack(20)
def test_each_is_refused_or_makes_sense(small, tmp_path_factory, seed):
    misuse = drawn_misuse(np.random.default_rng(seed), small)
    directory = tmp_path_factory.mktemp("empty")
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.chdir(directory)
        patch.setattr("iswarm_mj.simulation.run.build_loop", reach)  # where a run would begin
        outcome = "accepted"
        try:
            assert_finite(misuse.call())
        except Reached:
            pass
        except UserError as error:
            assert_sentence(error, misuse)
            outcome = "refused"
    event(outcome)
    assert list(directory.iterdir()) == []
