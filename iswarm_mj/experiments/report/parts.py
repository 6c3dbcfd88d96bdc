"""The parts of a directory of results: what each is made of, whether a table is it, and how it is made."""

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj import __version__
from iswarm_mj.engines.registry import IDENTITY
from iswarm_mj.experiments.analysis.findings import Rows
from iswarm_mj.experiments.report.results import METHODS, SEARCH, TRIALS
from iswarm_mj.experiments.runner.experiment import Experiment, Plan, run_experiment, settings_of
from iswarm_mj.experiments.runner.pool import Execution
from iswarm_mj.experiments.runner.search import run_searches
from iswarm_mj.experiments.runner.search import settings_of as settings_of_search
from iswarm_mj.experiments.runner.search_settings import Search
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, remove
from iswarm_mj.utils.lock import locked
from iswarm_mj.utils.tables import read_table
from iswarm_mj.workflows.grasp import run_grasp
from iswarm_mj.workflows.grasp_settings import GraspSettings

OWN_ENGINE: Mapping[str, Mapping[str, Any]] = {
    name: {"engine": "planar", "refinement": 1} for name in ("time-step", "resolved-grasps")
}
"""Experiments that are about an engine, or have too many runs for others, and its settings."""
PUBLISHED = ("*.png", "best*.json")
"""What is kept of a part beside its table."""


class Plans(NamedTuple):
    """Settings of all parts."""

    experiment: Plan
    search: Search
    """Its method is replaced."""
    trials: GraspSettings


@dataclass(frozen=True)
class Part:
    """A directory of results with one table."""

    name: str
    """Of the directory."""
    table: str
    """Name of the table's file."""
    settings: Mapping[str, Any]
    """That the table contains."""
    is_whole: Callable[[Rows], bool]
    """Whether rows are those of all runs."""
    make: Callable[[Path, bool], Any] | tuple[Search, Execution]
    """What writes the results into a directory, going on with what is there unless it is told to begin again; or a
    search, which advances together with others."""

    def lacks(self, results: Path, same_engine: bool = False) -> str:
        """Why the part has to be made, in words; empty if its table is there.

        Args:
            results: directory of all parts.
            same_engine: whether a table that another engine computed does not do.
        """
        path = results / self.name / self.table
        if not path.is_file():
            return "not there"
        try:
            rows, settings = read_table(path)
        except UserError:
            return "not readable"
        wanted = json.loads(json.dumps({**self.settings, "version": __version__}))
        ignored = () if same_engine or self.name in OWN_ENGINE else IDENTITY
        names = {name for name in {*wanted, *settings} if wanted.get(name) != settings.get(name)}.difference(ignored)
        if names:
            return f"made with another {', another '.join(sorted(names))}"
        return "" if self.is_whole(rows) else "made of other runs"

    def publish(self, work: Path, results: Path) -> None:
        """Copy the table, the figures and the best genomes from the directory where they were made; remove older ones.

        Raises:
            UserError: they cannot be written.
        """
        target = results / self.name
        made = [path for pattern in PUBLISHED for path in work.glob(pattern)]
        with locked(target):
            for path in {path for pattern in PUBLISHED for path in target.glob(pattern)}:
                if not (work / path.name).exists():
                    remove(path)
            for path in [work / self.table, *made]:
                with atomic_write(target / path.name) as part:
                    shutil.copyfile(path, part)


def parts_of(plans: Plans, execution: Execution) -> dict[str, Part]:
    """All parts by their names, searches last, since they take longest."""
    found = [_trials(plans.trials)]
    found += [_experiment(each, plans.experiment, execution) for each in EXPERIMENTS.values()]
    found += [_search(replace(plans.search, method=method), execution) for method in METHODS]
    return {part.name: part for part in found}


def _trials(settings: GraspSettings) -> Part:
    def make(out: Path, again: bool) -> None:
        run_grasp(settings, out, record=())

    return Part("grasp", TRIALS, settings.metadata(), bool, make)


def _experiment(experiment: Experiment, plan: Plan, execution: Execution) -> Part:
    own = replace(execution, **OWN_ENGINE.get(experiment.name, {}))
    seeds = [entry.job.seed for entry in experiment.entries(plan)]

    def make(out: Path, again: bool) -> None:
        run_experiment(experiment, plan, out, own, again)

    def is_whole(rows: Rows) -> bool:
        return [row["seed"] for row in rows] == seeds

    return Part(experiment.name, experiment.table, settings_of(experiment, plan, own), is_whole, make)


def make(parts: Sequence[Part], work: Path, again: bool) -> Iterator[tuple[Part, UserError | None]]:
    """Make parts in directories of their own names, searches together at last.

    Yields:
        Each part when it is there, and None; or a part that is left out, and why.

    Raises:
        UserError: searches that were begun cannot go on.
        SimulationFault: a run could not go on.
    """
    searches: dict[Path, Search] = {}
    execution = None
    for part in parts:
        if isinstance(part.make, tuple):
            searches[work / part.name], execution = part.make
            continue
        error = None
        try:
            part.make(work / part.name, again)
        except UserError as found:
            error = found
        yield part, error
    refused: dict[Path, UserError] = {}
    if searches:
        run_searches(searches, execution, resume=True, again=again, refused=refused)
    yield from ((part, refused.get(work / part.name)) for part in parts if isinstance(part.make, tuple))


def _search(settings: Search, execution: Execution) -> Part:
    n_rows = settings.generations * settings.n_runs

    def is_whole(rows: Rows) -> bool:
        return len(rows) == n_rows

    name, own = f"evolve-{settings.method}", settings_of_search(settings, execution)
    return Part(name, SEARCH, own, is_whole, (settings, execution))
