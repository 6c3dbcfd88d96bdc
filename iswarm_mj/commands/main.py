"""Simulator of the I-SWARM micro-robot swarm; `iswarm --version` prints the version."""

import io
import os
import shutil
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import tyro

from iswarm_mj._version import __version__
from iswarm_mj.commands.bench import Bench
from iswarm_mj.commands.cache import Cache
from iswarm_mj.commands.clean import Clean, Run
from iswarm_mj.commands.command_settings import ineffective_settings, settings, without_effect
from iswarm_mj.commands.compare import Compare
from iswarm_mj.commands.evolve import Evolve
from iswarm_mj.commands.experiment import Experiment
from iswarm_mj.commands.fit import Fit
from iswarm_mj.commands.flags import in_flags
from iswarm_mj.commands.grasp import Grasp
from iswarm_mj.commands.parser import explained
from iswarm_mj.commands.parser import parse as parse_command
from iswarm_mj.commands.play import Play
from iswarm_mj.commands.recorded import Inspect, Picture, Replay, Video
from iswarm_mj.commands.report import Report, Reproduce
from iswarm_mj.commands.sweep import Sweep
from iswarm_mj.commands.tip import Tip
from iswarm_mj.commands.train import Train
from iswarm_mj.utils.environment import check_environment
from iswarm_mj.utils.errors import SimulationFault, UserError, closest, printable, shown
from iswarm_mj.utils.extras import naming_extras
from iswarm_mj.utils.signals import code_of_signal, handle_signals, leave

COMMANDS: dict[str, type] = {
    "clean": Clean,
    "run": Run,
    "play": Play,
    "sweep": Sweep,
    "compare": Compare,
    "inspect": Inspect,
    "picture": Picture,
    "bench": Bench,
    "cache": Cache,
    "grasp": Grasp,
    "fit": Fit,
    "tip": Tip,
    "evolve": Evolve,
    "train": Train,
    "experiment": Experiment,
    "report": Report,
    "reproduce": Reproduce,
    "replay": Replay,
    "video": Video,
}
"""Subcommands by their names: dataclasses of their flags with a method `run`."""

LEAST_COLUMNS = 40
"""Width to which help is set at least, also where a terminal is narrower."""
_MAX_MESSAGE = 1500
"""Maximum length of a message, in characters."""
_MESSAGE_END = 300
"""Length of the end of a longer message, where its remedy stands."""
_EXIT_BAD_INPUT = 2
_EXIT_FAULT = 1
_EXIT_BROKEN_PIPE = 141  # as shells report SIGPIPE


def parse(arguments: Sequence[str]) -> Any:
    """Return the command that the arguments describe.

    Raises:
        UserError: there is no such command, or a value is not allowed.
        SystemExit: help or the version was printed.
    """
    name, *rest = arguments or [""]
    if name in ("sweep", "compare"):  # which know some flags, and pass on the others
        return COMMANDS[name].parse(rest)
    if name in COMMANDS:
        # Not as subcommands of one parser, whose hints would be about all commands.
        return parse_command(name, COMMANDS[name], rest)
    if name == "--version":
        print(f"iswarm {__version__}")
        raise SystemExit(0)
    if name.startswith("-"):  # help, or the completion of a shell
        cli = tyro.extras.subcommand_cli_from_dict
        return explained(cli, COMMANDS, prog="iswarm", description=__doc__, args=arguments)

    if name:
        match = closest(name, COMMANDS)
        similar = f"; perhaps you meant {match}" if match else ""
        fact = f"{shown(name)!r} is not a command{similar}"
    else:
        fact = "no command was given"
    raise UserError(f"{fact}. Commands: {', '.join(COMMANDS)}; `iswarm --help` describes them.")


