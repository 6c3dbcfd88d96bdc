"""All results by their parts, the findings on them, the report, and the tables of pages."""

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
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
from iswarm_mj.paper.report.beside_paper import DIRECTORY
from iswarm_mj.paper.report.html_report import write_report
from iswarm_mj.paper.report.page_blocks import ResultBlocks, changed_pages
from iswarm_mj.paper.report.paper_figures import write_figures
from iswarm_mj.paper.report.results import GRASP, SEARCH, TRIALS, collect_results, topics_of
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

PLANAR_ONLY = ("time-step", "resolved-grasps")
"""Experiments that are made with planar whichever engine is asked for: they are about its time
step, or have too many runs for other engines."""
PUBLISHED = ("*.png", "best*.json")
"""Patterns of the files of a part that are kept beside its table."""


@dataclass(frozen=True)
class Part:
    """A directory of results with one table."""

    name: str
    """Name of the directory."""
    table: str
    """Name of the table's file."""
    settings: Mapping[str, Any]
    """Settings that the table contains."""
    make: Callable[..., Any]
    """Writes the results into a directory, resuming what is there unless called with `again`."""

    def reason_to_make(self, results: Path) -> str:
        """Return why the part has to be made; an empty text if its table is there.

        A table made with another engine is as good, except for parts that are about an engine.

        Args:
            results: directory of the parts.
        """
        path = results / self.name / self.table
        if not path.is_file():
            return "not there"
        try:
            _, settings = read_table(path)
        except UserError:
            return "not readable"

        # As JSON, since tables store their settings so.
        wanted = json.loads(json.dumps({**self.settings, "version": __version__}))
        ignored = set() if self.name in PLANAR_ONLY else set(IDENTITY)
        names = (wanted.keys() | settings.keys()) - ignored
        differing = sorted(name for name in names if wanted.get(name) != settings.get(name))
        return f"made with another {', another '.join(differing)}" if differing else ""

    def publish(self, work: Path, results: Path) -> None:
        """Copy the table, the figures and the best genomes into the results; remove older ones.

        Args:
            work: where the part was made.
            results: directory of the parts.
        """
        target = results / self.name
        with locked(target):
            for path in _published(target):
                remove(path)
            for path in (work / self.table, *_published(work)):
                with atomic_write(target / path.name) as part:
                    shutil.copyfile(path, part)


def _published(directory: Path) -> list[Path]:
    """Return the files of a directory that are kept beside its table."""
    return [path for pattern in PUBLISHED for path in directory.glob(pattern)]


def parts_of(
    plan: Plan, execution: Execution, replicates: int, repeats: int, only: Sequence[str] = ()
) -> list[Part]:
    """Return the parts of the results; searches come last, since they take longest.

    Quick searches and trials are just enough for each step to be taken.

    Args:
        plan: settings of the experiments.
        execution: how runs are executed.
        replicates: replicates of each search.
        repeats: grasps at each radius and humidity.
        only: names of the parts; all if there are none.

    Raises:
        ConfigError: there is no part of a name.
    """
    parts = [
        _trials_part(plan, repeats),
        *_experiment_parts(plan, execution),
        *_search_parts(plan, execution, replicates),
    ]
    names = [part.name for part in parts]
    check("only", " ".join(only), " or ".join(names), set(only) <= set(names))
    return [part for part in parts if not only or part.name in only]


def _trials_part(plan: Plan, repeats: int) -> Part:
    """Return the part of the trials on the gripper's bench."""
    trials = GraspSettings(
        ("15e-6:25e-6:6",),
        (5.0, 10.0, 30.0, 50.0),
        repeats=1 if plan.quick else repeats,
        seed=plan.seed,
        protocol=Protocol(transport=TRANSPORT),
        contacts=Contacts(rolling=50e-9),
    )

    def make(out: Path, *, again: bool) -> None:
        # Trials are not resumed: they are made again in any case.
        run_grasp(trials, out, record=())

    return Part(GRASP, TRIALS, trials.metadata(), make)


def _experiment_parts(plan: Plan, execution: Execution) -> Iterator[Part]:
    """Yield the parts of the experiments."""
    planar = replace(execution, engine=PlanarSettings.usual())
    for name, experiment in EXPERIMENTS.items():
        own_execution = planar if name in PLANAR_ONLY else execution
        settings = settings_of(experiment, plan, own_execution)
        make = partial(run_experiment, experiment, plan, execution=own_execution)
        yield Part(name, experiment.table, settings, make)


def _search_parts(plan: Plan, execution: Execution, replicates: int) -> Iterator[Part]:
    """Yield the parts of the searches by each method."""
    # Densities reach up to 0.5, since a batch waits for its densest world.
    scenario = Scenario(plan.config, engine=execution.engine, seed=plan.seed)
    search = Search(replicates=replicates, operators=Operators(density_max=0.5), scenario=scenario)
    if plan.quick:
        short = replace(scenario, steps=60)
        search = replace(search, generations=3, population=4, replicates=2, scenario=short)

    for method in METHODS:
        search_by_method = replace(search, method=method)
        settings = settings_of_search(search_by_method, execution)
        make = partial(run_search, search_by_method, execution=execution)
        yield Part(f"evolve-{method}", SEARCH, settings, make)


def listing(parts: Sequence[Part], results: Path) -> str:
    """Return which parts are there and which have to be made, a line each."""
    width = max(len(part.name) for part in parts)
    return "\n".join(
        f"{part.name:{width}}  {part.reason_to_make(results) or 'there'}" for part in parts
    )


def reproduce(
    parts: Sequence[Part], results: Path, out: Path, pages: Sequence[Path], *, again: bool = False
) -> None:
    """Make the parts that are not there, then findings, tables and the report from all results.

    A part is made in a directory of its own, from which it can be resumed after an interruption.
    Its table, figures and best genomes are copied into the results when it is complete.

    Args:
        parts: parts to make.
        results: directory of the parts.
        out: where parts are made, a directory each, and directory of the report.
        pages: Markdown files with blocks of results.
        again: make all parts, from the beginning.
    """
    make_output_directory(results, setting="results")
    with locked(out):
        print(listing(parts, results), flush=True)
        for part in parts:
            if again or part.reason_to_make(results):
                part.make(out / part.name, again=again)
                part.publish(out / part.name, results)
        rewrite_findings(results, pages)
        write_report([results], out / "report.html")


def rewrite_findings(results: Path, pages: Sequence[Path]) -> None:
    """Write the findings beside the tables, and the blocks of the pages, from existing results.

    The figures of the comparison with the paper are drawn, too. Nothing is written if a block has an unknown name.

    Args:
        results: directory of the parts.
        pages: Markdown files with blocks of results.
    """
    all_results = collect_results([results])
    topics = topics_of(all_results)
    new_texts = changed_pages(pages, ResultBlocks().content)

    with locked(results):
        for topic in topics:
            if topic.results:
                # Those on evolutions stand beside the first table of a search.
                path = topic.results[0].path.with_name(FINDINGS)
                write_csv(path, [finding._asdict() for finding in topic.findings])
        write_figures(all_results, results / DIRECTORY)
    for path, text in new_texts.items():
        with atomic_write(path) as part:
            part.write_text(text, encoding="utf-8")

    print(f"findings in {results}, figures beside the paper's in {results / DIRECTORY}")
    for path in new_texts:
        print(f"tables in {path}")
