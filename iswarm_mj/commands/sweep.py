"""`iswarm sweep`: runs with several values of their flags."""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from iswarm_mj.commands.clean import Clean, Run
from iswarm_mj.commands.command_settings import (
    changed_names,
    ineffective_settings,
    refuse_changed,
    settings,
    without_effect,
)
from iswarm_mj.commands.flags import flag, in_flags, switch
from iswarm_mj.commands.grasp import Grasp
from iswarm_mj.commands.parser import parse
from iswarm_mj.commands.swarm import run_of
from iswarm_mj.strategy.user_files import sources
from iswarm_mj.utils.constraints import check, spaced, validate
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.extras import require

MAX_RUNS = 10_000
_FORM = (
    "FLAG=VALUE,VALUE,... or FLAG=START:STOP:COUNT, as density=0.1:0.4:7 or genome=type1,evolved"
)
_COMMANDS: dict[str, type] = {"clean": Clean, "run": Run, "grasp": Grasp}
_SWITCHES = ("--again", "-h", "--help", "--help-all", "--help_all")
"""Flags of the sweep itself that take no value."""
_OWN_FLAGS = ("--over", "--out", *_SWITCHES)
"""Flags of the sweep itself; all others are those of its command."""
_WITHOUT_EFFECT = (
    "out",
    "record_worlds",
    "record_grasps",
    "record",
    "force_curve",
    "voltages",
)
"""Settings of the command that have no effect on the runs of a sweep."""


@dataclass(frozen=True)
class Sweep:
    """Run clean, run or grasp for several values of any flag; writes a table and a figure."""

    command: tyro.conf.Positional[Literal["clean", "run", "grasp"]] = "clean"
    """The command whose flags vary."""
    over: Annotated[tuple[str, ...], tyro.conf.arg(metavar="FLAG=VALUES")] = ()
    """Flags that vary, in all combinations: FLAG=VALUE,VALUE,... or FLAG=START:STOP:COUNT, as
    density=0.1:0.4:7."""
    again: tyro.conf.FlagCreatePairsOff[bool] = False
    """Repeat runs that --out already holds."""
    out: Path = Path("runs/sweep")
    """Directory for the results; an interrupted sweep resumes there."""
    command_arguments: tyro.conf.Suppress[tyro.conf.Fixed[tuple[str, ...]]] = ()
    """Arguments of the command."""

    def __post_init__(self):
        validate(self)

    @classmethod
    def parse(cls, arguments: Sequence[str]) -> "Sweep":
        """Return the sweep that arguments describe, see `parser.parse`."""
        sweep_arguments, command_arguments = _split(arguments)
        return replace(parse("sweep", cls, sweep_arguments), command_arguments=command_arguments)

    def run(self) -> None:
        """Run the command."""
        require("paper")
        over = dict(map(_read_values, self.over))
        is_once_each = 0 < len(over) == len(self.over)
        check("over", self.over, f"one or more of {_FORM}, each flag once", is_once_each)
        n_runs = math.prod(map(len, over.values()))
        allowed = f"values that make at most {MAX_RUNS} runs"
        check("over", f"{n_runs} runs", allowed, n_runs <= MAX_RUNS)

        variants = self._variants(over)
        about = {"command": self.command, "arguments": self.command_arguments, "over": list(over)}
        if self.command == "grasp":
            self._sweep_grasps(variants, about)
        else:
            self._sweep_runs(variants, about)

    def _sweep_grasps(self, variants: list[Any], about: dict[str, Any]) -> None:
        """Run the trials of all variants, and print their table."""
        from iswarm_mj.search.grasp_sweep import summary, sweep_grasps

        rows = sweep_grasps(variants, self.out, about, self.again)
        print("\n".join(summary(rows, about["over"])))
        print(f"\nmeans and ranges; attempts without contact, too, in {self.out / 'sweep.csv'}")

    def _sweep_runs(self, variants: list[Any], about: dict[str, Any]) -> None:
        """Carry out the runs of all variants, and print their table.

        Raises:
            SimulationFault: a world had a fault.
        """
        from iswarm_mj.search.sweep import summary, sweep

        rows = sweep(variants, self.out, about, self.again)
        print("\n".join(summary(rows, about["over"])))
        print(f"\nmedians over worlds; all worlds in {self.out / 'sweep.csv'}")

        faults = [row["fault"] for row in rows if row["fault"]]
        if faults:
            raise SimulationFault(
                f"{len(faults)} of {len(rows)} worlds had a fault, the first: {faults[0]}"
            )

    def _variants(self, over: dict[str, list[str]]) -> list[Any]:
        """Return the runs, one for each combination of values.

        Args:
            over: values of each setting that varies, by its name.

        Raises:
            UserError: a run refuses its settings, or no run has an effect of one of them.
        """
        from iswarm_mj.search.sweep import Variant

        labels = [_labels(values) for values in over.values()]
        variants = []
        error_of_idle: dict[str, UserError] = {}
        effective: set[str] = set()
        for values, row_labels in zip(product(*over.values()), product(*labels), strict=True):
            command = self._command_with(dict(zip(over, values, strict=True)))
            try:
                reason = "on the runs of a sweep, which are not recorded"
                refuse_changed(command, _WITHOUT_EFFECT, reason)
                make_run = self._maker(command)
            except UserError as error:
                raise _in_flags_of(error, command) from None

            ineffective = ineffective_settings(command)
            effective |= set(changed_names(command)) - ineffective.keys()
            for name, reason in ineffective.items():
                error_of_idle[name] = _in_flags_of(without_effect(name, reason), command)

            row = dict(zip(over, row_labels, strict=True))
            variants.append(Variant(row, identity_of(self.command, command), make_run))

        for name, error in error_of_idle.items():
            if name not in effective:
                raise error
        return variants

    def _maker(self, command: Any) -> Callable[[], Any]:
        """Return a function that makes the run of a command, or carries out its trials.

        Raises:
            UserError: the command refuses its settings.
        """
        if self.command == "grasp":
            from iswarm_mj.workflows.grasp import run_grasp

            return partial(run_grasp, command)
        return partial(run_of, command.scenario())  # checks all settings

    def _command_with(self, values: dict[str, str]) -> Any:
        """Return the command with these values of what varies."""
        arguments = [*self.command_arguments]
        for name, value in values.items():
            arguments += _argument(name, value)
        return parse(self.command, _COMMANDS[self.command], arguments)


