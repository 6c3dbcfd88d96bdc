"""Names of flags: which flag a setting has, and which settings arguments and messages name."""

import re
from collections.abc import Collection, Iterable, Iterator
from typing import Any

from iswarm_mj.utils.errors import ConfigError, SimulationFault, UserError

SETTING_OF_FLAG = {"strategy": "controller", "task": "task_name"}
"""Settings of the flags that are called otherwise."""
_FLAG_OF_SETTING = {setting: flag for flag, setting in SETTING_OF_FLAG.items()}
_FLAG_OF_SETTING |= {"n_robots": "robots", "n_worlds": "worlds", "robot_file": "robot"}
"""Flags of the settings that are called otherwise, in commands or in messages."""
_SETTING_IN_MESSAGE = re.compile(r"`([a-z_]+(?:\.[a-z_]+)?)`")
_FLAG_IN_ARGUMENT = re.compile(r"--([\w-]+\.)?(?:no[-_])?([\w-]+)(?==|$)")


def flag(setting: str) -> str:
    """Return the flag of a setting, such as `--arena.n-dust`."""
    return f"--{_FLAG_OF_SETTING.get(setting, setting).replace('_', '-')}"


def switch(setting: str, *, is_on: bool) -> str:
    """Return the flag that switches a setting on or off, such as `--optics.no-parity-check`."""
    group, dot, name = flag(setting).removeprefix("--").rpartition(".")
    return f"--{group}{dot}{'' if is_on else 'no-'}{name}"


def names(arguments: Iterable[str]) -> list[str]:
    """Return the names of the flags among arguments, such as `arena.n_dust`.

    A flag that is switched off by `no-` has the name of the setting.
    """
    matches = map(_FLAG_IN_ARGUMENT.match, arguments)
    return [((match[1] or "") + match[2]).replace("-", "_") for match in matches if match]


def _words(values: tuple[Any, ...]) -> Iterator[str]:
    """Yield the values of a tuple and of tuples in it as words."""
    for value in values:
        if isinstance(value, tuple):
            yield from _words(value)
        else:
            yield str(value)


def in_flags(error: UserError | SimulationFault, settings: Collection[str]) -> str:
    """Return the message of an error with flags in place of the settings that it names.

    Args:
        error: error whose message names settings as Python does, such as `arena.size`.
        settings: settings of the command; the message keeps the names of others.
    """
    known = set(settings)
    for setting, same_setting in (_FLAG_OF_SETTING | SETTING_OF_FLAG).items():
        if same_setting in settings:
            known.add(setting)

    if isinstance(error, ConfigError):
        setting, bracket, index = error.field.partition("[")
        if setting in known:
            value = error.value
            if isinstance(value, tuple):
                value = " ".join(_words(value))  # as on the command line
            name = flag(setting) + bracket + index
            error = ConfigError(name, value, error.constraint, error.remedy)

    def flag_if_known(match: re.Match[str]) -> str:
        return flag(match[1]) if match[1] in known else match[0]

    return _SETTING_IN_MESSAGE.sub(flag_if_known, str(error))
