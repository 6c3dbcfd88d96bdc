"""Errors whose message is enough: the command line prints it without a traceback.

`UserError` is a mistake of the user, and exits with code 2. `SimulationFault` is none: the settings
were allowed, but the simulated world went wrong. It exits with code 1, and `except UserError` lets
it pass.
"""

from collections.abc import Iterable
from difflib import SequenceMatcher, get_close_matches
from enum import IntFlag
from typing import Any

MAX_SHOWN = 100
"""Maximum number of characters of a value that a message shows."""
MAX_LISTED = 10
"""Maximum number of robots that a message lists."""


def printable(text: str) -> str:
    """Return a line of text in which everything that could control a terminal is escaped.

    Surrogates stay, which stand for the bytes of file names that are no text: streams escape them
    (`commands.main` sets `backslashreplace`), and escaped here such names could not be found.
    """

    def escaped(character: str) -> str:
        is_surrogate = "\ud800" <= character <= "\udfff"
        return character if character.isprintable() or is_surrogate else ascii(character)[1:-1]

    return "".join(map(escaped, text))


def shown(value: Any) -> str:
    """Return a value as a message shows it: on one line, and cut if it is long."""
    try:
        text = printable(" ".join(str(value).split()))
    except ValueError:  # Python refuses to print whole numbers of thousands of digits
        text = "a number of too many digits"
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."


class UserError(Exception):
    """An input is not allowed.

    The message is one sentence that states what must hold, what was given, and the remedy. The
    command line prints it and exits with code 2.
    """


class ConfigError(UserError):
    """A setting has a value that is not allowed.

    Settings are called by their names in Python, such as `arena.size`, which `iswarm_mj.commands`
    turns into flags. Within `constraint` and `remedy` they stand in backticks.
    """

    def __init__(self, field: str, value: Any, constraint: str, remedy: str | None = None):
        """Describe what is wrong.

        Args:
            field: the setting's name, with its group, such as `arena.size` or `n_robots`.
            value: its value.
            constraint: what must hold, to be read after "must be", as "between 10 and 150 rd".
            remedy: what the user can do, as an imperative, where the constraint does not say it.
        """
        super().__init__(field, value, constraint, remedy)
        self.field = field
        self.value = value
        self.constraint = constraint
        self.remedy = remedy

    def __str__(self) -> str:
        got = repr(self.value) if isinstance(self.value, str) else self.value
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.field} must be {self.constraint} (got {shown(got)}){remedy}"


class FaultKind(IntFlag):
    """Why a world cannot go on; bits, since several reasons may hold at once.

    Engines, compiled kernels among them, set the bits, and the state of a world holds them as a
    number (`simulation.state.Fault`), which environments return as `info["fault"]`: a bit that has
    a meaning keeps it.
    """

    TOO_MANY_PAIRS = 1
    TOO_MANY_CONTACTS = 2
    POSE_NOT_FINITE = 4
    OUTSIDE = 8
    COMMAND_NOT_FINITE = 16
    SOLVER_FAILED = 32


_BODIES = "{robots}"
"""Place in a fact for the bodies concerned: robots, or boxes."""
_FACTS = {
    FaultKind.TOO_MANY_PAIRS: "buffer of robot pairs full",
    FaultKind.TOO_MANY_CONTACTS: "contact buffer full",
    FaultKind.POSE_NOT_FINITE: f"the pose of {_BODIES} is not finite",
    FaultKind.OUTSIDE: f"{_BODIES} left the arena",
    FaultKind.COMMAND_NOT_FINITE: f"the command of {_BODIES} is not finite",
    FaultKind.SOLVER_FAILED: "the contact solver failed",
}
_REMEDIES = {
    FaultKind.TOO_MANY_PAIRS | FaultKind.TOO_MANY_CONTACTS: (
        "use fewer robots, or with mjx increase `contact_capacity`"
    ),
    FaultKind.POSE_NOT_FINITE | FaultKind.OUTSIDE | FaultKind.SOLVER_FAILED: (
        "increase `drive.walk_substeps` and `drive.turn_substeps`, or use fewer robots"
    ),
    FaultKind.COMMAND_NOT_FINITE: "make the strategy return finite numbers",
}


class SimulationFault(RuntimeError):  # noqa: N818 - a fault of the simulated world, no mistake
    """A run cannot go on: a fault of a world, or anything else that `detail` describes."""

    def __init__(
        self,
        detail: str = "",
        *,
        step: int | None = None,
        world: int | None = None,
        robots: Iterable[int] = (),
        boxes: Iterable[int] = (),
        kind: FaultKind | int = 0,
    ):
        """Describe what went wrong, and where.

        Args:
            detail: text for what the other fields do not say, or the whole message where there is
                no `kind`.
            step: control step, counted from 1.
            world: index of the world.
            robots: indices of the robots concerned.
            boxes: indices of the boxes concerned.
            kind: one or several kinds of fault.
        """
        super().__init__(detail)
        self.detail = detail
        self.step = step
        self.world = world
        self.robots = tuple(int(robot) for robot in robots)
        self.boxes = tuple(int(box) for box in boxes)
        self.kind = FaultKind(kind)

    def __str__(self) -> str:
        facts = [
            text.replace(_BODIES, self._bodies())
            for kind, text in _FACTS.items()
            if kind & self.kind
        ]
        remedies = [text for kinds, text in _REMEDIES.items() if kinds & self.kind]
        parts = [" and ".join(facts), *remedies, self.detail]
        text = "; ".join(part for part in parts if part)

        places = []
        if self.step is not None:
            places.append(f"step {self.step}")
        if self.world is not None:
            places.append(f"world {self.world}")
        return f"{', '.join(places)}: {text}" if places else text

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self)!r})"

    def _bodies(self) -> str:
        """Return "robot 5", or "robots 5, 6 and 3 more", or "box 1"."""
        if self.boxes:
            noun = "boxes" if len(self.boxes) > 1 else "box"
            return f"{noun} {', '.join(map(str, self.boxes))}"
        if not self.robots:
            return "a robot"
        listed = ", ".join(map(str, self.robots[:MAX_LISTED]))
        n_more = len(self.robots) - MAX_LISTED
        if n_more > 0:
            listed += f" and {n_more} more"
        return f"robots {listed}" if len(self.robots) > 1 else f"robot {listed}"


def closest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that was probably meant by an unknown one.

    Of the similar names it is the one that differs in the fewest characters.

    Args:
        name: the unknown name.
        known: known names.

    Returns:
        None if no known name is similar.
    """

    def distance(candidate: str) -> tuple[int, int]:
        """Return the number of characters that differ, and the difference of the lengths."""
        n_edits = 0
        for kind, start, end, new_start, new_end in SequenceMatcher(
            None, name, candidate
        ).get_opcodes():
            if kind != "equal":
                n_edits += max(end - start, new_end - new_start)
        return n_edits, abs(len(candidate) - len(name))

    return min(get_close_matches(name, list(known)), key=distance, default=None)
