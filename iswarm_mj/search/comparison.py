"""Comparison of the worlds of several candidates: effects, sentences, tables and files."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.search.effects import LEAST_WORLDS, Effect, effect, estimate
from iswarm_mj.search.rows import FINISHED, Row, values_of
from iswarm_mj.search.settings import StatisticName
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.files import atomic_write, flat, make_output_directory
from iswarm_mj.utils.intervals import LEVEL, Interval
from iswarm_mj.utils.tables import aligned, write_table

TABLE = "compare.parquet"
CONTENT = "compare.json"
FIGURE = "compare"
_NO_MEASURES = ("candidate", "seed", "world", "n_robots", "max_steps", "goal", "fault")
"""Columns of the table that are no measures."""
_OF_LAYOUTS = ("version", "settings.seed", "settings.n_robots", "settings.failed_fraction")
"""Settings on which layouts depend, beside those of `_GROUPS_OF_LAYOUTS`."""
_GROUPS_OF_LAYOUTS = ("config.arena.", "task.", "robot.")
_STOP_AT = "settings.stop_at"
"""Setting that is a difference only where it leads to another goal."""
_NO_DIFFERENCES = ("settings.n_worlds", "settings.capacity")
"""Settings in which candidates may differ without a word."""
_MAX_NAMED = 4
"""Maximum number of settings that a sentence names."""


class Outcome(NamedTuple):
    """Worlds of a candidate."""

    name: str
    rows: Sequence[Row] = ()
    """A row for each world, see `sweep.rows_of_result`."""
    about: Mapping[str, Any] = {}
    """Settings of its run, as result.json has them."""


@dataclass(frozen=True)
class Comparison:
    """Worlds of several candidates, and how those of each further one compare with the first's.

    Intervals are at `LEVEL`, see `effects.estimate` and `effects.effect`.
    """

    outcomes: tuple[Outcome, ...]
    """Worlds of each candidate."""
    measure: str
    """Measure that the result is about."""
    statistic: StatisticName
    """Statistic over worlds."""
    estimates: dict[str, dict[str, Interval]]
    """Statistic of each measure over all worlds without a fault, by candidate and measure."""
    effects: dict[str, dict[str, Effect]]
    """Effect on each measure that is known in two worlds, by further candidate and measure."""
    precision: float | None = None
    """Largest `half_width` that was asked for."""

    @classmethod
    def of(
        cls,
        outcomes: Sequence[Outcome],
        measure: str | None,
        statistic: StatisticName,
        precision: float | None = None,
    ) -> Self:
        """Compare candidates.

        Args:
            outcomes: worlds of each candidate.
            measure: measure that the result is about; None for the default.
            statistic: statistic over worlds.
            precision: largest `half_width` that was asked for.

        Raises:
            UserError: the candidates have no such measure, or stop at different goals.
            SimulationFault: fewer than two worlds of a candidate have no fault.
        """
        for outcome in outcomes:
            _refuse_faults(outcome)
            _refuse_other_goal(outcomes[0], outcome)
        common = _common_measures(outcomes)
        if measure is None:
            measure = _default_measure(outcomes, common)
        check("measure", measure, f"one of {', '.join(common)}", measure in common)

        estimates: dict[str, dict[str, Interval]] = {}
        for outcome in outcomes:
            estimates[outcome.name] = {}
            for name in common:
                values = _values(outcome, name)
                known = values[~np.isnan(values)]
                if len(known) > 1:
                    estimates[outcome.name][name] = estimate(known, statistic)
        effects = {
            outcome.name: _effects(outcomes[0], outcome, common, statistic)
            for outcome in outcomes[1:]
        }
        for name, effects_of_candidate in effects.items():
            if measure not in effects_of_candidate:
                raise UserError(
                    f"{measure} of {name} and {outcomes[0].name} is known in fewer than two "
                    "worlds; run more worlds, or choose another `measure`"
                )
        return cls(tuple(outcomes), measure, statistic, estimates, effects, precision)

    @property
    def names(self) -> list[str]:
        """Names of the candidates."""
        return [outcome.name for outcome in self.outcomes]

    def differs_in(self, name: str) -> list[str]:
        """Return the names of the settings in which a candidate differs from the first one."""
        outcome = next(each for each in self.outcomes if each.name == name)
        return differences(self.outcomes[0], outcome)

    @property
    def half_width(self) -> float:
        """Half of the widest interval of a difference, as a share of the first candidate's value.

        It is infinite if that value is 0.
        """
        shares = []
        for effects in self.effects.values():
            result = effects[self.measure]
            width = result.difference.high - result.difference.low
            shares.append(width / 2 / abs(result.first) if result.first else math.inf)
        return max(shares)

    def sentences(self) -> list[str]:
        """Return the result: for each further candidate, and on worlds that did not finish."""
        sentences = [self._sentence(name) for name in self.effects]
        sentences += [self._other_measures(name) for name in self.effects]
        sentences += filter(None, map(_unfinished_sentence, self._outcomes_of_times()))
        sentences += filter(None, map(_fault_sentence, self.outcomes))
        sentences += filter(None, [self._precision_sentence()])
        for outcome in self.outcomes[1:]:
            sentences += _settings_sentences(self.outcomes[0], outcome)
        return sentences

    def _precision_sentence(self) -> str:
        """Return by how much the precision was missed; empty if none was asked for, or met."""
        if self.precision is None or self.half_width <= self.precision:
            return ""
        first = f"{self.names[0]}'s {self.statistic}"
        if math.isinf(self.half_width):
            return f"The precision is a share of {first}, which is 0; no more worlds are added."
        return (
            f"Half the interval of the difference is {100 * self.half_width:.3g} % of {first}, "
            f"more than the precision of {100 * self.precision:g} %; more worlds make it narrower."
        )

    def _outcomes_of_times(self) -> tuple[Outcome, ...]:
        """Return the candidates if the result is about the step of finishing, otherwise none."""
        return self.outcomes if self.measure == FINISHED else ()

    def _sentence(self, name: str) -> str:
        """Return the result for a further candidate and the measure of the comparison."""
        first = self.names[0]
        result = self.effects[name][self.measure]
        difference = result.difference
        numbers = (
            f"{number_text(result.second)} against {number_text(result.first)}, "
            f"difference {interval_text(difference)}, A {result.superiority.estimate:.2f}"
        )
        worlds = _worlds_text(result)
        what = f"{self.statistic} {self.measure}"
        if result.is_decided:
            direction = "higher" if difference.estimate > 0 else "lower"
            return f"{name} has a {direction} {what} than {first}: {numbers}, in {worlds}."
        if not result.worlds_differ:
            return f"{name} and {first} have the same {what} in all of {worlds}."
        if not result.has_enough_worlds:
            return (
                f"{name} against {first}, {what}: {numbers}, in {worlds}; fewer than "
                f"{LEAST_WORLDS} worlds decide nothing."
            )
        if not any(difference):
            return (
                f"{name} and {first} have the same {what}, though worlds differ: {numbers}, in "
                f"{worlds}."
            )
        bounds = f"{number_text(difference.low)} and {number_text(difference.high)}"
        return (
            f"It is not decided whether {name} or {first} has the higher {what}: {numbers}, in "
            f"{worlds}; effects between {bounds} are possible."
        )

    def _other_measures(self, name: str) -> str:
        """Return which other measures of a candidate are decided, not decided, and not compared."""
        others = {
            measure: result
            for measure, result in self.effects[name].items()
            if measure != self.measure and result.worlds_differ
        }
        decided = [measure for measure, result in others.items() if result.is_decided]
        undecided = [measure for measure in others if measure not in decided]
        parts = []
        if decided:
            parts.append(f"also differ: {', '.join(decided)}")
        if undecided:
            parts.append(f"undecided: {', '.join(undecided)}")
        if not others:
            parts.append("no other measure differs")
        not_compared = self._not_compared(name)
        if not_compared:
            parts.append(f"not compared: {', '.join(not_compared)}")
        level = f"{100 * LEVEL.get():g} %"
        return f"{name}, measures taken one by one at {level}: {'; '.join(parts)}."

    def _not_compared(self, name: str) -> list[str]:
        """Return measures that some worlds know, but not two of each candidate."""
        measures = dict.fromkeys(chain.from_iterable(map(_measures, self.outcomes)))
        rows = [row for outcome in self.outcomes for row in outcome.rows]
        return [
            measure
            for measure in measures
            if measure not in self.effects[name]
            and any(row.get(measure) is not None for row in rows)
        ]

    def table(self) -> list[str]:
        """Return a table with a line for each further candidate and measure."""
        first = self.names[0]
        headings = ["candidate", "measure", self.statistic, first, "difference", "ratio", "A"]
        lines = [headings]
        for name, effects in self.effects.items():
            others = [
                measure
                for measure, result in effects.items()
                if measure != self.measure and result.worlds_differ
            ]
            for measure in (self.measure, *others):
                result = effects[measure]
                values = [number_text(result.second), number_text(result.first)]
                ratio = "-" if result.ratio is None else interval_text(result.ratio)
                superiority = "{:.2f} ({:.2f} to {:.2f})".format(*result.superiority)
                texts = [interval_text(result.difference), ratio, superiority]
                lines.append([name, measure, *values, *texts])
        return aligned(lines)

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each world of each candidate; a missing value is None."""
        columns = dict.fromkeys(name for each in self.outcomes for row in each.rows for name in row)
        return [
            {"candidate": outcome.name} | {name: row.get(name) for name in columns}
            for outcome in self.outcomes
            for row in outcome.rows
        ]

    def to_json(self) -> dict[str, Any]:
        """Return the comparison without its worlds, as JSON holds it."""
        return {
            "candidates": self.names,
            "measure": self.measure,
            "statistic": self.statistic,
            "level": LEVEL.get(),
            "precision": self.precision,
            "half_width": self.half_width if math.isfinite(self.half_width) else None,
            "result": self.sentences(),
            "worlds": {each.name: len(each.rows) for each in self.outcomes},
            "unfinished": {each.name: _n_unfinished(each) for each in self.outcomes},
            "faults": {each.name: _n_faults(each) for each in self.outcomes},
            "estimates": _plain(self.estimates),
            "effects": {
                name: {measure: _effect_json(result) for measure, result in effects.items()}
                for name, effects in self.effects.items()
            },
            "differ_in": {name: self.differs_in(name) for name in self.names[1:]},
        }

    def draw(self, path: str | Path) -> None:
        """Draw all worlds, and the differences with their intervals, as PNG and SVG.

        Args:
            path: path of the figure, without suffix.
        """
        from iswarm_mj.search.plot_comparison import draw_comparison

        draw_comparison(self, Path(path))

    def write(self, out: str | Path) -> None:
        """Write compare.parquet and .csv, compare.json, compare.png and .svg into a directory.

        Raises:
            UserError: a file cannot be written.
        """
        directory = Path(out)
        make_output_directory(directory, given=directory)
        settings = {"candidates": self.names, "result": self.sentences()}
        write_table(directory / TABLE, self.rows(), settings, csv=True)
        with atomic_write(directory / CONTENT) as part:
            part.write_text(json.dumps(self.to_json(), indent=2) + "\n", encoding="utf-8")
        self.draw(directory / FIGURE)


