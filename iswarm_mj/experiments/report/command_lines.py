"""Command lines that make a table of results again."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from shlex import quote
from typing import Any

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.runner.evolution import Operators
from iswarm_mj.experiments.runner.search import Search
from iswarm_mj.strategy.genome import PRESETS


def command_line(name: str, settings: Mapping[str, Any]) -> str:
    """Command line that makes the table of a part again; a comment names settings that differ from the paper's.

    Raises:
        ValueError: a seed is no whole number.
        KeyError, TypeError: other settings lack, or are something else.
    """
    if type(settings["seed"]) is not int:
        raise ValueError(f"the seed is {settings['seed']!r}")
    if name == "grasp":
        flags = {"radius": settings["radii"], "rh": settings["humidities"]}
        flags |= {key: settings[key] for key in ("repeats", "seed", "engine")}
        flags |= {"impl": settings["impl"]} if settings["engine"] == "mjx" else {}
        words = ["iswarm grasp"]
    elif name.startswith("evolve-"):
        keys = ("method", "generations", "population", "steps", "evaluations", "seed")
        flags = {key: settings[key] for key in keys}
        flags |= {"replicates": settings["replicates"]} if settings.get("replicates", 1) > 1 else {}
        flags |= _engine(settings) | _changed(settings["config"], operators=settings["operators"])
        words = ["iswarm evolve"]
    else:
        genome = next((name for name, preset in PRESETS.items() if asdict(preset) == settings["genome"]), "GENOME.json")
        flags = {"genome": genome, "seed": settings["seed"]} | ({"quick": None} if settings["quick"] else {})
        flags |= _engine(settings) | _changed(settings["config"])
        words = [f"iswarm experiment {quote(name)}"]
    words += [f"--{flag}{''.join(f' {quote(word)}' for word in _words(value))}" for flag, value in flags.items()]
    differing = _unlike_the_paper(settings)
    return f"{' '.join(words)} --out DIR" + f"  # not the paper's setting: {', '.join(differing)}" * bool(differing)


def _words(value: Any) -> list[str]:
    """Arguments of a flag: numbers of lists, of boxes too, one by one; of None there are none."""
    if isinstance(value, list):
        numbers = [word for one in value for word in (one if isinstance(one, list) else [one])]
        return [f"{word:g}" for word in numbers]
    return [] if value is None else [str(value)]


def _engine(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Flags of the engine unless they are the defaults; tables of searches do not contain the default engine."""
    engine, refinement = settings.get("engine", "mujoco"), settings.get("refinement", PlanarSettings.refinement)
    finer = {} if refinement == PlanarSettings.refinement else {"refinement": refinement}
    return {} if engine == "mujoco" else {"engine": engine} | finer


def _unlike_the_paper(settings: Mapping[str, Any]) -> list[str]:
    """Values of the arena, and the steps of a search, that differ from the paper's; trials have neither."""
    default = _stored(asdict(ArenaConfig()))
    arena = settings.get("config", {}).get("arena", {})
    found = [f"{_dashed('arena', name)} {value}" for name, value in arena.items() if default.get(name) != value]
    steps = settings.get("steps", Search.steps)
    return found + ([f"{steps} steps"] if steps != Search.steps else [])


def _changed(config: Mapping[str, Any], **others: Mapping[str, Any]) -> dict[str, Any]:
    """Flags of the values that differ from the defaults, by groups of the configuration, or `operators`.

    The flag of a Boolean contains its value.
    """
    default = _stored(asdict(SwarmConfig()) | {"operators": asdict(Operators())})
    groups = _stored({**config, **others})
    return {
        _dashed(group, f"no-{name}" if value is False else name): None if isinstance(value, bool) else value
        for group, values in groups.items()
        for name, value in values.items()
        if default.get(group, {}).get(name) != value
    }


def _stored(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as the metadata of a table has them."""
    return json.loads(json.dumps(settings))


def _dashed(group: str, name: str) -> str:
    return f"{group}.{name}".replace("_", "-")
