"""Flags that would have no effect are refused."""

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any

from iswarm_mj.commands.flags import changed
from iswarm_mj.config import READINGS
from iswarm_mj.utils.errors import ConfigError, UserError

Rule = tuple[Iterable[str], bool, str]
"""Settings, whether they have no effect, and why, to be read after "has no effect"."""

ONLY_WITH_SLOTS = (
    "optics.slots",
    "optics.photodiodes_while_emitting",
    "optics.serial_photodiodes",
    "optics.capture_ratio",
)


def refuse_ignored(command: Any, rules: Iterable[Rule]) -> None:
    """Refuse settings that differ from their defaults and would have no effect.

    Raises:
        UserError: there is one.
    """
    given = set(changed(command))
    for names, is_ignored, why in rules:
        idle = [name for name in names if name in given]
        if is_ignored and idle:
            raise UserError(f"`{idle[0]}` has no effect {why}; leave it out")


def of_task(command: Any, task: Any) -> list[Rule]:
    """Settings of a command's configuration that a task says it does not use, alone or as whole groups.

    Not those with the default of `reading`, nor those whose default the other settings refuse, as in a small arena.
    """
    named = [name.partition(".") for name in getattr(task, "unused", ())]
    settings = [
        f"{group}.{part}"
        for group, _, own in named
        for part in ([own] if own else (f.name for f in fields(getattr(command, group))))
    ]
    idle = [name for name in settings if _is_idle(command, *name.split("."))]
    return [(idle, True, f"in the task {type(task).__name__}")]


def _is_idle(command: Any, group: str, part: str) -> bool:
    given, default = getattr(command, group), getattr(getattr(READINGS[command.reading], group), part)
    try:
        return replace(given, **{part: default}) != given
    except ConfigError:
        return False


def of_optics(optics: Any) -> list[Rule]:
    """Settings of the optics that others switch off."""
    return [
        (ONLY_WITH_SLOTS, not optics.baud_rate, "without `optics.baud_rate`, as messages take no time"),
        (("optics.photodiode_splay",), optics.mode == "sector", "with `optics.mode` sector"),
        (("optics.photodiode_aperture",), optics.mode == "power", "with `optics.mode` power"),
    ]