def number_text(value: float) -> str:
    """Return a number with at most three digits, or all before the point, as 0.5 or 12345.

    There is no power of ten from 0.0001 to 10^9.
    """
    return f"{value:.0f}" if 999.5 <= abs(value) < 1e9 else f"{value:.3g}"


def interval_text(interval: Interval) -> str:
    """Return an estimate with its interval, such as "-3.2 (-5.1 to -1.4)"."""
    estimated, low, high = map(number_text, interval)
    return f"{estimated} ({low} to {high})"


def has_fault(outcome: Outcome) -> Bool[np.ndarray, "B"]:
    """Return which worlds of a candidate had a fault; they do not count."""
    return np.array([row["fault"] is not None for row in outcome.rows], bool)


def _values(outcome: Outcome, measure: str) -> Float[np.ndarray, "B"]:
    """Return `values_of`, NaN also in worlds with a fault."""
    return np.where(has_fault(outcome), np.nan, values_of(outcome.rows, measure))


def differences(first: Outcome, second: Outcome) -> list[str]:
    """Return the names of the settings in which two candidates differ, strategy as one."""
    old = dict(flat(first.about))
    new = dict(flat(second.about))
    of_settings = ("config.", "settings.", "task.", "robot.", "genome.", "strategy.", "engine")
    names: dict[str, None] = {}
    for name in sorted(old.keys() | new.keys()):
        is_setting = name == "version" or name.startswith(of_settings)
        if not is_setting or name in _NO_DIFFERENCES or old.get(name) == new.get(name):
            continue
        if name == _STOP_AT and _goal(first) == _goal(second):
            continue
        is_of_strategy = name.startswith(("genome.", "strategy."))
        names["strategy" if is_of_strategy else name] = None
    return list(names)


