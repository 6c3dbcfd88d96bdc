"""Misuse of the names that the package offers: what cannot be is refused in a sentence, before
anything is computed."""

import warnings
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

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
    SwarmConfig, ArenaConfig, DriveConfig, OpticsConfig, GripperConfig, StrategyConfig, Genome, MjxSettings,
    MujocoSettings, PlanarSettings, Scenario,
]  # fmt: skip
ODD = [
    *ODD_VALUES, b"bytes", object(), int, np.nan, np.inf, np.float32(1), np.int64(3), np.zeros(3), np.zeros((1, 3)),
    np.array(np.nan), 1j, {1}, (0,), (0, 0), ("a",), range(3), Path("none"), Path("/dev/zero"), lambda: 0, 1e-320,
]  # fmt: skip
N = 5


class Reached(BaseException):
    """Everything was accepted."""


def reach(*_):
    raise Reached


def odd(rng):
    return pick(rng, ODD)


def odd_settings(rng, cls):
    """An object of this class with one or two odd values."""
    usual = cls()
    names = [f.name for f in fields(cls)]
    return replace(usual, **{pick(rng, names): odd(rng) for _ in range(rng.integers(1, 3))})


def with_scenario(entry):
    """Return a call of an entry that takes the fields of its scenario by name."""

    def call(**given):
        fields_ = {
            name: given.pop(name) for name in [*given] if name in Scenario.__dataclass_fields__
        }
        return entry(Scenario(**fields_), **given)

    call.__name__ = entry.__name__
    return call


def misuse(rng, small):
    """What is tried, and a call that does it."""
    name, value, kind = "", odd(rng), rng.integers(6)
    run = {
        "config": small,
        "strategy": PRESETS["type1"],
        "robots": N,
        "steps": 2,
        "engine": MujocoSettings(1),
    }
    rolled = run | {"worlds": jax.random.split(jax.random.key(0), 2)}
    made = {"config": small, "robots": N, "n_starts": 2, "worlds": 2, "engine": PlanarSettings(1)}
    more = ["task", "seed", "goal", "strategy_per_world", "robot_file"]
    calls = {
        2: (with_scenario(Run), run, [*more, "worlds", "record_worlds", "capacity"]),
        3: (with_scenario(rollout), rolled, [*more, "every", "poses_of", "record"]),
        4: (make_env, made, [*more, "scenario", "payload", "steps"]),
        5: (load, {}, ["path"]),
    }
    if kind in calls:
        call, given, more = calls[kind]
        name = pick(rng, [*given, *more])
        return f"{call.__name__}({name}={value!r:.60})", lambda: call(**{**given, name: value})
    cls = pick(rng, CLASSES)
    return cls.__name__, lambda: odd_settings(rng, cls)


@attack(20)
def test_each_is_refused_or_makes_sense(small, tmp_path_factory, seed):
    about, call = misuse(np.random.default_rng(seed), small)
    place = tmp_path_factory.mktemp("empty")
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.chdir(place)
        patch.setattr(
            "iswarm_mj.simulation.run.build_loop", reach
        )  # runs end where they would begin
        warnings.simplefilter("ignore")
        try:
            made = call()
            event("accepted")
            check_types(made)
        except Reached:
            event("accepted")
        except UserError as error:
            words = str(error).replace("ä\n", "").replace("9" * 5000, "")
            assert "\n" not in words and len(words) < 1000, (about, error)
            event("refused")
    assert list(place.iterdir()) == []


def check_types(settings):
    """Settings that were accepted are numbers, words or truth values, and finite."""
    if is_dataclass(settings):
        for f in fields(settings):
            value = getattr(settings, f.name)
            if isinstance(value, float | np.floating):
                assert np.isfinite(value), f.name
            check_types(value)
