"""Program of a worker process of `utils.pool`: it makes the calls that its parent sends."""

import os
import sys
import threading
import traceback
import warnings
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from iswarm_mj.utils.errors import SimulationFault, UserError, shown
from iswarm_mj.utils.operating_system import inherited_connection

_HALF_WRITTEN = r"Error reading persistent compilation cache entry for .*truncated stream"


def main() -> None:
    """Make calls until the parent closes the connection for calls.

    The arguments of the program are the numbers of the two ends of pipes that it inherits: the one
    for calls, and the one that the parent holds open while the process shall live.
    """
    # While one worker writes a compiled program, another may read half of it, and compiles the
    # program itself then.
    warnings.filterwarnings("ignore", _HALF_WRITTEN, UserWarning)
    connection, lifeline = (inherited_connection(int(number)) for number in sys.argv[1:])
    threading.Thread(target=_end_with_parent, args=(lifeline,), daemon=True).start()
    with suppress(EOFError, ConnectionError):
        while True:
            connection.send(_answer(connection))


def _answer(connection: Connection) -> tuple[Any, Exception | None]:
    """Make the next call, and return its result, or None and the error that it raised.

    Raises:
        EOFError: the parent has closed the connection.
    """
    try:
        call, arguments = connection.recv()
    except (EOFError, ConnectionError):
        raise
    except Exception as error:
        return None, UserError(
            f"a worker process cannot read its work ({type(error).__name__}: {shown(error)}); "
            "define classes in a module, which it can import, instead of in a script or notebook"
        )

    try:
        return call(*arguments), None
    except (SimulationFault, UserError) as error:
        return None, error
    except Exception as error:
        error.add_note(traceback.format_exc())  # the traceback itself stays in this process
        return None, error


def _end_with_parent(lifeline: Connection) -> None:
    """End when the parent closes the lifeline, or ends itself, in the middle of a call.

    The lifeline is no standard handle: on Windows the loader of libraries waits for reads of
    standard input that are under way (numpy/numpy#24290).
    """
    with suppress(EOFError, OSError):
        lifeline.recv_bytes()  # nothing is ever sent
    os._exit(1)


if __name__ == "__main__":
    main()