def _goal(outcome: Outcome) -> int | None:
    """Return the progress at which worlds of a candidate are finished; None if they never are."""
    return outcome.rows[0]["goal"]


def _refuse_other_goal(first: Outcome, second: Outcome) -> None:
    """Refuse a candidate that stops at another goal than the first in the same layouts."""
    if _STOP_AT in differences(first, second) and not _layout_differences(first, second):
        raise UserError(
            f"{first.name} stops at the goal {_goal(first)} and {second.name} at "
            f"{_goal(second)}; give both the same `stop_at`"
        )


def _layout_differences(first: Outcome, second: Outcome) -> list[str]:
    """Return the settings in which two candidates differ and on which layouts depend."""
    return [
        name
        for name in differences(first, second)
        if name in _OF_LAYOUTS or name.startswith(_GROUPS_OF_LAYOUTS)
    ]


def _effects(
    first: Outcome, second: Outcome, measures: Sequence[str], statistic: StatisticName
) -> dict[str, Effect]:
    """Return the effects on measures that are known in at least two worlds."""
    is_paired = not _layout_differences(first, second)
    effects = {}
    for measure in measures:
        samples = [_values(outcome, measure) for outcome in (first, second)]
        if is_paired:
            n_pairs = min(map(len, samples))
            pairs = np.array([values[:n_pairs] for values in samples])
            samples = list(pairs[:, ~np.isnan(pairs).any(axis=0)])
        else:
            samples = [values[~np.isnan(values)] for values in samples]
        if min(map(len, samples)) > 1:
            effects[measure] = effect(*samples, statistic=statistic, is_paired=is_paired)
    return effects


