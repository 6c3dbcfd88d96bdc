"""Compares candidates: strategies, tasks or settings, in the same worlds, with intervals.

`Candidate` says how the runs of a candidate are made, `gather` carries them out, and `Comparison`
holds what follows from their rows.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj.output.loading import read_result
from iswarm_mj.output.results import about
from iswarm_mj.output.trajectory import RESULT
from iswarm_mj.search.comparison import Comparison, Outcome
from iswarm_mj.search.journal import RUNS, hashed, journal
from iswarm_mj.search.pool import progress
from iswarm_mj.search.settings import DEFAULT_WORLDS, ComparisonPlan
from iswarm_mj.search.sweep import rows_of_result, rows_of_run
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.constraints import check, check_kind
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.extras import require


class Candidate(NamedTuple):
    """What is compared, and how its runs are made."""

    name: str
    steps: int
    """Maximum number of control steps of its runs."""
    make: Callable[[int, int], Run] | None = None
    """Returns the run of so many worlds, from a number on; None for a finished run."""
    identity: str = ""
    """Text of all that determines its runs; they are kept only if there is one."""
    finished: Mapping[str, Any] | None = None
    """Content of the result.json of a finished run."""


def compare(
    candidates: Mapping[str, Any],
    scenario: Scenario | None = None,
    *,
    out: str | Path | None = None,
    **plan: Any,
) -> Comparison:
    """Compare strategies, tasks or scenarios in the same worlds.

    Worlds with the same number have the same layout for all candidates where seed, arena, task and
    number of robots are the same; their values are paired then. Candidates are compared with the
    first one.

    Args:
        candidates: by their names, at least two: scenarios, strategies, tasks, TOML files, or
            directories of finished runs.
        scenario: scenario of the strategies and tasks; by default `Scenario()`.
        out: directory for tables, JSON and figure; None to write nothing.
        **plan: fields of `ComparisonPlan`: worlds, precision, max_worlds, measure, statistic.

    Raises:
        UserError: candidates cannot be compared, or one refuses its settings.
        SimulationFault: fewer than two worlds of a candidate have no fault.
    """
    require("paper")
    check_kind("candidates", candidates, Mapping)
    try:
        checked_plan = ComparisonPlan(**plan)
    except TypeError as error:
        raise UserError(f"compare: {error}") from None
    base = Scenario() if scenario is None else scenario
    check_kind("scenario", base, Scenario)

    made = [_candidate(str(name), value, base) for name, value in candidates.items()]
    directory = None if out is None else Path(out)
    comparison = gather(made, checked_plan, directory)
    if directory is not None:
        comparison.write(directory)
    return comparison


def _candidate(name: str, value: Any, base: Scenario) -> Candidate:
    """Return the candidate that Python names: a scenario, a file, a strategy or a task."""
    if isinstance(value, str | Path):
        path = Path(value)
        if path.is_dir():
            return finished_candidate(name, path)
        check("candidates", str(value), "a directory of a run, or a TOML file", path.is_file())
        value = Scenario.from_toml(path)
    if not isinstance(value, Scenario):
        part = "task" if hasattr(value, "lay_out") else "strategy"
        value = replace(base, **{part: value, f"{part}_name": None})
    return scenario_candidate(name, value)


def scenario_candidate(name: str, scenario: Scenario, identity: str = "") -> Candidate:
    """Return the candidate of a scenario, whose number of worlds the comparison chooses.

    Raises:
        ConfigError: its worlds are no number.
    """
    worlds = scenario.worlds
    check(f"worlds of {name}", worlds, "a number, as all get the same", isinstance(worlds, int))
    return Candidate(name, int(scenario.steps), partial(_run_of_worlds, scenario), identity)


def _run_of_worlds(scenario: Scenario, first: int, n_worlds: int) -> Run:
    """Return the run of some worlds of a scenario's seed, without recordings."""
    worlds: Any = n_worlds
    if first:
        worlds = replace(scenario, worlds=first + n_worlds).list_worlds()[first:]
    return Run(replace(scenario, worlds=worlds), record_worlds=())


def finished_candidate(name: str, directory: Path) -> Candidate:
    """Return the candidate of a finished run.

    Raises:
        UserError: the directory has no result of a finished run of a swarm.
    """
    content = read_result(directory / RESULT)
    if not {"metrics", "n_worlds", "max_steps", "stop_at", "task"} <= content.keys():
        raise UserError(f"{directory} is not of a run of a swarm; name one of clean or run")
    if content.get("interrupted"):
        raise UserError(f"the run in {directory} was interrupted; run it again, or leave it out")
    return Candidate(name, content["max_steps"], finished=content)


