"""All results by their parts, the findings on them, the report, and the tables of README and
docs."""

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from iswarm_mj._version import __version__
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import IDENTITY
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.paper.analysis.bench_statements import TRANSPORT
from iswarm_mj.paper.report.results import GRASP, SEARCH, TRIALS, collect, report, topics_of
from iswarm_mj.paper.report.tables import Tables, new_texts
from iswarm_mj.paper.studies.experiment import FINDINGS, Plan, run_experiment, settings_of
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.search.methods import METHODS, Operators
from iswarm_mj.search.pool import Execution
from iswarm_mj.search.search import Search, run_search
from iswarm_mj.search.search import settings_of as settings_of_search
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.directory_lock import locked
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, make_output_directory, remove
from iswarm_mj.utils.tables import read_table, write_csv
from iswarm_mj.workflows.grasp import run_grasp
from iswarm_mj.workflows.grasp_settings import GraspSettings

OWN_ENGINE = ("time-step", "resolved-grasps")
"""Experiments that are about planar with MuJoCo's time step, or have too many runs for others."""
PUBLISHED = ("*.png", "best*.json")
"""What is kept of a part beside its table."""


@dataclass(frozen=True)
class Part:
    """A directory of results with one table."""

    name: str
    """Of the directory."""
    table: str
    """Name of the table's file."""
    settings: Mapping[str, Any]
    """That the table contains."""
    make: Callable[..., Any]
    """Writes the results into a directory, resuming what is there unless called with `again`."""

    def lacks(self, results: Path) -> str:
        """Why the part has to be made, in words; empty if its table is there below `results`, of
        whichever engine."""
        path = results / self.name / self.table
        if not path.is_file():
            return "not there"
        try:
            _, settings = read_table(path)
        except UserError:
            return "not readable"
        wanted = json.loads(json.dumps({**self.settings, "version": __version__}))
        ignored = () if self.name in OWN_ENGINE else IDENTITY
        names = {
            name for name in {*wanted, *settings} if wanted.get(name) != settings.get(name)
        }.difference(ignored)
        return f"made with another {', another '.join(sorted(names))}" if names else ""

    def publish(self, work: Path, results: Path) -> None:
        """Copy the table, the figures and the best genomes from where they were made; remove older
        ones."""
        target = results / self.name
        made = [work / self.table, *(path for pattern in PUBLISHED for path in work.glob(pattern))]
        with locked(target):
            for path in {path for pattern in PUBLISHED for path in target.glob(pattern)}:
                remove(path)
            for path in made:
                with atomic_write(target / path.name) as part:
                    shutil.copyfile(path, part)


def parts_of(
    plan: Plan, execution: Execution, replicates: int, repeats: int, only: Sequence[str] = ()
) -> list[Part]:
    """Parts of these names, all if there are none; searches last, since they take longest.

    Searches have densities up to 0.5, since a batch waits for its densest world. Quick searches and
    trials are just enough for each step to be taken. `replicates` are of each search, `repeats`
    grasps at each radius and humidity.
    """
    scenario = Scenario(plan.config, engine=execution.engine, seed=plan.seed)
    search = Search(replicates=replicates, operators=Operators(density_max=0.5), scenario=scenario)
    if plan.quick:
        quick = replace(scenario, steps=60)
        search = replace(search, generations=3, population=4, replicates=2, scenario=quick)
        repeats = 1
    trials = GraspSettings(
        ("15e-6:25e-6:6",),
        (5.0, 10.0, 30.0, 50.0),
        repeats=repeats,
        seed=plan.seed,
        protocol=Protocol(transport=TRANSPORT),
        contacts=Contacts(rolling=50e-9),
    )
    found = [
        Part(GRASP, TRIALS, trials.metadata(), lambda out, again: run_grasp(trials, out, record=()))
    ]
    planar = replace(execution, engine=replace(PlanarSettings.usual(), refinement=1))
    for name, each in EXPERIMENTS.items():
        own = planar if name in OWN_ENGINE else execution
        make = partial(run_experiment, each, plan, execution=own)
        found.append(Part(name, each.table, settings_of(each, plan, own), make))
    for one in (replace(search, method=method) for method in METHODS):
        make = partial(run_search, one, execution=execution)
        found.append(Part(f"evolve-{one.method}", SEARCH, settings_of_search(one, execution), make))
    check(
        "only",
        " ".join(only),
        " or ".join(part.name for part in found),
        {*only} <= {part.name for part in found},
    )
    return [part for part in found if not only or part.name in only]


def listing(parts: Sequence[Part], results: Path) -> str:
    """What is there and what has to be made, a line each."""
    width = max(len(part.name) for part in parts)
    return "\n".join(f"{part.name:{width}}  {part.lacks(results) or 'there'}" for part in parts)


def reproduce(
    parts: Sequence[Part], results: Path, out: Path, pages: Sequence[Path], again: bool = False
) -> None:
    """Make the parts that are not there, then findings, tables and the report from all results.

    A part is made in a directory of its own, from which it can go on after an interruption, and its
    table, figures and best genomes are copied into the results when it is complete.

    Args:
        parts: to make.
        results: directory of the parts.
        out: where parts are made, a directory each, and of the report.
        pages: Markdown files with blocks of results.
        again: make all of them, from the beginning.
    """
    make_output_directory(results, setting="results")
    with locked(out):
        print(listing(parts, results), flush=True)
        for part in parts:
            if again or part.lacks(results):
                part.make(out / part.name, again=again)
                part.publish(out / part.name, results)
        rewrite(results, pages)
        report([results], out / "report.html")


def rewrite(results: Path, pages: Sequence[Path]) -> None:
    """Write the findings beside the tables, and the blocks of the pages, from the results that are
    there; nothing if a block has an unknown name."""
    topics, texts = topics_of(collect([results])), new_texts(pages, Tables().content)
    with locked(results):
        for topic in topics:
            if topic.results:  # of the evolution beside its first table
                path = topic.results[0].path.with_name(FINDINGS)
                write_csv(path, [finding._asdict() for finding in topic.findings])
    for path, text in texts.items():
        with atomic_write(path) as part:
            part.write_text(text, encoding="utf-8")
    print(f"findings in {results}" + "".join(f"\ntables in {path}" for path in texts))
