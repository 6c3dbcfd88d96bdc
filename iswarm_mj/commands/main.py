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
from iswarm_mj.commands.clean import Clean, Run
from iswarm_mj.commands.evolve import Evolve
from iswarm_mj.commands.experiment import Experiment
from iswarm_mj.commands.flags import idle, in_flags, settings, without_effect
from iswarm_mj.commands.grasp import Grasp
from iswarm_mj.commands.parser import explained
from iswarm_mj.commands.parser import parse as parsed
from iswarm_mj.commands.play import Play
from iswarm_mj.commands.recorded import Inspect, Picture, Replay, Video
from iswarm_mj.commands.report import Report, Reproduce
from iswarm_mj.commands.sweep import Sweep
from iswarm_mj.commands.train import Train
from iswarm_mj.utils.environment import check_environment
from iswarm_mj.utils.errors import SimulationFault, UserError, closest, printable, shown
from iswarm_mj.utils.signals import code_of_signal, handle_signals, leave

COMMANDS: dict[str, type] = {
    cls.__name__.lower(): cls
    for cls in (
        *(Clean, Run, Play, Sweep, Inspect, Picture, Bench, Grasp),
        *(Evolve, Train, Experiment, Report, Reproduce, Replay, Video),
    )
}
"""Subcommands by their names: dataclasses of their flags with a method `run`."""

LEAST_COLUMNS = 40
"""Width to which help is set at least, also where a terminal is narrower."""
_MOST, _END = 1500, 300
"""Characters of a message at most, and of its end, where the remedy stands, if it is longer."""


def parse(arguments: Sequence[str]) -> Any:
    """Return the command that the arguments describe.

    Raises:
        UserError: there is no such command, or a value is not allowed.
        SystemExit: help or the version was printed.
    """
    name, *rest = arguments or [""]
    if name == "sweep":  # which knows some flags, and hands on the others
        return Sweep.parse(rest)
    if name in COMMANDS:
        # Not as subcommands of one parser, whose hints would be about all commands.
        return parsed(name, COMMANDS[name], rest)
    if name == "--version":
        print(f"iswarm {__version__}")
        raise SystemExit(0)
    if name.startswith("-"):  # help, or the completion of a shell
        cli = tyro.extras.subcommand_cli_from_dict
        return explained(cli, COMMANDS, prog="iswarm", description=__doc__, args=arguments)
    match = closest(name, COMMANDS)
    similar = f"; perhaps you meant {match}" if match else ""
    fact = f"{shown(name)!r} is not a command{similar}" if name else "no command was given"
    raise UserError(f"{fact}. Commands: {', '.join(COMMANDS)}; `iswarm --help` describes them.")


def check_text(arguments: Sequence[str]) -> None:
    """Refuse arguments that are no text, which names of files may be, but no recording, table or page takes."""
    for argument in arguments:
        if argument.isprintable() or not any("\ud800" <= character <= "\udfff" for character in argument):
            continue
        try:
            text = os.fsencode(argument).decode("utf-8")
        except ValueError:
            raise UserError(
                f"arguments must be text in UTF-8 (got {shown(argument)}); rename what is named so"
            ) from None
        encoding = sys.getfilesystemencoding()
        raise UserError(
            f"arguments must be text in {encoding}, the encoding of this environment (got {text!a}); set PYTHONUTF8=1"
        )


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of `iswarm`; exits with 2 on bad input, 1 on a fault of the simulation, 128 + n on signal n."""
    command = None

    def farewell() -> str:
        return f"iswarm: interrupted{_kept(command)}."

    try:
        if arguments is None:
            handle_signals(farewell)
        given = sys.argv[1:] if arguments is None else arguments
        _prepare_output()
        check_text(given)
        command = parse(given)
        for name, why in idle(command).items():
            raise without_effect(name, why)
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
        code = _user_code(error, command)
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


def _kept(command: Any) -> str:
    """What is left of a command that was interrupted."""
    match command:
        case Clean():  # and run
            return "; anything recorded so far is kept"
        case Evolve() | Train() | Experiment() | Reproduce() | Sweep():
            return "; finished runs are kept; repeat the command to continue"
    return ""


def _user_code(error: BaseException, command: Any) -> int | None:
    """Explain an error of a command on the standard error, and return the exit code; None for what is no user's."""
    match error:
        case UserError() | SimulationFault():
            known = () if command is None else [name for name, *_ in settings(command)]
            words = in_flags(error, known)
            code = 2 if isinstance(error, UserError) else 1
        case BrokenPipeError():  # whatever read the output, such as `head`, has ended
            _discard_output()
            return 141
        case OSError():
            if error.filename is None:  # the output is no file that was named
                _discard_output()
            name = "the output, or the cache of compiled programs," if error.filename is None else str(error.filename)
            words, code = f"{name} cannot be read or written ({error.strerror or error}); choose another.", 2
        case MemoryError():
            words, code = f"there is not enough memory ({str(error) or 'none is left'}); use fewer worlds or robots.", 2
        case _:
            return None
    text = printable(" ".join(words.splitlines()))
    if len(text) > _MOST:
        text = f"{text[: _MOST - _END]} ... {text[-_END:]}"
    print(f"iswarm: {text}", file=sys.stderr)
    return code


def _discard_output() -> None:
    """Let what is still to be printed go nowhere."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