def gather(
    candidates: Sequence[Candidate],
    plan: ComparisonPlan,
    out: Path | None = None,
    *,
    again: bool = False,
) -> Comparison:
    """Carry out the runs of candidates, and compare them.

    Args:
        candidates: candidates, the first of which the others are compared with.
        plan: number of worlds, measure and statistic.
        out: directory in which finished runs are kept; None to keep none.
        again: discard the finished runs in `out`.

    Raises:
        UserError: the candidates cannot be compared, or one refuses its settings.
        SimulationFault: fewer than two worlds of a candidate have no fault.
    """
    _check(candidates, plan)
    n_worlds = plan.worlds or _worlds_of_finished(candidates) or DEFAULT_WORLDS
    if plan.precision is not None:
        n_worlds = min(n_worlds, plan.max_worlds)
    keeping = nullcontext()
    if out is not None and any(candidate.identity for candidate in candidates):
        keeping = journal(out / RUNS, {"kind": "compare"}, again)
    with keeping as kept:
        outcomes = [_outcome(candidate) for candidate in candidates]
        while True:
            outcomes = _with_more_worlds(candidates, outcomes, n_worlds, kept)
            comparison = Comparison.of(outcomes, plan.measure, plan.statistic, plan.precision)
            if plan.precision is None or comparison.half_width <= plan.precision:
                return comparison
            if math.isinf(comparison.half_width):  # which no number of worlds changes for certain
                return comparison
            n_next = len(outcomes[0].rows) + n_worlds
            if n_next > plan.max_worlds:
                return comparison

            # The measure stays the one that the first worlds have chosen.
            plan = replace(plan, measure=comparison.measure)


def _check(candidates: Sequence[Candidate], plan: ComparisonPlan) -> None:
    """Refuse too few candidates, equal names, other durations, and finished runs of too few worlds."""
    names = [candidate.name for candidate in candidates]
    check("candidates", ", ".join(names) or "none", "at least two", len(names) > 1)
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise UserError(f"{repeated[0]} is compared with itself; name each candidate once")
    first = candidates[0]
    for candidate in candidates[1:]:
        if candidate.steps != first.steps:
            raise UserError(
                f"{first.name} runs for {first.steps} steps and {candidate.name} for "
                f"{candidate.steps}; give both the same number of steps"
            )
    for candidate in candidates:
        if candidate.finished is not None and candidate.finished["n_worlds"] < 2:
            raise UserError(
                f"the run in {candidate.name} has 1 world; intervals need at least two, see `worlds`"
            )
    finished = [candidate.name for candidate in candidates if candidate.finished is not None]
    if plan.precision is not None and finished:
        raise UserError(
            f"`precision` adds worlds, but the run in {finished[0]} is finished; "
            "leave out one of them"
        )


def _worlds_of_finished(candidates: Sequence[Candidate]) -> int | None:
    """Return the number of worlds of the smallest finished run; None without any."""
    numbers = [each.finished["n_worlds"] for each in candidates if each.finished is not None]
    return min(numbers, default=None)


def _outcome(candidate: Candidate) -> Outcome:
    """Return the outcome of a finished run, or one that has no worlds yet."""
    content = candidate.finished
    if content is None:
        return Outcome(candidate.name)
    rows = rows_of_result(content)
    for fault in content.get("faults", []):
        world = re.search(r"world (\d+)", fault)
        rows[int(world[1]) if world else 0]["fault"] = fault
    return Outcome(candidate.name, rows, dict(content))


def _with_more_worlds(
    candidates: Sequence[Candidate], outcomes: Sequence[Outcome], n_worlds: int, kept: Any
) -> list[Outcome]:
    """Return the outcomes after so many further worlds of all candidates that are not finished."""
    # All are made before the first is carried out, so that what one refuses costs no run.
    batches = [
        None if candidate.make is None else _Batch(candidate, len(outcome.rows), n_worlds, kept)
        for candidate, outcome in zip(candidates, outcomes, strict=True)
    ]
    extended = []
    with progress(len(candidates), "compare") as bar:
        for outcome, batch in zip(outcomes, batches, strict=True):
            if batch is not None:
                rows, settings = batch.carry_out()
                outcome = Outcome(outcome.name, [*outcome.rows, *rows], settings)
            extended.append(outcome)
            bar.update()
    return extended


class _Batch:
    """Some worlds of a candidate, whose run is carried out once."""

    def __init__(self, candidate: Candidate, first: int, n_worlds: int, kept: Any):
        """Make the run, unless its outcome is kept.

        Args:
            candidate: candidate with a function that makes its runs.
            first: number of the first world.
            n_worlds: number of worlds.
            kept: journal of finished runs; None without one.

        Raises:
            UserError: the candidate refuses its settings.
        """
        assert candidate.make is not None
        self._name = candidate.name
        self._first = first
        self._key = hashed(f"{candidate.identity} {first} {n_worlds}")
        self._journal = kept if candidate.identity else None
        self._kept = None if self._journal is None else self._journal.entries.get(self._key)
        self._run = None
        if self._kept is None:
            with _named_errors(self._name):
                self._run = candidate.make(first, n_worlds)

    def carry_out(self) -> tuple[list[dict[str, Any]], dict[str, Any]]:
        """Return the rows and settings of the worlds.

        Raises:
            UserError: the code of the candidate fails.
        """
        if self._kept is not None:
            rows, settings = self._kept
            return rows, settings

        run = self._run
        assert run is not None
        self._run = None  # worlds need no memory after their end
        with _named_errors(self._name):
            rows = rows_of_run(run)
        for number, row in enumerate(rows, start=self._first):
            row["world"] = number
        settings = about(run)
        if self._journal is not None:
            self._journal.add(self._key, [rows, settings])
        return rows, settings


@contextmanager
def _named_errors(name: str) -> Iterator[None]:
    """Let errors begin with the name of a candidate."""
    try:
        yield
    except UserError as error:
        raise UserError(f"{name}: {error}") from None
    except SimulationFault as error:
        raise SimulationFault(f"{name}: {error}") from None
