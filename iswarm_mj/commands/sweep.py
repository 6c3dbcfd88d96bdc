"""`iswarm sweep`: runs with several values of their flags."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from iswarm_mj.commands.clean import Clean, Run
from iswarm_mj.commands.flags import changed, flag, idle, in_flags, refuse, settings, switch, without_effect
from iswarm_mj.commands.parser import parse
from iswarm_mj.commands.swarm import run_of
from iswarm_mj.strategy.library import sources
from iswarm_mj.utils.constraints import check, spaced, validate
from iswarm_mj.utils.errors import SimulationFault, UserError

MOST_RUNS = 10_000
_FORM = "FLAG=VALUE,VALUE,... or FLAG=START:STOP:COUNT, as density=0.1:0.4:7 or genome=type1,evolved"
_COMMANDS: dict[str, type] = {"clean": Clean, "run": Run}
_SWITCHES = ("--again", "-h", "--help", "--help-all", "--help_all")
_FLAGS = ("--over", "--out", *_SWITCHES)
"""Of the sweep itself; all others are of its command."""
_UNUSED = ("out", "record_worlds", "record_grasps")


@dataclass(frozen=True)
class Sweep:
    """Run clean or run, with its flags, for several values of any of them: a table of all worlds, and a figure."""

    command: tyro.conf.Positional[Literal["clean", "run"]] = "clean"
    """The command whose flags vary."""
    over: Annotated[tuple[str, ...], tyro.conf.arg(metavar="FLAG=VALUES")] = ()
    """What varies, each with each: FLAG=VALUE,VALUE,... or FLAG=START:STOP:COUNT, as density=0.1:0.4:7."""
    again: tyro.conf.FlagCreatePairsOff[bool] = False
    """Repeat runs that --out already holds."""
    out: Path = Path("runs/sweep")
    """Directory for the results; an interrupted sweep resumes there."""
    given: tyro.conf.Suppress[tyro.conf.Fixed[tuple[str, ...]]] = ()
    """Arguments of the command."""

    def __post_init__(self):
        validate(self)

    @classmethod
    def parse(cls, arguments: Sequence[str]) -> "Sweep":
        """Return the sweep that arguments describe, see `parser.parse`."""
        own, given = cls._split(arguments)
        return replace(parse("sweep", cls, own), given=given)

    @staticmethod
    def _split(arguments: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
        """Return the arguments of the sweep, and those of its command."""
        own: list[str] = []
        rest: list[str] = []
        part = rest
        for word in arguments:
            if word.startswith("-"):
                part = own if word.partition("=")[0] in _FLAGS else rest
            part.append(word)
            if word in _SWITCHES:
                part = rest
        command, rest = (rest[:1], rest[1:]) if rest and not rest[0].startswith("-") else ([], rest)
        return [*command, *own], tuple(rest)

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.search.sweep import Variant, summary, sweep

        over = {name: values for name, values in map(_values, self.over)}
        check("over", self.over, f"one or more of {_FORM}, each flag once", 0 < len(over) == len(self.over))
        n_runs = math.prod(map(len, over.values()))
        check("over", f"{n_runs} runs", f"values that make at most {MOST_RUNS} runs", n_runs <= MOST_RUNS)
        labels, variants = [_labels(values) for values in over.values()], []
        unused: dict[str, UserError] = {}
        used: set[str] = set()
        for values, found in zip(product(*over.values()), product(*labels), strict=True):
            own = [word for name, value in zip(over, values, strict=True) for word in _words(name, value)]
            command: Any = parse(self.command, _COMMANDS[self.command], [*self.given, *own])
            given = [(name, str(value), _content(value)) for name, value, *_ in settings(command) if name != "out"]
            try:
                refuse(command, _UNUSED, "on the runs of a sweep, which are not recorded")
                make = partial(run_of, command.scenario())  # refuses settings before any run
            except UserError as error:
                raise _in_its_flags(error, command) from None
            own_idle = idle(command)
            unused |= {name: _in_its_flags(without_effect(name, why), command) for name, why in own_idle.items()}
            used |= {*changed(command)} - {*own_idle}
            variants.append(Variant(dict(zip(over, found, strict=True)), repr((self.command, given)), make))
        for error in (error for name, error in unused.items() if name not in used):  # by no run
            raise error
        about = {"command": self.command, "arguments": self.given, "over": list(over)}
        rows = sweep(variants, self.out, about, self.again)
        lines = *summary(rows, list(over)), "", f"medians over worlds; all worlds in {self.out / 'sweep.csv'}"
        print("\n".join(lines))
        if faults := [row["fault"] for row in rows if row["fault"]]:
            raise SimulationFault(f"{len(faults)} of {len(rows)} worlds had a fault, the first: {faults[0]}")


def _in_its_flags(error: UserError, command: Any) -> UserError:
    """An error of the command whose flags vary, with these in place of settings."""
    return UserError(in_flags(error, [name for name, *_ in settings(command)]))


def _values(text: str) -> tuple[str, list[str]]:
    """Name and values of a setting."""
    name, _, values = text.partition("=")
    try:
        is_range = values.count(":") == 2 and "," not in values
        found = spaced(values, MOST_RUNS) if is_range else list(dict.fromkeys(filter(None, values.split(","))))
    except ValueError:
        found = []
    check("over", text, _FORM, bool(name) and bool(found))
    return name.lstrip("-").replace("-", "_"), found


def _words(name: str, value: str) -> list[str]:
    """What gives a setting a value."""
    return [switch(name, value == "True")] if value in ("True", "False") else [flag(name), value]


def _content(value: Any) -> str:
    """What determines a run beside its settings: a hash of the files that one of them names, also as FILE.py:CLASS,
    with what these import."""
    words = [str(word) for word in (value if isinstance(value, tuple) else (value,)) if isinstance(word, str | Path)]
    names = [name for word in words for name in (word, word.rpartition(":")[0])]
    named = [Path(name) for name in names if name and Path(name).is_file()]
    files = [one for path in named for one in (sources(path) if path.suffix == ".py" else [path])]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest() if files else ""


def _labels(texts: Sequence[str]) -> Sequence[Any]:
    """Values of a setting as the table has them: numbers where all are."""
    for kind in (int, float):
        try:
            return [kind(text) for text in texts]
        except ValueError:
            continue
    return texts
