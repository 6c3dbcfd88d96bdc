"""Files of `--config`: TOML whose keys are flags, or the result.json of an earlier run."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iswarm_mj.commands.flags import SETTINGS, flag, names, switch
from iswarm_mj.engines.registry import IDENTITY
from iswarm_mj.utils.errors import UserError, closest, shown
from iswarm_mj.utils.files import by_flags, read_json, read_toml

_SETTINGS = {"n_robots": "robots", "n_worlds": "worlds", "steps": "steps", "seed": "seed", "stop_at": "stop_at"}
"""Settings of a run in result.json, and their flags."""


@dataclass(frozen=True)
class ConfigFile:
    """What a file says."""

    path: Path
    values: dict[str, Any]
    """By names of flags, as `arena.n_dust`."""
    is_result: bool
    """It is a result.json, which may have more than the flags of a command."""

    @classmethod
    def read(cls, path: Path, given: Collection[str]) -> "ConfigFile":
        """Return the content of a file.

        Args:
            path: of the file, JSON if its name ends in .json, otherwise TOML.
            given: names of flags that are given, too.

        Raises:
            UserError: it cannot be read, or is neither; or it is of a run with a strategy that is not named.
        """
        remedy = "name a TOML file, with lines as `steps = 300` or `[arena]`, or a result.json"
        if path.suffix == ".json":
            return cls(path, _of_result(path, read_json(path, remedy, what="--config "), given), True)
        return cls(path, read_toml(path, remedy, what="--config "), False)

    def arguments(self, command: str, known: Mapping[str, Any], given: Collection[str]) -> list[str]:
        """Return the values as arguments of a command, but those of flags that are given or excluded by them.

        Args:
            command: its name, for messages.
            known: its settings and their defaults.
            given: names of the flags that are given.

        Raises:
            UserError: a key is no flag, or a value is not a number, a word, true, false, or a list of such.
        """
        if "ball_material" in self.values and self.is_result and command != "grasp":
            raise UserError(f"--config {self.path} is of iswarm grasp, which repeats it; iswarm {command} cannot")
        flags = {flag(name).removeprefix("--").replace("-", "_"): default for name, default in known.items()}
        unknown = [name for name in self.values if name not in flags]
        if named := [word for word in SETTINGS if word in unknown]:
            remedy = f"; `iswarm run --config {self.path}` has it" if command == "clean" else ""
            fact = f"--config {self.path} names the {named[0]} {shown(self.values[named[0]])}"
            raise UserError(f"{fact}, but iswarm {command} has none{remedy}")
        if endless := [name for name in unknown if command == "play" and name in ("steps", "stop_at")]:
            reason = "the page goes on for as long as it is watched"
            if not self.is_result:
                raise UserError(f"--config {self.path} names {endless[0]}, but {reason}; leave it out")
        if unknown and not self.is_result:
            similar = closest(unknown[0], flags)
            hint = f"; perhaps you meant {similar}" if similar else ""
            raise UserError(
                f"--config {self.path} names {shown(', '.join(unknown))}, which iswarm {command} does not know"
                f"{hint}; `iswarm {command} --help-all` lists the flags, which are the keys"
            )
        replaced = {*given, *({"robots", "density"} if {"robots", "density"} & {*given} else ())}
        values = {
            name: value
            for name, value in self.values.items()
            if name in flags and not replaced & {*names([flag(name)])}
        }
        return [word for name, value in values.items() for word in self._argument(name, value, flags[name])]

    def _argument(self, name: str, value: Any, default: Any) -> list[str]:
        word = flag(name)
        if isinstance(value, bool) and isinstance(default, bool):
            return [switch(name, value)]
        if isinstance(value, list):
            parts = [part for one in value for part in (one if isinstance(one, list) else [one])]
            return [word, *(self._word(name, part) for part in parts)]
        return [f"{word}={self._word(name, value)}"]

    def words(self, name: str) -> list[str]:
        """Return the values of a flag that takes words."""
        found = self.values.get(name, [])
        return [self._word(name, value) for value in (found if isinstance(found, list) else [found])]

    def _word(self, name: str, value: Any) -> str:
        try:
            if isinstance(value, str | int | float) and not (word := str(value)).startswith("--"):
                return word
        except ValueError:  # Python refuses to print whole numbers of thousands of digits
            value = "a number of too many digits"
        kinds = "a number, a word that is no flag, true or false, or a list"
        raise UserError(f"--config {self.path}: {shown(name)} must be {kinds} (got {shown(value)})")


def _of_result(path: Path, content: Any, given: Collection[str]) -> dict[str, Any]:
    """Flags of the run that wrote a result.json."""

    def part(name: str) -> Mapping[str, Any]:
        found = content.get(name, None if name in ("settings", "config") else {}) if isinstance(content, dict) else None
        if not isinstance(found, dict):
            raise UserError(f"--config {path} is not the result.json of a run of a swarm; name one that is")
        return found

    if part("grasp"):
        return {name: value for name, value in by_flags(content["grasp"]).items() if value is not None}
    values = {name: part("settings").get(key) for key, name in _SETTINGS.items()} | by_flags(part("config"))
    values |= {name: content.get(name) for name in IDENTITY} | {"robot": part("robot").get("file")}
    if part("genome"):
        values["genome"] = str(path)
    for word in SETTINGS:
        if part(word):
            values |= _named(path, word, part(word), given)
    return {name: value for name, value in values.items() if value is not None}


def _named(path: Path, word: str, own: Mapping[str, Any], given: Collection[str]) -> dict[str, Any]:
    """Values of a strategy or a task, and the name under which a package offers it, unless another is given."""
    from iswarm_mj.strategy.library import STRATEGIES, TASKS, naming, offered
    from iswarm_mj.tasks.cleaning import CLEANING

    cls, values = own.get("class"), {name: value for name, value in own.items() if name != "class"}
    if word in given or (word == "task" and cls == type(CLEANING).__name__):
        return by_flags(values) if word in given else {}
    offer = {"strategy": STRATEGIES, "task": TASKS}[word]
    name = offered(offer, str(cls), set(values))
    if name is None:
        raise UserError(f"--config {path} is of the {word} {shown(cls)}; name it by {naming(offer, str(cls))}")
    return {**values, word: name}
