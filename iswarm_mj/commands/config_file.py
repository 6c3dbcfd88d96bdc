"""Files of `--config`: TOML whose keys are flags, or the result.json of an earlier run.

The values become arguments of the command, behind those that are given. tyro then reads both by the
same rules, those of users' own strategies, tasks and engines included. Setting fields directly
would be shorter here, but needs a second reader of annotations: tuples, optional numbers, literals,
paths, devices and teams, with their ranges and messages. What cannot be an argument, such as a date
of TOML, is refused here (`ConfigFile._word`).
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from iswarm_mj.commands.command_settings import settings
from iswarm_mj.commands.flags import SETTING_OF_FLAG, flag, names, switch
from iswarm_mj.commands.grasp import Grasp
from iswarm_mj.config.setting_names import CONFIG_NAMES, Parts, canonical_name
from iswarm_mj.engines.registry import IDENTITY
from iswarm_mj.gripper.tips.table import check_unchanged
from iswarm_mj.utils.errors import UserError, closest, shown
from iswarm_mj.utils.files import by_flags, read_json, read_toml

_FLAG_OF_SETTING = {
    "n_robots": "robots",
    "n_worlds": "worlds",
    "steps": "steps",
    "seed": "seed",
    "stop_at": "stop_at",
    "failing": "failing",
}
"""Flags of the settings of a run in result.json."""
_ENDS_A_RUN = ("steps", "stop_at")
"""Settings by which runs end, which the page does not have."""
_REPLACED_RULES = {"strategy": "genome", "genome": "strategy"}
"""Flag of the rules that each flag of rules replaces."""
_OF_GRASP = "grasp."
"""Beginning of the names of settings in the table [grasp]."""
_REMEDY = "name a TOML file, with lines as `steps = 300` or `[arena]`, or a result.json"


@dataclass(frozen=True)
class ConfigFile:
    """Content of a file of `--config`."""

    path: Path
    values: dict[str, Any]
    """Values by the names of flags, such as `arena.n_dust`."""
    is_result: bool
    """The file is a result.json, which may have values for which a command has no flags."""

    @classmethod
    def read(cls, path: Path, command: str, given_flags: Collection[str]) -> "ConfigFile":
        """Read a file.

        A table [grasp] in TOML is for `iswarm grasp` and `iswarm tip`, which then read nothing else,
        and for the bench of `iswarm play`, as of a file of `--fits`. Other commands leave it out:
        fit.toml has one beside settings of swarms.

        Args:
            path: path of the file, JSON if its name ends in .json, otherwise TOML.
            command: name of the command.
            given_flags: names of the flags among the arguments of the command.

        Raises:
            UserError: it cannot be read, or is neither; or it is of a run with a strategy or a task
                that no installed package offers, and that no argument names.
        """
        if path.suffix == ".json":
            content = read_json(path, _REMEDY, what="--config ")
            values = _values_of_result(path, content, given_flags)
            return cls(path, _without_other_rules(values, given_flags), True)
        values = read_toml(path, _REMEDY, what="--config ")
        values = _without_other_rules(values, given_flags)
        of_grasp = {
            name.removeprefix(_OF_GRASP): value
            for name, value in values.items()
            if name.startswith(_OF_GRASP)
        }
        if command in ("grasp", "tip") and of_grasp:
            return cls(path, of_grasp, False)
        others = {name: value for name, value in values.items() if not name.startswith(_OF_GRASP)}
        if command == "play" and of_grasp and "fits" not in others:
            others["fits"] = [str(path)]
        return cls(path, others, False)

    def by_canonical_names(self, parts: Parts) -> "ConfigFile":
        """Return this file with its values by the names that settings have beside these parts.

        Raises:
            UserError: a key is the name of settings of several parts, or names one again.
        """
        values: dict[str, Any] = {}
        for key, value in self.values.items():
            name = canonical_name(key, parts, source=f"--config {self.path}: ")
            if name in values:
                raise UserError(
                    f"--config {self.path} names {name} twice, also as {key}; leave out one of them"
                )
            values[name] = value
        return replace(self, values=values)

    def arguments(
        self, command: str, defaults: Mapping[str, Any], given_flags: Collection[str]
    ) -> list[str]:
        """Return the values as arguments of a command.

        Those of flags that are given, or that given ones exclude, are left out.

        Args:
            command: name of the command, for messages.
            defaults: defaults of the command's settings.
            given_flags: names of the flags among the arguments of the command.

        Raises:
            UserError: a key is no flag, or a value cannot be an argument.
        """
        is_of_bench = "ball_material" in self.values and self.is_result
        if is_of_bench and command not in ("grasp", "tip"):
            raise UserError(
                f"--config {self.path} is of iswarm grasp, but this is iswarm {command}; "
                f"`iswarm grasp --config {self.path}` repeats it"
            )
        default_of_flag = {
            flag(setting).removeprefix("--").replace("-", "_"): default
            for setting, default in defaults.items()
        }
        self._refuse_unknown(command, default_of_flag)

        replaced = set(given_flags)
        if replaced & {"robots", "density"}:
            replaced |= {"robots", "density"}  # each of which determines the other
        arguments = []
        for name, value in self.values.items():
            is_replaced = not replaced.isdisjoint(names([flag(name)]))
            if name in default_of_flag and not is_replaced:
                arguments += self._argument(name, value, default_of_flag[name])
        return arguments

    def _refuse_unknown(self, command: str, known_flags: Collection[str]) -> None:
        """Refuse a strategy or a task where there is none, and keys of TOML that are no flags."""
        unknown = [name for name in self.values if name not in known_flags]
        if command == "tip":  # which takes what it needs of a file for the bench
            unknown = [name for name in unknown if name not in _names_of_grasp()]
        for name in SETTING_OF_FLAG:
            if name in unknown:
                remedy = f"; `iswarm run --config {self.path}` has it" if command == "clean" else ""
                raise UserError(
                    f"--config {self.path} names the {name} {shown(self.values[name])}, "
                    f"but iswarm {command} has none{remedy}"
                )
        for name in unknown:
            if command == "play" and name in _ENDS_A_RUN and not self.is_result:
                raise UserError(
                    f"--config {self.path} names {name}, "
                    "but the page goes on for as long as it is watched; leave it out"
                )
        if unknown and not self.is_result:
            similar = closest(unknown[0], known_flags)
            hint = f"; perhaps you meant {similar}" if similar else ""
            raise UserError(
                f"--config {self.path} names {shown(', '.join(unknown))}, "
                f"which iswarm {command} does not know{hint}; "
                f"`iswarm {command} --help-all` lists the flags, which are the keys"
            )

    def _argument(self, name: str, value: Any, default: Any) -> list[str]:
        """Return the arguments that give a flag its value."""
        if isinstance(value, bool) and isinstance(default, bool):
            return [switch(name, is_on=value)]
        if not isinstance(value, list):
            return [f"{flag(name)}={self._word(name, value)}"]
        words = [flag(name)]
        for item in value:
            parts = item if isinstance(item, list) else [item]
            words += [self._word(name, part) for part in parts]
        return words

    def words(self, name: str) -> list[str]:
        """Return the values of a flag that takes words."""
        values = self.values.get(name, [])
        if not isinstance(values, list):
            values = [values]
        return [self._word(name, value) for value in values]

    def _word(self, name: str, value: Any) -> str:
        """Return a value as the word of an argument.

        Raises:
            UserError: it cannot be one.
        """
        try:
            word = str(value)
        except ValueError:  # Python refuses to print whole numbers of thousands of digits
            value = "a number of too many digits"
        else:
            if isinstance(value, str | int | float) and not word.startswith("--"):
                return word
        kinds = "a number, a word that is no flag, true or false, or a list"
        raise UserError(f"--config {self.path}: {shown(name)} must be {kinds} (got {shown(value)})")


def _without_other_rules(values: dict[str, Any], given_flags: Collection[str]) -> dict[str, Any]:
    """Return values without the genome that a given strategy replaces, or without the strategy."""
    replaced = {other for rule, other in _REPLACED_RULES.items() if rule in given_flags}
    return {name: value for name, value in values.items() if name not in replaced}


def _names_of_grasp() -> set[str]:
    """Return the names of the flags of `iswarm grasp`."""
    return {setting.name for setting in settings(Grasp())}


def _values_of_result(path: Path, content: Any, given_flags: Collection[str]) -> dict[str, Any]:
    """Return the values of flags with which the run was made that wrote a result.json."""

    def part(name: str) -> Mapping[str, Any]:
        default = None if name in ("settings", "config") else {}
        values = content.get(name, default) if isinstance(content, dict) else None
        if not isinstance(values, dict):
            raise UserError(
                f"--config {path} is not the result.json of a run of a swarm; name one that is"
            )
        return values

    if part("fit"):
        raise UserError(f"--config {path} is of iswarm fit; name the fit.toml beside it")
    for bench in ("grasp", "tip"):
        if part(bench):
            values = by_flags(content[bench])
            return {name: value for name, value in values.items() if value is not None}

    values = {name: part("settings").get(key) for key, name in _FLAG_OF_SETTING.items()}
    values |= by_flags(part("config"))
    _check_tip(part("gripper_tip"), values.get("gripper.tip"), given_flags)
    for name in IDENTITY:
        values[name if name == "engine" else f"engine.{name}"] = content.get(name)
    values["robot"] = part("robot").get("file")
    if part("genome"):
        values["genome"] = str(path)
    for kind in SETTING_OF_FLAG:
        is_replaced = _REPLACED_RULES.get(kind) in given_flags
        if part(kind) and not is_replaced:
            values |= _values_of_plugin(path, kind, part(kind), given_flags)
    return {name: value for name, value in values.items() if value is not None}


def _check_tip(recorded: Mapping[str, Any], path: Any, given_flags: Collection[str]) -> None:
    """Check that the file of a tip has the table of a recorded run, if that had one.

    Args:
        recorded: what the run has recorded of its table; empty without one.
        path: file of the table.
        given_flags: names of the flags among the arguments, which may name another tip.
    """
    if recorded and "gripper.tip" not in given_flags:
        check_unchanged(str(path), str(recorded.get("sha256")))


def _values_of_plugin(
    path: Path, kind: str, content: Mapping[str, Any], given_flags: Collection[str]
) -> dict[str, Any]:
    """Return the values of a strategy or a task, with the name under which a package offers it.

    Args:
        path: path of the result.json, for messages.
        kind: "strategy" or "task".
        content: class and values.
        given_flags: names of the flags among the arguments of the command; where they name another
            strategy or task, the values are those of its flags.

    Raises:
        UserError: no installed package offers the class.
    """
    from iswarm_mj.strategy.library import STRATEGIES, TASKS, naming, offered
    from iswarm_mj.tasks.cleaning import CLEANING

    class_name = content.get("class")
    values = {name: value for name, value in content.items() if name != "class"}
    named = {_name_with_part(kind, name): value for name, value in by_flags(values).items()}
    if class_name == "Teams":  # whose settings have names with their teams
        named = by_flags(values)
    if kind in given_flags:
        return named
    if kind == "task" and class_name == type(CLEANING).__name__:
        return {}

    plugin_kind = {"strategy": STRATEGIES, "task": TASKS}[kind]
    name = offered(plugin_kind, str(class_name), set(values))
    if name is None:
        remedy = naming(plugin_kind, str(class_name))
        raise UserError(
            f"--config {path} is of the {kind} {shown(class_name)}, which no package offers; "
            f"name it by {remedy}"
        )
    return {**named, kind: name}


def _name_with_part(part: str, field: str) -> str:
    """Return the name of a setting that no other part has; its own if that is the configuration's."""
    name = f"{part}.{field}"
    return field if name in CONFIG_NAMES else name
