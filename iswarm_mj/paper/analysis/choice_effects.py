"""Effects of the choices that the paper leaves open on the time to the goal."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.paper.analysis.measures import TIME, count_finished, values
from iswarm_mj.paper.analysis.statistics import compare, holm
from iswarm_mj.paper.analysis.varied_values import DEFAULT
from iswarm_mj.search.rows import Rows, by, select
from iswarm_mj.utils.intervals import Interval, difference


class ChoiceEffect(NamedTuple):
    """The effect of another value of a choice on the time to the goal."""

    group: str
    """Group of choices."""
    choice: str
    """Name of the setting, such as optics.mode."""
    value: str
    """The other value."""
    reached: str
    """How many of how many runs reached the goal."""
    change: Interval
    """Difference of the mean time from the default's [control steps]."""
    p: float
    """P-value of the Mann-Whitney test."""
    adjusted_p: float
    """The p-value adjusted by Holm for the number of choices."""

    @property
    def setting(self) -> str:
        """Name of the choice without its part of the configuration, and the value."""
        return setting_text(self.choice, self.value)


def setting_text(choice: str, value: str) -> str:
    """Return the name of a choice without its part of the configuration, and a value."""
    return f"{choice.split('.')[1]} = {value}"


def effects_of_choices(rows: Rows) -> list[ChoiceEffect]:
    """Return the effect of each choice on the mean time.

    Runs that did not reach the goal count as the time limit.
    """
    default_times = values(select(rows, choice=DEFAULT), TIME)
    other_rows = [row for row in rows if row["choice"] != DEFAULT]
    groups = by(other_rows, "group", "choice", "value")
    times = {key: values(runs, TIME) for key, runs in groups.items()}
    p_values = [compare(times[key], default_times).p for key in groups]

    effects = []
    for (key, runs), p, adjusted_p in zip(groups.items(), p_values, holm(p_values), strict=True):
        group, choice, value = key
        effect = ChoiceEffect(
            group,
            choice,
            value,
            reached=f"{count_finished(runs)}/{len(runs)}",
            change=difference(times[key], default_times, np.mean),
            p=p,
            adjusted_p=adjusted_p,
        )
        effects.append(effect)
    return effects