def _common_measures(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the measures that all candidates have."""
    measures = [_measures(outcome) for outcome in outcomes]
    return [name for name in measures[0] if all(name in others for others in measures[1:])]


def _measures(outcome: Outcome) -> list[str]:
    """Return the columns of a candidate that hold numbers, or nothing, in all worlds."""
    return [
        name
        for name in outcome.rows[0]
        if name not in _NO_MEASURES
        and all(isinstance(row[name], int | float | None) for row in outcome.rows)
    ]


def _default_measure(outcomes: Sequence[Outcome], common: Sequence[str]) -> str:
    """Return the measure that the result is about by default, see `ComparisonPlan.measure`."""
    has_finished = any(
        row[FINISHED] is not None and row["fault"] is None
        for outcome in outcomes
        for row in outcome.rows
    )
    if has_finished:
        return FINISHED
    if "delivered" in common:
        return "delivered"
    return next(name for name in common if name != FINISHED)  # metrics of the task come first


def _refuse_faults(outcome: Outcome) -> None:
    """Refuse a candidate with fewer than two worlds that can be compared."""
    n_worlds = len(outcome.rows)
    if n_worlds < 2:
        raise UserError(f"{outcome.name} has {n_worlds} world; intervals need at least two")
    faults = [row["fault"] for row in outcome.rows if row["fault"]]
    if n_worlds - len(faults) < 2:
        raise SimulationFault(
            f"{len(faults)} of {n_worlds} worlds of {outcome.name} had a fault, the first: "
            f"{faults[0]}"
        )


def _worlds_text(result: Effect) -> str:
    """Return the number of worlds, and whether they are paired."""
    if result.is_paired:
        return f"{result.n_second} worlds with the same layouts"
    return f"{result.n_second} and {result.n_first} worlds, not paired"


def _n_unfinished(outcome: Outcome) -> int:
    """Return the number of worlds without a fault that did not finish."""
    return sum(row["fault"] is None and row[FINISHED] is None for row in outcome.rows)


def _n_faults(outcome: Outcome) -> int:
    return int(has_fault(outcome).sum())


def _unfinished_sentence(outcome: Outcome) -> str:
    """Return how worlds that did not finish count; empty if all finished."""
    n_unfinished = _n_unfinished(outcome)
    if not n_unfinished:
        return ""
    limit = outcome.rows[0]["max_steps"]
    sentence = (
        f"{n_unfinished} of {len(outcome.rows)} worlds of {outcome.name} did not finish; they "
        f"count as {limit} steps, the length of the run."
    )
    if outcome.about.get("settings", {}).get("failing") and "delivered" in outcome.rows[0]:
        sentence += (
            " Robots that fail keep their balls: lower the goal by --stop-at, or compare "
            "--measure delivered."
        )
    return sentence


def _fault_sentence(outcome: Outcome) -> str:
    """Return how worlds with a fault count; empty if there is none."""
    n_faults = _n_faults(outcome)
    if not n_faults:
        return ""
    n_worlds = len(outcome.rows)
    return f"{n_faults} of {n_worlds} worlds of {outcome.name} had a fault, and do not count."


def _settings_sentences(first: Outcome, second: Outcome) -> list[str]:
    """Return in which settings a candidate differs from the first, and why worlds are unpaired."""
    names = differences(first, second)
    if not names:
        return [f"{second.name} and {first.name} have the same settings."]

    sentences = []
    if names != ["strategy"]:
        sentences.append(f"{second.name} differs from {first.name} in {_listed(names)}.")
    of_layouts = _layout_differences(first, second)
    if of_layouts:
        sentences.append(
            f"Their layouts depend on {_listed(of_layouts)}, so that worlds are not paired."
        )
    return sentences


def _listed(names: Sequence[str]) -> str:
    """Return some names of settings, and how many more there are."""
    short_names = [re.sub(r"^(config|settings)\.", "", name) for name in names]
    listed = ", ".join(short_names[:_MAX_NAMED])
    n_more = len(names) - _MAX_NAMED
    return f"{listed} and {n_more} more" if n_more > 0 else listed


def _plain(estimates: Mapping[str, Mapping[str, Interval]]) -> dict[str, Any]:
    """Return estimates with their intervals as JSON holds them."""
    return {
        name: {measure: interval._asdict() for measure, interval in of_candidate.items()}
        for name, of_candidate in estimates.items()
    }


def _effect_json(result: Effect) -> dict[str, Any]:
    """Return an effect as JSON holds it."""
    return {
        "first": result.first,
        "second": result.second,
        "difference": result.difference._asdict(),
        "ratio": None if result.ratio is None else result.ratio._asdict(),
        "superiority": result.superiority._asdict(),
        "n_first": result.n_first,
        "n_second": result.n_second,
        "is_paired": result.is_paired,
        "is_decided": result.is_decided,
    }
