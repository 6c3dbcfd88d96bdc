"""The settings with which the next run begins, and those that do not fit each other yet."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.utils.errors import UserError


class Misfit(NamedTuple):
    """Task, strategy or engine that waits until other settings let a run begin with it."""

    name: str
    """Name of the setting, such as `task`."""
    sentence: str
    """Why no run can begin so."""


@dataclass(frozen=True)
class NextStart:
    """Settings that wait for a reset.

    Another task, strategy or engine waits also if it does not fit the other settings, since its own
    can only be changed once it is chosen. Meanwhile the next reset begins without it, and with all
    that it shares with the wanted settings.
    """

    wanted: PageScenario
    """Settings that somebody wants."""
    fitting: PageScenario
    """Settings with which the next reset begins: those wanted, unless there is a misfit."""
    misfit: Misfit | None = None
    """Why no run can begin with the wanted settings; None where one can."""

    @classmethod
    def of(cls, scenario: PageScenario) -> Self:
        """Return the next start with settings that fit each other."""
        return cls(scenario, scenario)

    def with_part(self, name: str, wanted: PageScenario) -> Self:
        """Return the next start with another task, strategy or engine, whether it fits or not.

        Args:
            name: task, strategy or engine.
            wanted: wanted settings with the new part.
        """
        return self._with(wanted, self.fitting, name)

    def with_setting(self, name: str, value: Any) -> Self:
        """Return the next start with another value of a setting that is no part.

        Raises:
            UserError: there is no such setting, or the next reset could not begin with this value.
        """
        if self.misfit is None:
            wanted = self.wanted.set(name, value)
            wanted.check()
            return self.of(wanted)

        # A rule of what runs may be one that the wanted strategy lacks.
        is_of_fitting = self.fitting.has(name) and not self.wanted.has(name)
        owner = self.fitting if is_of_fitting else self.wanted
        wanted = with_shared_setting(self.wanted, owner, name, value)
        fitting = with_shared_setting(self.fitting, owner, name, value)

        next_start = self._with(wanted, fitting, self.misfit.name)
        next_start.fitting.check()
        return next_start

    def with_rule(self, now: PageScenario, name: str) -> Self:
        """Return the next start with a rule of the present scenario, where it has that rule.

        Args:
            now: scenario with the rule.
            name: name of the rule in `now`.
        """
        value = now.get(name)
        wanted = with_shared_setting(self.wanted, now, name, value)
        if self.misfit is None:
            return self.of(wanted)
        fitting = with_shared_setting(self.fitting, now, name, value)
        return self._with(wanted, fitting, self.misfit.name)

    def renewed(self, renew: Callable[[PageScenario], PageScenario]) -> Self:
        """Return the next start with the present code of users' files.

        Args:
            renew: returns a scenario with that code.

        Raises:
            UserError: no run could begin with the new code.
        """
        wanted = renew(self.wanted)
        if self.misfit is None:
            wanted.check()
            return self.of(wanted)
        next_start = self._with(wanted, renew(self.fitting), self.misfit.name)
        next_start.fitting.check()
        return next_start

    def _with(self, wanted: PageScenario, fitting: PageScenario, part: str) -> Self:
        """Return the next start with wanted settings if they fit, else with fitting ones.

        Args:
            wanted: wanted settings.
            fitting: settings with which the next reset begins if these do not fit.
            part: task, strategy or engine that is a misfit then.
        """
        try:
            wanted.check()
        except UserError as error:
            return type(self)(wanted, fitting, Misfit(part, str(error)))
        return self.of(wanted)


def with_shared_setting(
    scenario: PageScenario, owner: PageScenario, name: str, value: Any
) -> PageScenario:
    """Return a scenario with a setting of another one, if it has that setting, too.

    Args:
        scenario: scenario that may have the setting.
        owner: scenario that has it.
        name: name of the setting in `owner`.
        value: value of the setting.

    Raises:
        UserError: neither has the setting, or the value is out of range.
    """
    own_name = scenario.shared_name(name, owner)
    return scenario if own_name is None else scenario.set(own_name, value)
