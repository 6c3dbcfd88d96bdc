"""The command `iswarm`."""

import contextlib
import io
import itertools
import os
import sys
from collections.abc import Sequence
from typing import Protocol

import tyro

from iswarm_mj.commands.bench import Bench
from iswarm_mj.commands.clean import Clean
from iswarm_mj.commands.evolve import Evolve
from iswarm_mj.commands.experiment import Experiment
from iswarm_mj.commands.grasp import Grasp
from iswarm_mj.commands.picture import Picture
from iswarm_mj.commands.report import Report
from iswarm_mj.commands.video import Video
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.jax_setup import quieten


class Command(Protocol):
    """What every subcommand is: a dataclass of its flags."""

    def run(self) -> None:
        """Run the command."""
        ...


COMMANDS: dict[str, type[Command]] = {
    "clean": Clean,
    "picture": Picture,
    "bench": Bench,
    "grasp": Grasp,
    "evolve": Evolve,
    "experiment": Experiment,
    "report": Report,
    "video": Video,
}


def parse(arguments: Sequence[str] | None) -> Command:
    """Return the command that the arguments ask for.

    Raises:
        UserError: a flag is unknown or its value not of its type; tyro's box of text as one sentence.
    """
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="iswarm", args=arguments)
    except SystemExit as stop:
        if not stop.code:
            raise
    lines = [line.strip("│╭╮╰╯ ") for line in said.getvalue().splitlines()]
    lines = [line for line in lines[1:] if line.strip("─ ")] or ["The command line could not be read."]
    ends = ("Got errors", "Argument helptext", "For full", "Perhaps")
    fact = " ".join(itertools.takewhile(lambda line: not line.startswith(ends), lines))
    asked = (sys.argv[1:] if arguments is None else list(arguments))[:1]
    command = " ".join(["iswarm", *(name for name in asked if name in COMMANDS)])
    raise UserError(f"{fact.rstrip('.')}; `{command} --help` lists what is allowed.")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of `iswarm`; exits with 2 on bad input and 1 on a fault of the simulation."""
    quieten()
    try:
        parse(arguments).run()
    except UserError as error:
        print(f"iswarm: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    except SimulationFault as fault:
        print(f"iswarm: {fault}", file=sys.stderr)
        raise SystemExit(1) from None
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(141) from None
    except KeyboardInterrupt:
        print("iswarm: interrupted; what was recorded so far, if anything, is kept.", file=sys.stderr)
        raise SystemExit(130) from None
