"""Exceptions that do not end the page: a sentence on the page, a traceback in the terminal."""

import traceback

from iswarm_mj.strategy.user_code import is_users
from iswarm_mj.utils.errors import SimulationFault, UserError, printable

MOST = 300
"""Characters of an exception's message that are shown."""


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
    message = printable(str(error).strip().partition("\n")[0])[:MOST]
    text = ": ".join(filter(None, [type(error).__name__, message]))
    frames = traceback.extract_tb(error.__traceback__)
    users = [frame for frame in frames if is_users(frame.filename)]
    place = f" ({users[-1].filename}, line {users[-1].lineno})" if users else ""
    return f"{text}{place}; the terminal shows more, and Reset begins again"