def identity_of(name: str, command: Any) -> str:
    """Return a text of all that determines the results of a run.

    Args:
        name: name of the command.
        command: the command with its settings.
    """
    content = [
        (setting.name, str(setting.value), _hash_of_files(setting.value))
        for setting in settings(command)
        if setting.name != "out"
    ]
    return repr((name, content))


def _split(arguments: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return the arguments of the sweep, its command included, and those of the command."""
    of_sweep: list[str] = []
    of_command: list[str] = []
    destination = of_command
    for word in arguments:
        if word.startswith("-"):
            destination = of_sweep if word.partition("=")[0] in _OWN_FLAGS else of_command
        destination.append(word)
        if word in _SWITCHES:
            destination = of_command

    has_command = bool(of_command) and not of_command[0].startswith("-")
    if has_command:
        return [of_command[0], *of_sweep], tuple(of_command[1:])
    return of_sweep, tuple(of_command)


def _in_flags_of(error: UserError, command: Any) -> UserError:
    """Return an error with flags in place of the settings of the command whose flags vary."""
    return UserError(in_flags(error, [setting.name for setting in settings(command)]))


def _read_values(text: str) -> tuple[str, list[str]]:
    """Return the name and the values of a setting that varies.

    Args:
        text: a word of `--over`.

    Raises:
        ConfigError: it has another form.
    """
    name, _, form = text.partition("=")
    is_range = form.count(":") == 2 and "," not in form
    try:
        if is_range:
            values = spaced(form, MAX_RUNS)
        else:
            values = list(dict.fromkeys(filter(None, form.split(","))))
    except ValueError:
        values = []
    check("over", text, _FORM, bool(name) and bool(values))
    return name.lstrip("-").replace("-", "_"), values


def _argument(name: str, value: str) -> list[str]:
    """Return the arguments that give a setting a value."""
    if value in ("True", "False"):
        return [switch(name, is_on=value == "True")]
    return [flag(name), value]


def _hash_of_files(value: Any) -> str:
    """Return a hash of the files that a setting names, also as FILE.py:CLASS.

    Files of Python count with what they import. Without files the hash is empty.
    """
    words = value if isinstance(value, tuple) else (value,)
    names = []
    for word in words:
        if isinstance(word, str | Path):
            names += [str(word), str(word).rpartition(":")[0]]

    files: list[Path] = []
    for name in names:
        if name and Path(name).is_file():
            path = Path(name)
            files += sources(path) if path.suffix == ".py" else [path]
    if not files:
        return ""
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _labels(texts: Sequence[str]) -> Sequence[Any]:
    """Return the values of a setting as the table has them: numbers where all are."""
    for kind in (int, float):
        try:
            return [kind(text) for text in texts]
        except ValueError:
            continue
    return texts