def check_text(arguments: Sequence[str]) -> None:
    """Refuse arguments that are no text.

    Names of files may be such, but no recording, table or page takes them.

    Raises:
        UserError: one of them is not.
    """
    for argument in arguments:
        if not any("\ud800" <= character <= "\udfff" for character in argument):
            continue
        try:
            text = os.fsencode(argument).decode("utf-8")
        except ValueError:
            raise UserError(
                f"arguments must be text in UTF-8 (got {shown(argument)}); rename what is named so"
            ) from None
        encoding = sys.getfilesystemencoding()
        raise UserError(
            f"arguments must be text in {encoding}, the encoding of this environment "
            f"(got {text!a}); set PYTHONUTF8=1"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `iswarm`.

    It exits with 2 on bad input, 1 on a fault of the simulation, 128 + n on signal n.

    Args:
        arguments: arguments of the command; by default those of the process, whose signals are
            handled then.
    """
    command = None

    def farewell() -> str:
        return f"iswarm: interrupted{_kept_results(command)}."

    try:
        if arguments is None:
            handle_signals(farewell)
        words = sys.argv[1:] if arguments is None else arguments
        _prepare_output()
        check_text(words)
        with naming_extras():
            command = parse(words)
            for name, reason in ineffective_settings(command).items():
                raise without_effect(name, reason)
            check_environment()
            command.run()
        sys.stdout.flush()
    except BaseException as error:
        code = code_of_signal(error)
        if code is not None:
            with suppress(OSError, ValueError):
                print(farewell(), file=sys.stderr)
            if arguments is None:
                leave(code)
            raise SystemExit(code) from None
        code = _explain(error, command)
        if code is None:
            raise
        raise SystemExit(code) from None


def _prepare_output() -> None:
    """Let everything be printed, on terminals of any width."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files may be no text
    if shutil.get_terminal_size().columns < LEAST_COLUMNS:
        # Tyro 1.0 breaks help into lines of no characters otherwise, without end.
        os.environ["COLUMNS"] = str(LEAST_COLUMNS)


def _kept_results(command: Any) -> str:
    """Return what an interrupted command has kept, as the end of a sentence."""
    match command:
        case Clean():  # and run
            return "; anything recorded so far is kept"
        case Evolve() | Train() | Experiment() | Reproduce() | Sweep() | Compare():
            return "; finished runs are kept; repeat the command to continue"
    return ""


def _explain(error: BaseException, command: Any) -> int | None:
    """Print the sentence of an error on stderr, and return the exit code.

    Args:
        error: error that ended the command.
        command: command that ended; None if it was not read yet.

    Returns:
        None where the error is a mistake of the program.
    """
    match error:
        case UserError() | SimulationFault():
            names = [] if command is None else [setting.name for setting in settings(command)]
            sentence = in_flags(error, names)
            code = _EXIT_BAD_INPUT if isinstance(error, UserError) else _EXIT_FAULT
        case BrokenPipeError():  # whatever read the output, such as `head`, has ended
            _discard_output()
            return _EXIT_BROKEN_PIPE
        case OSError():
            if error.filename is None:  # the output is no file that was named
                _discard_output()
                name = "the output, or the cache of compiled programs,"
            else:
                name = str(error.filename)
            fact = error.strerror or error
            sentence = f"{name} cannot be read or written ({fact}); choose another"
            code = _EXIT_BAD_INPUT
        case MemoryError():
            fact = str(error) or "none is left"
            sentence = f"there is not enough memory ({fact}); use fewer worlds or robots"
            code = _EXIT_BAD_INPUT
        case _:
            return None

    text = printable(" ".join(sentence.splitlines()))
    if not text.endswith(".."):
        text = text.removesuffix(".")  # some sentences have one, others do not
    if len(text) > _MAX_MESSAGE:
        text = f"{text[: _MAX_MESSAGE - _MESSAGE_END]} ... {text[-_MESSAGE_END:]}"
    print(f"iswarm: {text}", file=sys.stderr)
    return code


def _discard_output() -> None:
    """Let what is still to be printed go nowhere."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
