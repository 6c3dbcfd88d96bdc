"""Which results there are: tables of experiments, of searches and of trials, looked for in directories."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.experiments.analysis.findings import Rows
from iswarm_mj.experiments.runner.search import Search
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.strategy.evolution import Operators
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import read_table

SEARCH, TRIALS = "evolution.parquet", "trials.parquet"


class Result(NamedTuple):
    """A table that was read."""

    path: Path
    rows: Rows
    settings: Mapping[str, Any]


@dataclass
class Results:
    """The tables that a report is made of."""

    experiments: dict[str, Result] = field(default_factory=dict)
    """By the experiment's name."""
    searches: dict[str, Result] = field(default_factory=dict)
    """By the method."""
    trials: Result | None = None
    """Of the gripper's bench."""
    left_out: list[Path] = field(default_factory=list)
    """Tables that were not used, since another one of the kind has more runs."""


def collect(directories: Sequence[Path]) -> Results:
    """Read all tables below the directories. Of each kind the one with the most rows counts, those of --quick last.

    Raises:
        UserError: there is no such directory.
    """
    results = Results()
    kinds: dict[tuple[str, str], list[Result]] = {}
    for directory in directories:
        if not directory.is_dir():
            raise UserError(f"--results was {directory}; it must be a directory with results: give one that is there.")
        for path in sorted(directory.rglob("*.parquet")):
            found = _read(path)
            if found is not None:
                kinds.setdefault(found[0], []).append(found[1])
    for (kind, name), found in kinds.items():
        best = max(found, key=lambda result: (not result.settings.get("quick"), len(result.rows)))
        results.left_out += [result.path for result in found if result is not best]
        if kind == "experiment":
            results.experiments[name] = best
        elif kind == "search":
            results.searches[name] = best
        else:
            results.trials = best
    return results


def command(result: Result) -> str:
    """Command line that makes a table again, in an empty directory; a comment where it has not the paper's setting."""
    apart = _not_the_papers(result.settings)
    return _command(result) + (f"  # not the paper's setting: {', '.join(apart)}" if apart else "")


def _command(result: Result) -> str:
    settings = result.settings
    if result.path.name == TRIALS:
        radii, rh = (" ".join(f"{v:g}" for v in settings[name]) for name in ("radii", "humidities"))
        impl = f" --impl {settings['impl']}" if settings["engine"] == "mjx" else ""
        told = f"--repeats {settings['repeats']} --seed {settings['seed']} --engine {settings['engine']}{impl}"
        return f"iswarm grasp --radius {radii} --rh {rh} {told} --out DIR"
    if result.path.name == SEARCH:
        operators = {"operators": settings["operators"]}
        names = ("method", "generations", "population", "steps", "evaluations", "seed")
        told = " ".join(f"--{name} {settings[name]}" for name in names) + _engine(settings)
        return f"iswarm evolve {told}{_changed(settings['config'])}{_changed(operators)} --out DIR"
    presets = [name for name, genome in PRESETS.items() if asdict(genome) == settings["genome"]]
    genome = presets[0] if presets else "GENOME.json"
    quick = " --quick" if settings["quick"] else ""
    told = f"--genome {genome} --seed {settings['seed']}{quick}{_engine(settings)}"
    return f"iswarm experiment {settings['experiment']} {told}{_changed(settings['config'])} --out DIR"


def _read(path: Path) -> tuple[tuple[str, str], Result] | None:
    """Kind, name and content of a table; None if it is none that a report reads."""
    try:
        rows, settings = read_table(path)
    except UserError:
        return None
    result = Result(path, rows, settings)
    name = settings.get("experiment")
    if not rows:
        return None
    if path.name == TRIALS:
        return ("trials", ""), result
    if path.name == SEARCH and "method" in settings:
        return ("search", settings["method"]), result
    if name in EXPERIMENTS and path.name == EXPERIMENTS[name].table:
        return ("experiment", str(name)), result
    return None


def _engine(settings: Mapping[str, Any]) -> str:
    """Flag of the engine unless it is the default; tables of searches do not name that."""
    engine = settings.get("engine", "mujoco")
    return "" if engine == "mujoco" else f" --engine {engine}"


def _not_the_papers(settings: Mapping[str, Any]) -> list[str]:
    """Values of the arena, and the steps of a search, that are not the paper's; trials have neither."""
    usual = asdict(ArenaConfig())
    arena = settings.get("config", {}).get("arena", {})
    apart = [f"arena.{name.replace('_', '-')} {value}" for name, value in arena.items() if usual.get(name) != value]
    steps = settings.get("steps", Search.steps)
    return apart + ([f"{steps} steps"] if steps != Search.steps else [])


def _changed(given: Mapping[str, Mapping[str, Any]]) -> str:
    """Flags of the values that are not the defaults, by the parts of the configuration, or `operators`."""
    usual = asdict(SwarmConfig()) | {"operators": asdict(Operators())}
    return "".join(
        f" {_flag(f'{part}.{name}'.replace('_', '-'), value)}"
        for part, values in given.items()
        for name, value in values.items()
        if usual.get(part, {}).get(name) != value
    )


def _flag(name: str, value: Any) -> str:
    """Option of the command line; a truth value is in its name."""
    if isinstance(value, bool):
        part, _, last = name.rpartition(".")
        return f"--{name}" if value else f"--{part}.no-{last}"
    return f"--{name} {value}"
