"""Exceptions that do not end the page: a sentence on the page, a traceback in the terminal."""

import traceback

from iswarm_mj.utils.errors import SimulationFault, UserError, printable
from iswarm_mj.utils.user_code import is_users

MOST_CHARACTERS = 300
"""Characters of an exception's message that are shown at most."""


class Faults:
    """Exceptions that were reported since the latest reset."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def report(self, error: BaseException) -> str:
        """Return a sentence on an exception; print its traceback unless that was done.

        Errors whose message is enough have none.
        """
        sentence = describe(error)
        is_first = sentence not in self._known
        self._known.add(sentence)
        if isinstance(error, UserError | SimulationFault):
            return str(error)
        if is_first:
            traceback.print_exception(error)
        return sentence

    def is_new(self, error: BaseException) -> bool:
        """Return whether an exception is to be shown: a user's error always, others once."""
        return isinstance(error, UserError) or describe(error) not in self._known

    def forget(self) -> None:
        """Take all exceptions for new ones, as another run may raise them for other reasons."""
        self._known.clear()


def describe(error: BaseException) -> str:
    """Return type, message and, where it comes from a user's file, the line of an exception."""
    first_line = str(error).strip().partition("\n")[0]
    text = type(error).__name__
    if first_line:
        text += f": {printable(first_line)[:MOST_CHARACTERS]}"
    users_frames = [
        frame for frame in traceback.extract_tb(error.__traceback__) if is_users(frame.filename)
    ]
    if users_frames:
        text += f" ({users_frames[-1].filename}, line {users_frames[-1].lineno})"
    return f"{text}; the terminal shows more, and Reset begins again"
