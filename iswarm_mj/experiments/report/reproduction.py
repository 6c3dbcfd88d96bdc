"""Command lines that reproduce a table of results."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.report.results import SEARCH, TRIALS, Result
from iswarm_mj.experiments.runner.evolution import Operators
from iswarm_mj.experiments.runner.search_settings import Search
from iswarm_mj.strategy.genome import PRESETS


def command(result: Result) -> str:
    """Command line that reproduces a table; a comment names settings that differ from the paper's."""
    settings = result.settings
    line = {TRIALS: _grasp, SEARCH: _evolve}.get(result.path.name, _experiment)(settings)
    differing = _unlike_the_paper(settings)
    return f"{line} --out DIR" + (f"  # not the paper's setting: {', '.join(differing)}" if differing else "")


def _grasp(settings: Mapping[str, Any]) -> str:
    radii, humidities = (" ".join(f"{value:g}" for value in settings[name]) for name in ("radii", "humidities"))
    impl = f" --impl {settings['impl']}" if settings["engine"] == "mjx" else ""
    flags = f"--repeats {settings['repeats']} --seed {settings['seed']} --engine {settings['engine']}{impl}"
    return f"iswarm grasp --radius {radii} --rh {humidities} {flags}"


def _evolve(settings: Mapping[str, Any]) -> str:
    names = ("method", "generations", "population", "steps", "evaluations", "seed")
    replicates = f" --replicates {settings['replicates']}" if settings.get("replicates", 1) > 1 else ""
    flags = " ".join(f"--{name} {settings[name]}" for name in names) + replicates + _engine(settings)
    return f"iswarm evolve {flags}{_changed(settings['config'], operators=settings['operators'])}"


def _experiment(settings: Mapping[str, Any]) -> str:
    genome = next((name for name, preset in PRESETS.items() if asdict(preset) == settings["genome"]), "GENOME.json")
    quick = " --quick" if settings["quick"] else ""
    flags = f"--genome {genome} --seed {settings['seed']}{quick}{_engine(settings)}{_changed(settings['config'])}"
    return f"iswarm experiment {settings['experiment']} {flags}"


def _engine(settings: Mapping[str, Any]) -> str:
    """Flags of the engine unless they are the defaults; tables of searches do not contain the default engine."""
    engine, refinement = settings.get("engine", "mujoco"), settings.get("refinement", PlanarSettings.refinement)
    finer = "" if refinement == PlanarSettings.refinement else f" --refinement {refinement}"
    return "" if engine == "mujoco" else f" --engine {engine}{finer}"


def _unlike_the_paper(settings: Mapping[str, Any]) -> list[str]:
    """Values of the arena, and the steps of a search, that differ from the paper's; trials have neither."""
    default = _stored(asdict(ArenaConfig()))
    arena = settings.get("config", {}).get("arena", {})
    found = [f"{_dashed('arena', name)} {value}" for name, value in arena.items() if default.get(name) != value]
    steps = settings.get("steps", Search.steps)
    return found + ([f"{steps} steps"] if steps != Search.steps else [])


def _changed(config: Mapping[str, Any], **others: Mapping[str, Any]) -> str:
    """Flags of the values that differ from the defaults, by groups of the configuration, or `operators`."""
    default = _stored(asdict(SwarmConfig()) | {"operators": asdict(Operators())})
    groups = _stored({**config, **others})
    return "".join(
        f" {_flag(group, name, value)}"
        for group, values in groups.items()
        for name, value in values.items()
        if default.get(group, {}).get(name) != value
    )


def _flag(group: str, name: str, value: Any) -> str:
    """Flag of the command line; that of a Boolean contains its value."""
    if isinstance(value, bool):
        return f"--{_dashed(group, name if value else f'no-{name}')}"
    numbers = " ".join(f"{number:g}" for box in value for number in box) if isinstance(value, list) else value
    return f"--{_dashed(group, name)} {numbers}"


def _stored(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as the metadata of a table has them."""
    return json.loads(json.dumps(settings))


def _dashed(group: str, name: str) -> str:
    return f"{group}.{name}".replace("_", "-")
