"""Errors that a user can mend: one sentence, no traceback."""


class UserError(Exception):
    """Something given from outside is not acceptable.

    The message is one sentence that says what was given, what is allowed and how to mend it.
    The command line prints it and exits with code 2.
    """


class SimulationFault(RuntimeError):
    """A run cannot go on; the message names the step, the world and the robots."""
