"""Simulator of the I-SWARM micro-robot swarm; `iswarm --version` prints the version."""

import difflib
import io
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from typing import Protocol

import tyro

from iswarm_mj import __version__
from iswarm_mj.commands.arguments import check_choices, flag_kinds, with_booleans, without_config
from iswarm_mj.commands.bench import Bench
from iswarm_mj.commands.clean import Clean
from iswarm_mj.commands.config_file import named_in, read
from iswarm_mj.commands.config_options import with_reading
from iswarm_mj.commands.evolve import Evolve
from iswarm_mj.commands.experiment import Experiment
from iswarm_mj.commands.flags import in_flags
from iswarm_mj.commands.grasp import Grasp
from iswarm_mj.commands.help import shown
from iswarm_mj.commands.infer import Infer
from iswarm_mj.commands.inspect import Inspect
from iswarm_mj.commands.mistakes import check_numbers, misspelt, unknown
from iswarm_mj.commands.picture import Picture
from iswarm_mj.commands.report import Report
from iswarm_mj.commands.reproduce import Reproduce
from iswarm_mj.commands.run import Run
from iswarm_mj.commands.strategy_options import explained_flags, with_own
from iswarm_mj.commands.train import Train
from iswarm_mj.commands.video import Video
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.interruption import code_of_signal, handle_signals, leave


class Command(Protocol):
    """A subcommand: a dataclass of its flags."""

    def run(self) -> None:
        """Run the command."""
        ...


COMMANDS: dict[str, type[Command]] = {
    "clean": Clean,
    "run": Run,
    "inspect": Inspect,
    "picture": Picture,
    "bench": Bench,
    "grasp": Grasp,
    "evolve": Evolve,
    "train": Train,
    "experiment": Experiment,
    "infer": Infer,
    "report": Report,
    "reproduce": Reproduce,
    "video": Video,
}


def parse(arguments: Sequence[str]) -> Command:
    """Return the command that the arguments describe.

    Raises:
        UserError: there is no such command, or a value is not allowed.
        SystemExit: help or the version was printed, or tyro has explained why it cannot read the arguments.
    """
    name, *rest = arguments or [""]
    if name in COMMANDS:
        # Not as subcommands of one parser, whose hints would be about all commands.
        rest, path = without_config(rest)
        content = None if path is None else read(path, rest)
        rest = [*named_in(content, name, dict(flag_kinds(COMMANDS[name])), rest), *rest]
        command = with_own(COMMANDS[name], rest)
        if (page := shown(command, rest)) is not None:
            return tyro.cli(page[0], prog=f"iswarm {name}", args=page[1])
        kinds = dict(flag_kinds(command))
        if content is not None:
            rest = [*content.arguments(name, kinds, rest), *rest]
        # Of the flags of a strategy or a task only the parser knows all, and leaves what is none of them.
        if command is COMMANDS[name] and (left := misspelt(kinds, rest)):
            raise unknown(name, kinds, left)
        rest = with_booleans(kinds, rest)
        check_choices(kinds, rest)
        check_numbers(kinds, rest)
        _check_paths(rest)
        default = with_reading(command, rest)
        with explained_flags(command):
            made, left = tyro.cli(command, prog=f"iswarm {name}", args=rest, default=default, return_unknown_args=True)
        if left:
            raise unknown(name, kinds, left)
        return made
    if name == "--version":
        print(f"iswarm {__version__}")
        raise SystemExit(0)
    if name.startswith("-"):  # help, or the completion of a shell
        return tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="iswarm", description=__doc__, args=arguments)
    similar = "".join(f"; perhaps you meant {match}" for match in difflib.get_close_matches(name, COMMANDS, n=1))
    fact = f"{name!r} is not a command{similar}" if name else "no command was given"
    raise UserError(f"{fact}. Commands: {', '.join(COMMANDS)}; `iswarm --help` describes them.")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of `iswarm`; exits with 2 on bad input, 1 on a fault of the simulation, 128 + n on signal n."""
    command = None
    try:
        if arguments is None:
            handle_signals()
        given = sys.argv[1:] if arguments is None else arguments
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")  # names of files may be no text
        command = parse(given)
        command.run()
        sys.stdout.flush()
    except BaseException as error:
        code = code_of_signal(error)
        if code is not None:
            with suppress(OSError, ValueError):
                print(f"iswarm: interrupted{_kept(command)}.", file=sys.stderr)
            if arguments is None:
                leave(code)
            raise SystemExit(code) from None
        code = _user_code(error, command)
        if code is None:
            raise
        raise SystemExit(code) from None


def _kept(command: Command | None) -> str:
    """What is left of a command that was interrupted."""
    match command:
        case Clean():  # and run
            return "; anything recorded so far is kept"
        case Evolve() | Train():
            return "; finished generations and runs are kept, with which --resume goes on"
        case Experiment() | Infer() | Reproduce():
            return "; finished runs are kept, with which the same command goes on"
    return ""


def _user_code(error: BaseException, command: Command | None) -> int | None:
    """Explain an error of a command on the standard error, and return the exit code; None for what is no user's."""
    match error:
        case UserError() | SimulationFault():
            words = in_flags(error, COMMANDS.values(), command)
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
            words, code = f"there is not enough memory ({error or 'none is left'}); use fewer worlds or robots.", 2
        case _:
            return None
    print(f"iswarm: {' '.join(words.splitlines())}", file=sys.stderr)  # names of files may have several lines
    return code


def _check_paths(arguments: Sequence[str]) -> None:
    """Check that no file or directory to write has an empty name, which would be the working directory."""
    is_named = "--out=" not in arguments and ("--out", "") not in pairwise(arguments)
    check("out", "", "the name of a file or directory, `.` for this one", is_named)


def _discard_output() -> None:
    """Let what is still to be printed go nowhere."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
