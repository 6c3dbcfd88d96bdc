"""Misuse of the names that the package offers: what cannot be is refused in a sentence, before anything is computed."""

import warnings
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import jax
import numpy as np
import pytest
from helpers_odd import ODD_VALUES
from helpers_worlds import start_of

from iswarm_mj import (
    PRESETS,
    MjxSettings,
    MujocoSettings,
    PlanarSettings,
    Run,
    RunSettings,
    SwarmConfig,
    load,
    make_env,
    rollout,
)
from iswarm_mj.config import ArenaConfig, DriveConfig, GripperConfig, OpticsConfig, StrategyConfig
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.errors import UserError

CLASSES = [
    SwarmConfig, ArenaConfig, DriveConfig, OpticsConfig, GripperConfig, StrategyConfig, Genome, MjxSettings,
    MujocoSettings, PlanarSettings, RunSettings,
]  # fmt: skip
ODD = [
    *ODD_VALUES, b"bytes", object(), int, np.nan, np.inf, np.float32(1), np.int64(3), np.zeros(3), np.zeros((1, 3)),
    np.array(np.nan), 1j, {1}, (0,), (0, 0), ("a",), range(3), Path("none"), Path("/dev/zero"), lambda: 0, 1e-320,
]  # fmt: skip
N = 5


class Reached(BaseException):
    """Everything was accepted."""


@pytest.fixture(autouse=True)
def nothing_is_computed(monkeypatch):
    """Runs end where they would begin."""

    def reach(*_):
        raise Reached

    monkeypatch.setattr("iswarm_mj.simulation.run.start_loop", reach)


def odd(rng):
    return ODD[rng.integers(len(ODD))]


def odd_settings(rng, cls):
    """An object of this class with one or two odd values."""
    usual = RunSettings(N, 2) if cls is RunSettings else cls()
    names = [f.name for f in fields(cls)]
    return replace(usual, **{names[rng.integers(len(names))]: odd(rng) for _ in range(rng.integers(1, 3))})


def odd_start(rng, config):
    """How a world begins, with something in it that cannot be."""
    start = start_of(config, N, 0, 0)
    part = [*start.task._fields, "poses", "is_alive"][rng.integers(len(start.task) + 2)]
    values = np.array(getattr(start, part) if part in start._fields else getattr(start.task, part))
    match rng.integers(5):
        case 0:
            values = values[:-1]
        case 1:
            values = values[None]
        case 2:
            values = values.astype(float)
            values.reshape(-1)[rng.integers(values.size)] = [np.nan, np.inf, -1e9, 1e9][rng.integers(4)]
        case 3:
            values = odd(rng)
        case 4:
            values = values.astype(str)
    changed = {part: values}
    return start._replace(**changed) if part in start._fields else start._replace(task=start.task._replace(**changed))


def misuse(rng, small):
    """What is tried, and a call that does it."""
    kind = rng.integers(7)
    given = {"config": small, "genome": PRESETS["type1"], "settings": RunSettings(N, 2), "engine": MujocoSettings(1)}
    match kind:
        case 0 | 1:
            cls = CLASSES[rng.integers(len(CLASSES))]
            return cls.__name__, lambda: odd_settings(rng, cls)
        case 2:
            names = [*given, "worlds", "strategy", "strategy_per_world", "robot_file"]
            name, value = names[rng.integers(len(names))], odd(rng)
            return f"Run({name}={value!r:.60})", lambda: Run(**{**given, name: value})
        case 3:

            def begin():
                world = World(PRESETS["type1"], N, start=odd_start(rng, small))
                Run(**given, worlds=[world])

            return "a start", begin
        case 4:
            names = ["n_robots", "steps", "engine", "strategy_per_world", "stop_at", "every", "poses_of", "record"]
            name, value = [*names, "config", "strategy", "keys"][rng.integers(len(names) + 3)], odd(rng)
            call = {"config": small, "strategy": PRESETS["type1"], "keys": jax.random.split(jax.random.key(0), 2)}
            call |= {"n_robots": N, "steps": 2, "engine": MujocoSettings(1), name: value}
            return f"rollout({name}={value!r:.60})", lambda: rollout(**call)
        case 5:
            names = ["task", "n_robots", "n_worlds", "engine", "config", "seed", "payload", "steps", "n_starts"]
            name, value = [*names, "stop_at", "robot_file"][rng.integers(len(names) + 2)], odd(rng)
            usual = {"config": small, "n_robots": N, "n_starts": 2, "n_worlds": 2, "engine": PlanarSettings(1)}
            return f"make_env({name}={value!r:.60})", lambda: make_env(**{**usual, name: value})
        case _:
            value = odd(rng)
            return f"load({value!r:.60})", lambda: load(value)


@pytest.mark.attack(20)
def test_each_is_refused_or_makes_sense(attack, small, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for rng in attack.generators():
        about, call = misuse(rng, small)
        with attack.case(about) as outcome, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                made = call()
                outcome.append("accepted")
                check_types(made)
            except Reached:
                outcome.append("accepted")
            except UserError as error:
                words = str(error).replace("ä\n", "").replace("9" * 5000, "")
                assert "\n" not in words and len(words) < 1000, error
                outcome.append("refused")
    assert list(tmp_path.iterdir()) == []


def check_types(settings):
    """Settings that were accepted are numbers, words or truth values, and finite."""
    if is_dataclass(settings):
        for f in fields(settings):
            value = getattr(settings, f.name)
            if isinstance(value, float | np.floating):
                assert np.isfinite(value), f.name
            check_types(value)
