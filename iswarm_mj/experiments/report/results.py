"""Tables of experiments, searches and trials that are found in directories of results."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj.experiments.analysis.findings import Rows
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.tables import read_table

SEARCH, TRIALS = "evolution.parquet", "trials.parquet"


_NAMES = {TRIALS, SEARCH, *(experiment.table for experiment in EXPERIMENTS.values())}


class Result(NamedTuple):
    """A table of results."""

    path: Path
    rows: Rows
    settings: Mapping[str, Any]


@dataclass
class Results:
    """The tables that a report is based on."""

    experiments: dict[str, Result] = field(default_factory=dict)
    """By the name of the experiment."""
    searches: dict[str, Result] = field(default_factory=dict)
    """By the method."""
    trials: Result | None = None
    """Of the gripper's bench."""
    left_out: list[Path] = field(default_factory=list)
    """Tables that are not used because another one of the same kind has more runs."""
    unusable: list[Path] = field(default_factory=list)
    """Tables of the right names that are damaged, or hold something else."""

    @property
    def used(self) -> list[Result]:
        """All tables but those left out."""
        trials = [self.trials] if self.trials else []
        return [*trials, *self.searches.values(), *self.experiments.values()]


def collect(directories: Sequence[Path]) -> Results:
    """Read all tables below the directories.

    If there are several tables of a kind, the one with the most rows is used; one made with --quick only if there is
    no other.

    Raises:
        UserError: a directory does not exist.
    """
    kinds: dict[tuple[str, str], list[Result]] = {}
    results = Results()
    for directory in directories:
        if not directory.is_dir():
            raise ConfigError("results", directory, "an existing directory with results")
        for path in files_in(directory, "**/*.parquet"):
            result = _read(path)
            if result is None and path.name in _NAMES:
                results.unusable.append(path)
            elif result is not None and (kind := _kind(result)):
                kinds.setdefault(kind, []).append(result)
    for (kind, name), found in kinds.items():
        best = max(found, key=lambda result: (not result.settings.get("quick"), len(result.rows)))
        results.left_out += [result.path for result in found if result is not best]
        if kind == "trials":
            results.trials = best
        else:
            getattr(results, kind)[name] = best
    return results


def files_in(directory: Path, pattern: str) -> Iterator[Path]:
    """Yield the files that match a pattern, sorted, without those reached by links that lead out of the directory."""
    inside = directory.resolve()
    for path in sorted(directory.glob(pattern)):
        if path.is_file() and path.resolve().is_relative_to(inside):
            yield path


def _read(path: Path) -> Result | None:
    try:
        return Result(path, *read_table(path))
    except UserError:
        return None


def _kind(result: Result) -> tuple[str, str] | None:
    """Kind of a table, and its name within the kind; None for a table that a report does not use."""
    file, settings = result.path.name, result.settings
    if not result.rows:
        return None
    if file == TRIALS:
        return "trials", ""
    if file == SEARCH and "method" in settings:
        return "searches", settings["method"]
    name = str(settings.get("experiment"))
    return ("experiments", name) if name in EXPERIMENTS and file == EXPERIMENTS[name].table else None
