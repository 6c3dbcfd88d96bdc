"""`iswarm compare`: strategies, tasks, settings and finished runs in the same worlds."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from iswarm_mj.commands.clean import Run
from iswarm_mj.commands.command_settings import (
    ineffective_settings,
    refuse_changed,
    settings,
    without_effect,
)
from iswarm_mj.commands.flags import flag, in_flags, names, switch
from iswarm_mj.commands.parser import parse
from iswarm_mj.commands.sweep import identity_of
from iswarm_mj.output.trajectory import RESULT
from iswarm_mj.search.settings import DEFAULT_WORLDS, ComparisonPlan
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import ConfigError, UserError, closest, shown
from iswarm_mj.utils.extras import require
from iswarm_mj.utils.files import read_toml
from iswarm_mj.utils.operating_system import split_words

_KINDS = (
    "a strategy, a task or a genome by its name, FILE.py:CLASS, a genome in JSON, a TOML file, "
    "or the directory of a finished run"
)
_WITHOUT_EFFECT = ("record_worlds", "record_grasps")
"""Settings of the runs that have no effect, since nothing is recorded."""
_WIDTH = 88
"""Width of the lines of sentences."""
_OWN_FLAGS = (*(flag(field.name) for field in fields(ComparisonPlan)), "--out")
"""Flags of the comparison itself that take a value; all others but switches are those of runs."""
_SWITCHES = ("--again", "-h", "--help", "--help-all")
"""Flags of the comparison itself that take no value."""


@dataclass(frozen=True)
class Compare(ComparisonPlan):
    """Compare strategies, tasks, settings or finished runs in the same worlds, with intervals."""

    MAIN: ClassVar = ()

    candidates: tyro.conf.Positional[
        Annotated[tuple[str, ...], tyro.conf.arg(metavar="CANDIDATE")]
    ] = ()
    """At least two: strategies, tasks and genomes by their names, FILE.py:CLASS, genomes in JSON,
    TOML files for --config, directories of finished runs; teams in quotes, as
    "a.py:A=0.7 type2=0.3". Each is compared with the first. Further flags are those of
    `iswarm run`, for all of them."""
    again: tyro.conf.FlagCreatePairsOff[bool] = False
    """Repeat runs that --out already holds."""
    out: Path = Path("runs/compare")
    """Directory for the results; an interrupted comparison resumes there."""
    command_arguments: tyro.conf.Suppress[tyro.conf.Fixed[tuple[str, ...]]] = ()
    """Arguments of the runs."""

    @classmethod
    def parse(cls, arguments: Sequence[str]) -> "Compare":
        """Return the comparison that arguments describe: candidates, own flags, those of runs."""
        own_arguments, command_arguments = _split(arguments)
        return replace(parse("compare", cls, own_arguments), command_arguments=command_arguments)

    def run(self) -> None:
        """Run the command."""
        require("paper")
        from iswarm_mj.search.compare import finished_candidate, gather

        if len(self.candidates) < 2:
            got = shown(" ".join(self.candidates)) if self.candidates else "none"
            raise UserError(
                f"a comparison needs at least two candidates (got {got}), each {_KINDS}"
            )
        named = _short_names(self.candidates)

        # A finished run determines the settings of the candidates that are still to be run.
        directories = {name: Path(word) for name, word in named.items() if Path(word).is_dir()}
        finished = {
            name: finished_candidate(name, directory) for name, directory in directories.items()
        }
        base = next(iter(directories.values()), None)
        candidates = [
            finished[name] if name in finished else self._candidate(name, word, base)
            for name, word in named.items()
        ]
        comparison = gather(candidates, self._plan, self.out, again=self.again)
        comparison.write(self.out)
        print("\n".join(comparison.table()))
        print()
        for sentence in comparison.sentences():
            print(textwrap.fill(sentence, _WIDTH, subsequent_indent="  "))
        print(f"\n{comparison.statistic}s over worlds; figure, worlds and intervals: {self.out}")

    @property
    def _plan(self) -> ComparisonPlan:
        """The plan without the settings of the command."""
        names_of_plan = [field.name for field in fields(ComparisonPlan)]
        return ComparisonPlan(**{name: getattr(self, name) for name in names_of_plan})

    def _candidate(self, name: str, word: str, base: Path | None) -> Any:
        """Return a `Candidate` whose runs are still to be carried out.

        Args:
            name: its name in results.
            word: word of the command line.
            base: directory of the first finished run among the candidates; None without any.

        Raises:
            UserError: the word names nothing that can be compared, or the settings are refused.
        """
        arguments = [*_arguments_of(word), *self.command_arguments]
        if base is not None:
            arguments += _arguments_of_base(base, word, arguments)
        # The comparison chooses the number of worlds, whatever a file says.
        arguments.append(f"--worlds={self.worlds or DEFAULT_WORLDS}")
        try:
            command = parse("run", Run, arguments)
        except UserError as error:
            raise UserError(f"{name}: {error}") from None
        try:
            refuse_changed(command, _WITHOUT_EFFECT, "in a comparison, which records nothing")
            for setting, reason in ineffective_settings(command).items():
                raise without_effect(setting, reason)
            scenario = command.scenario()
        except UserError as error:
            known = [setting.name for setting in settings(command)]
            raise UserError(f"{name}: {in_flags(error, known)}") from None
        from iswarm_mj.search.compare import scenario_candidate

        return scenario_candidate(name, scenario, identity_of("run", command))


def _split(arguments: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return the candidates with the flags of the comparison, and the arguments of the runs.

    Words after a flag of the runs that is no switch are its values; all other words are candidates,
    or values of the comparison's flags.
    """
    candidates: list[str] = []
    own_flags: list[str] = []
    of_runs: list[str] = []
    flags = own_flags
    n_values: float = 0
    for word in arguments:
        if word.startswith("-"):
            flags = own_flags if _name(word) in (*_OWN_FLAGS, *_SWITCHES) else of_runs
            flags.append(word)
            n_values = _most_values(word)
        elif n_values:
            flags.append(word)
            n_values -= 1
        else:
            candidates.append(word)
    return [*candidates, *own_flags], tuple(of_runs)


