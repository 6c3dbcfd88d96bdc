"""Files of `--config`: TOML whose keys are flags, or the result.json of an earlier run."""

import difflib
import json
import tomllib
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iswarm_mj.engines.registry import IDENTITY
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import check_file

LARGEST_FILE = 2**28
"""Size up to which a file is read [bytes]; that of a result.json."""
_SETTINGS = {"n_robots": "robots", "n_worlds": "worlds", "steps": "steps", "seed": "seed", "stop_at": "stop_at"}
"""Settings of a run in result.json, and their flags."""
_EXCLUSIVE = ({"robots", "density"},)
"""Flags that exclude each other: those that are given replace those of the file."""


@dataclass(frozen=True)
class ConfigFile:
    """What a file says."""

    path: Path
    values: dict[str, Any]
    """By names of flags, as `arena.n_dust`."""
    is_result: bool
    """It is a result.json, which may have more than the flags of a command."""

    def arguments(self, command: str, kinds: Mapping[str, Any], given: Sequence[str]) -> list[str]:
        """Return the values as arguments of a command, those with several values first.

        Args:
            command: its name, for messages.
            kinds: names of its flags and their types.
            given: the other arguments, which have precedence.

        Raises:
            UserError: a key is no flag, or a value is not a number, a word, true, false, or a list of such.
        """
        values = {name: value for name, value in self.values.items() if name in kinds}
        if not self.is_result and len(values) < len(self.values):
            raise UserError(self._unknown(command, [name for name in self.values if name not in kinds], list(kinds)))
        named = _names(given)
        for group in _EXCLUSIVE:
            if group & named:
                values = {name: value for name, value in values.items() if name not in group}
        made = [self._argument(name, value) for name, value in values.items()]
        return [word for words in sorted(made, key=lambda words: len(words) == 1) for word in words]

    def _unknown(self, command: str, unknown: Sequence[str], known: Sequence[str]) -> str:
        similar = [difflib.get_close_matches(name, known, 1, cutoff=0.75) for name in unknown]
        meant = ", ".join(match[0] for match in similar if match)
        hint = f"; perhaps you meant {meant}" if meant else ""
        return (
            f"--config {self.path} names {', '.join(unknown)}, of which iswarm {command} knows nothing{hint}; "
            f"`iswarm {command} --help-all` lists the flags, which are the keys"
        )

    def _argument(self, name: str, value: Any) -> list[str]:
        flag = f"--{name.replace('_', '-')}"
        if isinstance(value, list):
            value = [part for one in value for part in (one if isinstance(one, list) else [one])]
            return [] if not value else [flag, *(self._word(name, element) for element in value)]
        return [f"{flag}={self._word(name, value)}"]

    def _word(self, name: str, value: Any) -> str:
        if isinstance(value, bool):
            return str(value).lower()
        if not isinstance(value, str | int | float):
            kinds = "a number, a word, true or false, or a list"
            raise UserError(f"--config {self.path}: {name} must be {kinds} (got {value})")
        return str(value)


def read(path: Path, given: Sequence[str]) -> ConfigFile:
    """Return the content of a file.

    Args:
        path: of the file, JSON if its name ends in .json, otherwise TOML.
        given: the other arguments.

    Raises:
        UserError: it cannot be read, or is neither; or it is of a run with a strategy that is not named.
    """
    is_json = path.suffix == ".json"
    try:
        check_file(path, LARGEST_FILE)
        text = path.read_text(encoding="utf-8-sig")
        content = json.loads(text) if is_json else tomllib.loads(text)
    except OSError as error:
        remedy = "name a TOML file or a result.json"
        raise UserError(f"--config {path} cannot be read ({error.strerror or error}); {remedy}") from None
    except (ValueError, RecursionError) as error:
        kind = "JSON" if is_json else "TOML, as `steps = 300` or `[arena]`"
        raise UserError(f"--config {path} is not {kind} ({' '.join(str(error).split())})") from None
    if is_json:
        return ConfigFile(path, _of_result(path, content, _names(given)), True)
    return ConfigFile(path, dict(_flat(content)), False)


def named_in(content: ConfigFile | None, command: str, kinds: Container[str], given: Sequence[str]) -> list[str]:
    """Return the arguments that name strategy and task of a file, whose fields are flags, unless others are given.

    Args:
        content: of the file, if there is one.
        command: its name.
        kinds: names of the command's flags.
        given: the other arguments.

    Raises:
        UserError: the file names one, and the command has no flag for it.
    """
    found = {} if content is None else {word: content.values.get(word) for word in ("strategy", "task")}
    for word, name in found.items():
        if content is not None and name is not None and word not in kinds:
            remedy = f"; `iswarm run --config {content.path}` has it" if command == "clean" else ""
            raise UserError(f"--config {content.path} names the {word} {name}, but iswarm {command} has none{remedy}")
    return [f"--{word}={name}" for word, name in found.items() if name is not None and word not in _names(given)]


def _names(arguments: Sequence[str]) -> set[str]:
    """Names of the flags among arguments."""
    flags = [argument.partition("=")[0] for argument in arguments if argument.startswith("--")]
    return {flag.removeprefix("--").replace("-", "_") for flag in flags}


def _of_result(path: Path, content: Any, named: set[str]) -> dict[str, Any]:
    """Flags of the run that wrote a result.json."""
    if not (isinstance(content, dict) and isinstance(content.get("settings"), dict) and "config" in content):
        raise UserError(f"--config {path} is not the result.json of `iswarm clean` of this version; name one that is")
    values = {flag: content["settings"].get(name) for name, flag in _SETTINGS.items()}
    values |= {name: content.get(name) for name in IDENTITY}
    values["robot"] = content.get("robot", {}).get("file")
    values |= dict(_flat(content["config"]))
    if "genome" in content:
        values["genome"] = str(path)
    else:
        values |= _named(path, "strategy", content.get("strategy", {}), named)
    task = content.get("task", {})
    if task.get("class", "Cleaning") != "Cleaning":
        values |= _named(path, "task", task, named)
    return {name: value for name, value in values.items() if value is not None}


def _named(path: Path, word: str, own: Mapping[str, Any], named: set[str]) -> dict[str, Any]:
    """Values of a strategy or a task, and the name under which a package offers it, unless one is given."""
    from iswarm_mj.strategy.library import STRATEGIES, offered
    from iswarm_mj.tasks.library import TASKS

    cls = own.get("class")
    values = {name: value for name, value in own.items() if name != "class"}
    if word in named:
        return values
    name = offered({"strategy": STRATEGIES, "task": TASKS}[word], str(cls), set(values))
    if name is None:
        raise UserError(f"--config {path} is of the {word} {cls}; name it by --{word} FILE.py:CLASS")
    return {**values, word: name}


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        name = f"{prefix}{key.replace('-', '_')}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{name}.")
        else:
            yield name, value
