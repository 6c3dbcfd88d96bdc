"""Calls of other libraries that may never end."""

import threading
from collections.abc import Callable


def ends_within(limit_s: float, call: Callable[[], object]) -> bool:
    """Whether a call ends in time; otherwise it is left alone, in a thread that goes with the process.

    Args:
        limit_s: [s]
        call: what is done; its errors are raised here.
    """
    errors: list[Exception] = []

    def work() -> None:
        try:
            call()
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(limit_s)
    if errors:
        raise errors[0]
    return not thread.is_alive()