def _name(word: str) -> str:
    """Return the name of a flag with dashes, without its value."""
    return word.partition("=")[0].replace("_", "-")


def _most_values(word: str) -> float:
    """Return how many of the words after a flag are its values at most."""
    name = _name(word)
    if "=" in word or name in _SWITCHES:
        return 0
    if name in _OWN_FLAGS:
        return 1

    is_switched_off = name.rpartition(".")[2].removeprefix("--").startswith("no-")
    switches = [setting.name for setting in settings(Run()) if isinstance(setting.value, bool)]
    is_switched_on = name in (switch(setting, is_on=True) for setting in switches)
    return 0 if is_switched_off or is_switched_on else math.inf


def _is_team(word: str) -> bool:
    """Return whether a word names teams or a strategy with settings, not a file with blanks."""
    path, _, class_name = word.rpartition(":")
    is_class = " " not in class_name and Path(path).is_file()
    return " " in word and not is_class and not Path(word).is_file()


def _short_names(words: Sequence[str]) -> dict[str, str]:
    """Return the words of the command line by the names that candidates have in results.

    A class in a file is called by its class and a file by its stem where that is distinct.
    """
    short_names = []
    for word in words:
        path, colon, class_name = word.rpartition(":")
        is_class = bool(colon) and path.endswith(".py") and not _is_team(word)
        is_file = word.endswith((".toml", ".json")) and not _is_team(word)
        short_names.append(class_name if is_class else Path(word).stem if is_file else word)

    named: dict[str, str] = {}
    for word, short_name in zip(words, short_names, strict=True):
        name = short_name if short_names.count(short_name) == 1 else word
        if name in named:
            raise UserError(f"{shown(word)} is compared with itself; name each candidate once")
        named[name] = word
    return named


def _arguments_of(word: str) -> list[str]:
    """Return the arguments of `iswarm run` for a candidate.

    Raises:
        UserError: the word names nothing that can be compared.
    """
    if _is_team(word):
        return ["--strategy", *split_words(word)]
    suffix = Path(word).suffix
    if suffix in (".toml", ".json"):
        check("candidate", word, "an existing file", Path(word).is_file())
        return [flag("config" if suffix == ".toml" else "genome"), word]
    if word in PRESETS:
        return ["--genome", word]

    from iswarm_mj.strategy.library import STRATEGIES, TASKS, find, installed

    if word in installed(TASKS):
        return ["--task", word]
    if ":" in word or suffix == ".py":
        is_task = hasattr(find(STRATEGIES, word), TASKS.method)
        return ["--task" if is_task else "--strategy", word]
    known = [*installed(STRATEGIES), *installed(TASKS)]
    if word not in known:
        similar = closest(word, known)
        remedy = f"perhaps you meant {similar}" if similar else f"installed: {', '.join(known)}"
        raise ConfigError("candidate", word, _KINDS, remedy)
    return ["--strategy", word]


def _arguments_of_base(base: Path, word: str, arguments: Sequence[str]) -> list[str]:
    """Return further arguments of a candidate that is compared with a finished run.

    A strategy or a task gets all settings of the run, and a TOML file with settings of its own the
    seed, so that layouts are the same. What is given stays as it is. Of several finished runs, the
    first alone is read.

    Args:
        base: directory of the first finished run.
        word: the candidate.
        arguments: arguments of the candidate so far.
    """
    given = names(arguments)
    if "config" not in given:
        return ["--config", str(base / RESULT)]
    is_seeded = "seed" in given or "seed" in read_toml(Path(word), "name a TOML file")
    if is_seeded:
        return []
    from iswarm_mj.output.loading import read_result

    return [f"--seed={read_result(base / RESULT)['seed']}"]
